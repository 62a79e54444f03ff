"""Synthetic recovery cases: correlated signals of a closed-loop aeroplane, known terms, coloured residuals.

Eight signals (alpha, beta, p_hat, q_hat, r_hat, de, da, dr) come from a linear aeroplane with actuators,
stability augmentation, a pilot who flies random pulses with cross-feed, and turbulence. Because the loops
are closed the signals are correlated, as in flight. The candidates are all monomials up to a degree; the
response is seven of them, three of them weak: their true value is a stated number of standard errors
of the generalised least-squares estimate that knows the residual's noise model and the seven terms.

The true terms are drawn so that the data can separate them: in the whitened metric no term outside the
truth may correlate above ``alias_limit`` with a true one once the other true terms are removed. That is a
property of the signals, not of any search; without it the wrong model is often the better one by BIC
(at the default 0.9 and t = 7 the truth fits better than one such swap by 9 +- 6 in -2 log L).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eig, expm, solve_toeplitz
from scipy.signal import butter, lfilter

NOISE_MODELS = ("white", "ar1_0.92", "ar1_0.98", "ar2_mode_3Hz", "lowpass_1Hz+white", "smoothed_5pt")
SUM_MODEL = "ar1_0.95+mode_3Hz"
"""AR(1) of 0.95 and a mode of 3 Hz with a damping ratio of 0.08, of equal variance: no autoregression of low order."""
SIGNALS = ("alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "V_ratio", "throttle")
DT = 0.02
WEAK_T = (7.0, 10.0, 13.0)

_SPAN, _CHORD, _V0 = 14.63, 1.5875, 45.0
_BURN_IN = 2000
_DRAW_SAMPLES = 20_000  # the truth is drawn on at most this many samples; standard errors scale by 1/sqrt(n)
_CHUNK = 1024


@dataclass(frozen=True)
class Case:
    """One recovery problem, of one response or several.

    Attributes
    ----------
    noise_model : str
    names : tuple of str
        Of the base signals.
    manoeuvres : tuple of (base (s, n_k), responses (m, n_k)) pairs
    exponents : (p, s) int array
        Of the candidate monomials, by degree and then alphabetically; the constant is not among them.
    true : tuple of int
        Candidates in the (first) response.
    theta : (7,) array
        Their values, in that order; the last three are the weak ones.
    intercept : float
    standard_errors : (7,) array
        Generalised least-squares standard errors with the true noise model.
    noise_std : float
        Of the coloured residual (total, not innovation).
    ar : (L,) array
        The true residual noise as e[t] = sum ar[l-1] e[t-l] + white (a long fit where it is no exact AR).
    r2 : float
        1 - var(residual)/var(response).
    """

    noise_model: str
    names: tuple[str, ...]
    manoeuvres: tuple[tuple[np.ndarray, np.ndarray], ...]
    exponents: np.ndarray
    true: tuple[int, ...]
    theta: np.ndarray
    intercept: float
    standard_errors: np.ndarray
    noise_std: float
    ar: np.ndarray
    r2: float

    @property
    def n(self) -> int:
        return sum(base.shape[1] for base, _ in self.manoeuvres)

    @property
    def base(self) -> np.ndarray:
        """(s, n): all manoeuvres side by side (a copy when there are several)."""
        arrays = [base for base, _ in self.manoeuvres]
        return arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis=1)

    @property
    def response(self) -> np.ndarray:
        """(n,): the first response, all manoeuvres side by side."""
        return np.concatenate([responses[0] for _, responses in self.manoeuvres])

    @property
    def term_names(self) -> list[str]:
        return [_term_name(row, self.names) for row in self.exponents]

    def redraw(self, seed: int) -> Case:
        """The same flights and truth with fresh residuals (for coverage); one response."""
        rng = np.random.default_rng([seed, 77])
        signal = [_evaluate(base, self.exponents, self.true, self.theta) for base, _ in self.manoeuvres]
        manoeuvres = tuple(
            (base, (self.intercept + s + self.noise_std * residual(self.noise_model, base.shape[1], rng))[None])
            for (base, _), s in zip(self.manoeuvres, signal)
        )
        return replace(self, manoeuvres=manoeuvres)


def monomials(n_signals: int, degree: int) -> np.ndarray:
    """(p, s) int array: exponents of all monomials of degree 1 to `degree` (of 8: 164 at 3, 494 at 4)."""
    rows = []
    for d in range(1, degree + 1):
        for word in combinations_with_replacement(range(n_signals), d):
            rows.append(np.bincount(word, minlength=n_signals))
    return np.array(rows)


def design_matrix(base: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """(n, p): the candidates as a matrix, for peers that need one and for tests."""
    powers = _powers(base, int(exponents.max()))
    X = np.ones((base.shape[1], len(exponents)))
    for j, row in enumerate(exponents):
        for s in np.flatnonzero(row):
            X[:, j] *= powers[row[s]][s]
    return X


def flight_signals(n: int, seed: int, n_signals: int = 8) -> np.ndarray:
    """Signals of one closed-loop flight of `n` samples at 50 Hz, (n_signals, n), C-contiguous.

    The discrete linear system is filtered mode by mode, so the cost is a few recursions per sample.
    """
    if not 1 <= n_signals <= len(SIGNALS):
        raise ValueError(f"n_signals must be 1 to {len(SIGNALS)}, not {n_signals}")
    rng = np.random.default_rng([seed, 11])
    poles, gains_in, gains_out = _modes()
    total = n + _BURN_IN
    inputs = np.empty((6, total))
    pulses = np.array([_pulses(total, rng) for _ in range(4)])
    # Cross-feed of a pilot's stick and pedals: commands are not orthogonal in flight.
    inputs[:4] = np.array([[1, 0.12, 0.05, 0], [0.12, 1, 0, 0], [0.05, 0.25, 1, 0], [0, 0, 0, 1]]) @ pulses
    inputs[:4] *= np.array([0.075, 0.09, 0.085, 0.2])[:, None]
    inputs[4:] = rng.standard_normal((2, total)) * np.array([[0.022], [0.022]])
    out = np.zeros((n_signals, n))
    for pole, g_in, g_out in zip(poles, gains_in, gains_out):
        mode = lfilter([0.0, 1.0], [1.0, -pole], g_in @ inputs)[_BURN_IN:]
        for k in range(n_signals):
            out[k] += (g_out[k] * mode).real
    trim = np.array([0.10, 0.0, 0.0, 0.0, 0.0, -0.05, 0.0, 0.0, 1.0, 0.5])
    out += trim[:n_signals, None]
    return out


def residual(noise_model: str, n: int, rng: np.random.Generator) -> np.ndarray:
    """Unit-variance residual of `n` samples of one noise model (see `NOISE_MODELS`)."""
    white = rng.standard_normal(n + _BURN_IN)
    if noise_model == "lowpass_1Hz+white":
        b, a = _lowpass()
        slow = lfilter(b, a, white) / np.sqrt(_power(b, a))
        e = np.sqrt(0.8) * slow + np.sqrt(0.2) * rng.standard_normal(n + _BURN_IN)
    elif noise_model == SUM_MODEL:
        e = np.zeros(white.size)
        for b, a in map(_shaping, noise_model.split("+")):
            e += np.sqrt(0.5 / _power(b, a)) * lfilter(b, a, rng.standard_normal(white.size))
    else:
        b, a = _shaping(noise_model)
        e = lfilter(b, a, white) / np.sqrt(_power(b, a))
    return e[_BURN_IN:]


def true_ar(noise_model: str, order: int = 40) -> tuple[np.ndarray, float]:
    """The noise model as (ar, innovation std / residual std); a fit to the true spectrum where not AR."""
    if noise_model == "white":
        return np.empty(0), 1.0
    if noise_model.startswith("ar") and noise_model != SUM_MODEL:
        a = _shaping(noise_model)[1]
        return -a[1:], float(1 / np.sqrt(_power(np.ones(1), a)))
    if noise_model == "smoothed_5pt":
        c = np.zeros(order + 1)
        c[:5] = (5 - np.arange(5)) / 5
    elif noise_model == SUM_MODEL:
        c = 0.5 * sum(_correlation(*_shaping(part), order) for part in noise_model.split("+"))
    else:
        c = 0.8 * _correlation(*_lowpass(), order)
        c[0] += 0.2
    ar = solve_toeplitz(c[:-1], c[1:])
    return ar, float(np.sqrt(1 - ar @ c[1:]))


def recovery_case(
    noise_model: str = "white",
    seed: int = 0,
    *,
    n: int = 20_000,
    degree: int = 3,
    n_signals: int = 8,
    n_manoeuvres: int = 1,
    n_responses: int = 1,
    r2: float = 0.96,
    weak_t: tuple[float, ...] = WEAK_T,
    alias_limit: float = 0.9,
) -> Case:
    """One recovery case: 7 true terms (4 strong, 3 weak) among all monomials to `degree`.

    Parameters
    ----------
    noise_model : str
        One of `NOISE_MODELS`, or `SUM_MODEL`.
    seed : int
        The flights, the truth and the residual follow from it alone.
    n : int
        Samples in all, divided evenly among the manoeuvres.
    n_responses : int
        More than one gives every response its own truth; `true`, `theta` are those of the first.
    r2 : float
        Fraction of the response's variance that the true terms explain (the strong ones alone set it).
    weak_t : tuple of float
        True value of each weak term in its standard errors.
    """
    models = (*NOISE_MODELS, SUM_MODEL)
    if noise_model not in models:
        raise ValueError(f"noise_model must be one of {models}, not {noise_model!r}")
    lengths = [len(part) for part in np.array_split(np.arange(n), n_manoeuvres)]
    bases = [flight_signals(m, 1000 * seed + k, n_signals) for k, m in enumerate(lengths)]
    exponents = monomials(n_signals, degree)
    ar, innovation = true_ar(noise_model)
    gram, variance, m_draw = _whitened_gram(bases, exponents, ar)
    rng = np.random.default_rng([seed, 33, models.index(noise_model), degree])
    responses: list[list[np.ndarray]] = [[] for _ in bases]
    first = None
    for k in range(n_responses):
        true = _draw_terms(exponents, gram, rng, alias_limit, len(weak_t))
        strong = list(true[: len(true) - len(weak_t)])
        theta = np.zeros(len(true))
        theta[: len(strong)] = rng.choice([-1, 1], len(strong)) * rng.uniform(0.6, 1.4, len(strong))
        theta[: len(strong)] /= np.sqrt(variance[strong])
        signal = [_evaluate(base, exponents, strong, theta[: len(strong)]) for base in bases]
        noise_std = float(np.sqrt(np.concatenate(signal).var() * (1 - r2) / r2))
        information = gram[np.ix_(true, true)] * (n / m_draw) / (noise_std * innovation) ** 2
        se = np.sqrt(np.diag(np.linalg.inv(information)))
        weak = rng.permutation(weak_t) * rng.choice([-1, 1], len(weak_t))
        theta[len(strong) :] = weak * se[len(strong) :]
        intercept = float(rng.normal() * noise_std)
        explained, total = [], []
        for parts, base, s in zip(responses, bases, signal):
            s += _evaluate(base, exponents, true[len(strong) :], theta[len(strong) :]) + intercept
            e = noise_std * residual(noise_model, base.shape[1], rng)
            explained.append(e)
            parts.append(s + e)
            total.append(parts[-1])
        if k == 0:
            fraction = 1 - np.concatenate(explained).var() / np.concatenate(total).var()
            first = (true, theta, intercept, se, noise_std, float(fraction))
    assert first is not None
    true, theta, intercept, se, noise_std, fraction = first
    manoeuvres = tuple((base, np.array(parts)) for base, parts in zip(bases, responses))
    return Case(
        noise_model=noise_model,
        names=SIGNALS[:n_signals],
        manoeuvres=manoeuvres,
        exponents=exponents,
        true=true,
        theta=theta,
        intercept=intercept,
        standard_errors=se,
        noise_std=noise_std,
        ar=ar,
        r2=fraction,
    )


def score(case: Case, selected: object) -> tuple[bool, int, int]:
    """(exact, missed, false) of a selection given as candidate indices."""
    chosen = {int(j) for j in selected}  # type: ignore[attr-defined]
    truth = set(case.true)
    return chosen == truth, len(truth - chosen), len(chosen - truth)


# ---------------------------------------------------------------- the closed-loop aeroplane


def closed_loop() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C of x' = A x + B u, y = C x; u is de, da, dr, throttle commands and two gusts, y is `SIGNALS`."""
    # States: alpha q theta u/V | beta p r phi | de da dr thr (two lags each) | gust alpha, gust beta
    motion = ["alpha", "q", "theta", "u", "beta", "p", "r", "phi"]
    names = [*motion, "de", "da", "dr", "thr", "de2", "da2", "dr2", "thr2", "ga", "gb"]
    i = {name: k for k, name in enumerate(names)}
    A = np.zeros((len(names), len(names)))

    def row(name: str, **terms: float) -> None:
        for other, value in terms.items():
            A[i[name], i[other]] = value

    row("alpha", alpha=-1.25, q=0.97, u=-0.35, de=-0.10, ga=-1.25)
    row("q", alpha=-4.2, q=-2.6, de=-9.5, ga=-4.2)
    row("theta", q=1.0)
    row("u", alpha=0.1, theta=-0.218, u=-0.08, thr=0.06)
    row("beta", beta=-0.28, p=0.1, r=-0.98, phi=0.215, dr=0.04, gb=-0.28)
    row("p", beta=-3.8, p=-4.9, r=1.7, da=-7.0, dr=0.5, gb=-3.8)
    row("r", beta=2.4, p=-0.5, r=-0.8, da=-0.3, dr=-3.2, gb=2.4)
    row("phi", p=1.0, r=0.1)
    row("ga", ga=-1.6)
    row("gb", gb=-1.6)
    for surface in ("de", "da", "dr", "thr"):
        rate = 2.0 if surface == "thr" else 25.0
        A[i[surface], i[surface]], A[i[surface], i[surface + "2"]] = -rate, rate
        A[i[surface + "2"], i[surface + "2"]] = -rate
    # Augmentation; positive control makes a negative moment, so feedback gains are positive.
    for surface, feedback in {
        "de2": {"q": 0.12, "theta": 0.22, "u": -0.05},
        "da2": {"p": 0.08, "phi": 0.25},
        "dr2": {"r": 0.25, "p": -0.03, "da": 0.15},
        "thr2": {"u": -1.5, "theta": 0.3},
    }.items():
        rate = -A[i[surface], i[surface]]
        for other, gain in feedback.items():
            A[i[surface], i[other]] += rate * gain
    B = np.zeros((len(names), 6))
    for k, surface in enumerate(("de2", "da2", "dr2", "thr2")):
        B[i[surface], k] = -A[i[surface], i[surface]]
    B[i["ga"], 4] = B[i["gb"], 5] = np.sqrt(2 * 1.6 / DT)
    C = np.zeros((10, len(names)))
    for k, (name, gain) in enumerate(
        {
            "alpha": 1.0,
            "beta": 1.0,
            "p": _SPAN / (2 * _V0),
            "q": _CHORD / (2 * _V0),
            "r": _SPAN / (2 * _V0),
            "de": 1.0,
            "da": 1.0,
            "dr": 1.0,
            "u": 1.0,
            "thr": 1.0,
        }.items()
    ):
        C[k, i[name]] = gain
    C[0, i["ga"]] = C[1, i["gb"]] = 1.0
    return A, B, C


