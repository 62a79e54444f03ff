"""Coverage of 95 % intervals of a least-squares fit with coloured residuals, by lag window of the sandwich covariance.

    python benchmarks/lag_windows.py --draws 100

Two kinds of regressors: seven terms of simulated flights, and slow ones as in flight-path reconstruction (powers of
time, integrals of the signals). Each draw adds new residuals. The last window is the one structsel uses for every
standard error (see `structsel.numerics.noise_models`).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
from cases import DT, design_matrix, flight_signals, monomials, residual
from numpy.typing import NDArray
from scipy import fft
from scipy.signal import lfilter
from timing import machine, publish, table

from structsel.numerics.score_covariance import last_correlated_lag, parzen_window

Array = NDArray[np.float64]
NORMAL_95 = 1.959963984540054
TERMS = [0, 3, 5, 8, 13, 20, 30]  # of the monomials to degree two
LENGTHS = {
    "600": [600],
    "1500": [1500],
    "4 x 600": [600] * 4,
    "6000": [6000],
}


def autoregression(*ar: float) -> Callable[[int, np.random.Generator], Array]:
    """Residuals of unit variance from the autoregression e[t] = sum ar[l] e[t-l-1] + white."""
    denominator = np.r_[1.0, -np.array(ar)]
    std = lfilter([1.0], denominator, np.random.default_rng(0).standard_normal(200_000)).std()
    return lambda n, rng: lfilter([1.0], denominator, rng.standard_normal(n + 2000))[2000:] / std


MODE_3HZ = autoregression(2 * 0.97 * np.cos(2 * np.pi * 3 * DT), -(0.97**2))
AR_095 = autoregression(0.95)
SLOW = autoregression(0.98)
NOISES: dict[str, Callable[[int, np.random.Generator], Array]] = {
    "white": autoregression(),
    "AR 0.5": autoregression(0.5),
    "AR 0.92": autoregression(0.92),
    "AR 0.95 + 3 Hz mode": lambda n, rng: AR_095(n, rng) + MODE_3HZ(n, rng),
    "AR 0.98": SLOW,
    "1 Hz low pass + white": lambda n, rng: residual("lowpass_1Hz+white", n, rng),
    "white hides AR 0.98": lambda n, rng: np.sqrt(0.2) * SLOW(n, rng) + np.sqrt(0.8) * rng.standard_normal(n),
    "3 Hz mode": MODE_3HZ,
}


def quadratic_spectral(u: Array) -> Array:
    """Andrews' quadratic-spectral window."""
    u = np.maximum(u, 1e-3)  # below, rounding is larger than 1 - w
    z = 6.0 * np.pi * u / 5.0
    return 25.0 / (12.0 * np.pi**2 * u**2) * (np.sin(z) / z - np.cos(z))


def windows(R: Array) -> dict[str, Array]:
    """Weights of the lags 0 .. n - 1 by window, from the autocovariance (n,)."""
    n = R.size
    lag = np.arange(n)
    fifth = n // 5
    correlated = np.abs(R[1 : fifth + 1]) > 2.0 * R[0] / np.sqrt(n - lag[1 : fifth + 1])
    reach = min(4 * (1 + int(np.argmin(np.append(correlated, False)))), fifth)
    politis = last_correlated_lag(R[: fifth + 1], n - lag[: fifth + 1])
    rho = float(np.clip(R[1] / R[0], -0.97, 0.995))
    bandwidth = (4.0 * rho**2 / (1.0 - rho) ** 4 * n) ** 0.2  # Andrews (1991), for an AR(1) residual
    return {
        "none, n/5": (lag <= fifth).astype(float),
        "Bartlett n/5": np.maximum(1.0 - lag / (fifth + 1), 0.0),
        "Bartlett, 4 x first lag within 2 sigma": np.maximum(1.0 - lag / reach, 0.0),
        "Parzen n/5": parzen_window(lag / (fifth + 1)),
        "Parzen, automatic": parzen_window(lag / max(2.6614 * bandwidth, 1.0)),
        "quadratic spectral, automatic": quadratic_spectral(lag / max(1.3221 * bandwidth, 1.0)),
        "Parzen, 6 x Politis's lag": parzen_window(lag / min(6 * politis, fifth + 1)),
    }