def _modes() -> tuple[list, list, list]:
    """Poles and gains of the discrete closed loop, one of each conjugate pair (its output counted twice)."""
    A, B, C = closed_loop()
    m = len(A)
    held = expm(np.block([[A, B], [np.zeros((6, m + 6))]]) * DT)
    # Feedback separates the equal lags of an actuator, and the two gusts do not touch each other, so the
    # matrix has a full set of modes (checked against the plain recursion in tests/test_demo.py).
    poles, left = eig(held[:m, :m])
    inverse = np.linalg.inv(left)
    g_in, g_out = inverse @ held[:m, m:], (C @ left).T
    keep = [k for k in range(m) if poles[k].imag >= -1e-12]
    twice = [2.0 if poles[k].imag > 1e-12 else 1.0 for k in keep]
    return [poles[k] for k in keep], [g_in[k] for k in keep], [c * g_out[k] for c, k in zip(twice, keep)]


def _pulses(n: int, rng: np.random.Generator) -> np.ndarray:
    """Random pulses held 0.3 to 2 s, half of the time at rest, like 3-2-1-1 inputs and doublets in any order."""
    mean_hold = 1.15 / DT
    count = int(1.3 * n / mean_hold) + 20
    hold = rng.integers(int(0.3 / DT), int(2.0 / DT) + 1, count)
    level = rng.standard_normal(count) * (rng.random(count) < 0.6)
    return np.repeat(level, hold)[:n]


# ---------------------------------------------------------------- residual noise models


def _shaping(noise_model: str) -> tuple[np.ndarray, np.ndarray]:
    if noise_model == "white":
        return np.ones(1), np.ones(1)
    if noise_model.startswith("ar1_"):
        return np.ones(1), np.array([1.0, -float(noise_model[4:])])
    if noise_model == "ar2_mode_3Hz":  # a structural mode of 3 Hz, 5 % damped
        radius = np.exp(-0.05 * 2 * np.pi * 3.0 * DT)
        return np.ones(1), np.array([1.0, -2 * radius * np.cos(2 * np.pi * 3.0 * DT), radius**2])
    if noise_model == "mode_3Hz":
        radius = np.exp(-0.08 * 2 * np.pi * 3.0 * DT)
        return np.ones(1), np.array([1.0, -2 * radius * np.cos(2 * np.pi * 3.0 * DT), radius**2])
    if noise_model == "smoothed_5pt":
        return np.full(5, 0.2), np.ones(1)
    raise ValueError(f"noise_model must be one of {NOISE_MODELS}, not {noise_model!r}")


def _correlation(b: np.ndarray, a: np.ndarray, order: int) -> np.ndarray:
    """Autocorrelation of white noise through b/a at lags 0 to `order`."""
    h = lfilter(b, a, np.eye(1, 4000)[0])
    return np.array([h[: len(h) - k] @ h[k:] for k in range(order + 1)]) / (h @ h)