def correlate(x: Array) -> Array:
    """sum_i x[i] x[i + l] along the last axis."""
    size = fft.next_fast_len(2 * x.shape[-1], real=True)
    return fft.irfft(np.abs(fft.rfft(x, size)) ** 2, size)[..., : x.shape[-1]]


def terms_of_a_flight(signals: Array) -> Array:
    """(n, 8): a constant and seven candidate terms."""
    return np.column_stack([np.ones(signals.shape[1]), design_matrix(signals, monomials(8, 2)[TERMS])])


def slow_sensitivities(signals: Array) -> Array:
    """(n, 16): powers of time, signals, and their integrals once and twice."""
    time = np.linspace(-1.0, 1.0, signals.shape[1])
    x = signals - signals.mean(axis=1, keepdims=True)
    once = np.cumsum(x, axis=1) * DT
    return np.column_stack([*(time**k for k in range(4)), *once[:5], *(np.cumsum(once[:3], axis=1) * DT), *x[:4]])


REGRESSORS = {"terms": terms_of_a_flight, "slow": slow_sensitivities}


def coverage(
    regressors: Callable[[Array], Array],
    lengths: list[int],
    noise: Callable[[int, np.random.Generator], Array],
    draws: int,
) -> dict[str, float]:
    """Fraction of parameters inside their interval, over two sets of flights, by window."""
    inside: dict[str, list[float]] = {}
    for flights in (0, 1):
        X = np.vstack([regressors(flight_signals(n, 1000 * flights + k)) for k, n in enumerate(lengths)])
        X /= np.sqrt(np.mean(X**2, axis=0))
        estimator = np.linalg.pinv(X)
        edges = np.cumsum(lengths)[:-1]
        own = [correlate(rows) for rows in np.split(estimator, edges, axis=1)]
        for draw in range(draws):
            rngs = [np.random.default_rng([flights, draw, k]) for k in range(len(lengths))]
            e = np.concatenate([noise(n, rng) for n, rng in zip(lengths, rngs)])
            error = estimator @ e
            variance: dict[str, Array] = {}
            for products, v in zip(own, np.split(e - X @ error, edges)):
                R = correlate(v) / (v.size - np.arange(v.size))
                for name, weight in windows(R).items():
                    terms = products * (weight * R)
                    variance[name] = variance.get(name, 0.0) + 2.0 * terms.sum(axis=1) - terms[:, 0]
            n, k = X.shape
            for name, value in variance.items():
                half = NORMAL_95 * np.sqrt(np.maximum(value, 0.0) * n / (n - k))
                inside.setdefault(name, []).append(float(np.mean(np.abs(error) <= half)))
    return {name: float(np.mean(values)) for name, values in inside.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=150, help="residual draws of each of two sets of flights")
    parser.add_argument("--out", help="also write the report to this file")
    a = parser.parse_args()
    rows, names = [], []
    for kind, regressors in REGRESSORS.items():
        for length, lengths in LENGTHS.items():
            for noise, make in NOISES.items():
                found = coverage(regressors, lengths, make, a.draws)
                names = list(found)
                rows.append([kind, length, noise, *(f"{100 * value:.1f}" for value in found.values())])
    note = (
        f"Coverage [%] of 95 % intervals, {2 * a.draws} draws of 8 or 16 parameters; "
        f"one standard error is {100 * np.sqrt(0.05 * 0.95 / (2 * a.draws)):.1f} at most."
    )
    publish(
        "\n\n".join(["# Lag windows", machine(), table(["regressors", "samples", "residual", *names], rows), note]),
        a.out,
    )


if __name__ == "__main__":
    main()