def _lowpass() -> tuple[np.ndarray, np.ndarray]:
    return butter(2, 1.0, fs=1 / DT)


def _power(b: np.ndarray, a: np.ndarray) -> float:
    """Variance of white unit noise through b/a."""
    impulse = lfilter(b, a, np.eye(1, 8000)[0])
    return float(impulse @ impulse)


# ---------------------------------------------------------------- terms


def _term_name(row: np.ndarray, names: tuple[str, ...]) -> str:
    return "*".join(names[s] + (f"^{row[s]}" if row[s] > 1 else "") for s in np.flatnonzero(row))


def _powers(base: np.ndarray, degree: int) -> list[np.ndarray]:
    powers = [np.ones_like(base), base]
    for _ in range(degree - 1):
        powers.append(powers[-1] * base)
    return powers


def _evaluate(base: np.ndarray, exponents: np.ndarray, terms: object, theta: np.ndarray) -> np.ndarray:
    """(n,) sum of theta times the terms, in chunks so that nothing large is made."""
    rows = exponents[list(terms)]  # type: ignore[call-overload]
    out = np.empty(base.shape[1])
    for start in range(0, len(out), 65_536):
        chunk = slice(start, start + 65_536)
        out[chunk] = design_matrix(base[:, chunk], rows) @ theta
    return out


def _whitened_gram(
    bases: list[np.ndarray], exponents: np.ndarray, ar: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Centred Gram of the whitened candidates, their (unwhitened) variances, samples used (<= 20 000)."""
    p, lag = len(exponents), len(ar)
    whiten = np.concatenate([[1.0], -ar])
    scale = np.sqrt(np.mean(bases[0][:, :_DRAW_SAMPLES] ** 2, axis=1))
    column = np.prod(scale**exponents, axis=1)
    G, total = np.zeros((p, p)), np.zeros(p)
    raw_sum, raw_square, used = np.zeros(p), np.zeros(p), 0
    quota = -(-_DRAW_SAMPLES // len(bases))
    for base in bases:
        stop = min(base.shape[1], quota)
        for start in range(0, stop, _CHUNK):
            first = max(start - lag, 0)
            X = design_matrix(base[:, first : min(start + _CHUNK, stop)] / scale[:, None], exponents)
            Z = lfilter(whiten, 1.0, X, axis=0)[lag:] if lag else X
            new = X[start - first :]
            raw_sum += new.sum(axis=0)
            raw_square += (new**2).sum(axis=0)
            G += Z.T @ Z
            total += Z.sum(axis=0)
            used += len(Z)
    n_raw = sum(min(base.shape[1], quota) for base in bases)
    # The whitened constant is a constant, so removing the mean removes it.
    G -= np.outer(total, total) / used
    variance = raw_square / n_raw - (raw_sum / n_raw) ** 2
    return G * np.outer(column, column), variance * column**2, used


def _draw_terms(
    exponents: np.ndarray, gram: np.ndarray, rng: np.random.Generator, limit: float, n_weak: int
) -> tuple[int, ...]:
    """Three linear and one quadratic strong terms, `n_weak` of degree 2 or more; none with a near-alias."""
    degree = exponents.sum(axis=1)
    groups = [np.flatnonzero(degree == 1), np.flatnonzero(degree == 2), np.flatnonzero(degree >= 2)]
    if len(groups[0]) < 3 or len(groups[2]) < n_weak + 1:
        raise ValueError(f"{len(exponents)} candidates are too few to draw seven true terms from")
    scale = np.sqrt(np.diag(gram))
    R = gram / np.outer(scale, scale)
    best, worst = (), np.inf
    for _ in range(2000):
        chosen = [*rng.choice(groups[0], 3, replace=False), rng.choice(groups[1])]
        rest = groups[2][~np.isin(groups[2], chosen)]
        chosen += list(rng.choice(rest, n_weak, replace=False))
        alias = _nearest_alias(R, chosen)
        if alias < worst:
            best, worst = tuple(int(j) for j in chosen), alias
        if alias <= limit:
            return best
    raise ValueError(f"no seven terms found whose nearest alias correlates below {limit}; best {worst:.3f}")


def _nearest_alias(R: np.ndarray, chosen: list) -> float:
    """Largest |correlation| of a term outside with a true one, the other true ones removed from both."""
    outside = np.setdiff1d(np.arange(len(R)), chosen)
    worst = 0.0
    for j in chosen:
        others = [k for k in chosen if k != j]
        factor = cho_factor(R[np.ix_(others, others)])
        cross = R[np.ix_(others, outside)]
        solved = cho_solve(factor, cross)
        left = 1 - np.sum(cross * solved, axis=0)
        with_j = R[j, outside] - R[j, others] @ solved
        left_j = 1 - R[j, others] @ cho_solve(factor, R[others, j])
        if left_j < 0.05:  # a true term that is nearly a linear combination of the others
            return 1.0
        worst = max(worst, float(np.max(np.abs(with_j) / np.sqrt(np.maximum(left, 1e-9) * left_j))))
    return worst
