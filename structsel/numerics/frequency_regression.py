"""Least squares of Fourier transforms: equation error in the frequency domain. Arrays only.

References
----------
[KM16], frequency-domain methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.errors import DataError
from structsel.numerics.spectra import LONG, transform


@dataclass(frozen=True)
class FrequencyFit:
    """Least squares over frequencies.

    Attributes
    ----------
    theta : (k,) array
    covariance : (k, k) array
        For noise that is white over the band, whatever the spacing of the frequencies.
    noise_std : float
        Of the response in time, if its noise outside the band has the same density.
    fit : (f,) complex array
        Transform of the model's response, manoeuvre after manoeuvre.
    r2 : float
        Fraction of the power of the response that is explained at these frequencies.
    """

    theta: np.ndarray
    covariance: np.ndarray
    noise_std: float
    fit: np.ndarray
    r2: float

    def __post_init__(self) -> None:
        for array in (self.theta, self.covariance, self.fit):
            array.setflags(write=False)

    @property
    def std(self) -> np.ndarray:
        """(k,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))


def equation_error(
    regressors: np.ndarray | Sequence[np.ndarray],
    response: np.ndarray | Sequence[np.ndarray],
    dt: float | Sequence[float],
    frequencies: np.ndarray | Sequence[np.ndarray],
) -> FrequencyFit:
    """Equation error in the frequency domain: complex least squares for real parameters.

    With X and z transforms of the detrended regressors and response, those of several manoeuvres below each other::

        theta = Re(X'X)^-1 Re(X'z)

    The estimate is linear in the samples, theta = G y, so that for white noise of variance s2 its covariance is
    s2 G G', exactly and for any spacing of the frequencies.

    Parameters
    ----------
    regressors : (n, k) array, or one for each manoeuvre
    response : (n,) array, or one for each manoeuvre
    dt : float [s], or one for each manoeuvre
    frequencies : (f,) array [Hz], or one for each manoeuvre
        Above zero; the detrending removes the constant term.

    Raises
    ------
    DataError
        Too few frequencies, or regressors that are linearly dependent at these frequencies.
    DomainError
        As `transform`.

    References
    ----------
    [KM16], frequency-domain methods, equation error.
    """
    if isinstance(response, np.ndarray):
        regressors, response, dt, frequencies = [regressors], [response], [dt], [frequencies]  # type: ignore[list-item]
    manoeuvres = [
        (np.asarray(X, dtype=float), np.asarray(y, dtype=float), float(step), np.asarray(f, dtype=float))
        for X, y, step, f in zip(regressors, response, dt, frequencies, strict=True)  # type: ignore[arg-type]
    ]
    k, equations = manoeuvres[0][0].shape[1], 2 * sum(f.size for *_, f in manoeuvres)
    if equations <= k:
        raise DataError(f"{equations // 2} frequencies give {equations} equations for {k} parameters; ask for more.")
    z = [transform(y, step, f) for _, y, step, f in manoeuvres]
    X = [transform(X_t, step, f) for X_t, _, step, f in manoeuvres]
    noise = scipy.linalg.block_diag(*(_noise_gram(len(y), step, f) for _, y, step, f in manoeuvres))
    return regress_transforms(X, z, noise)


def regress_transforms(X: Sequence[np.ndarray], z: Sequence[np.ndarray], noise: np.ndarray) -> FrequencyFit:
    """Least squares of transforms, with the covariance of the parts of the transformed noise of variance one.

    Parameters
    ----------
    X : sequence of (f, k) complex array
        Of each manoeuvre.
    z : sequence of (f,) complex array
    noise : array
        Twice as many rows and columns as frequencies: of each manoeuvre real parts, then imaginary parts.

    Raises
    ------
    DataError
        Regressors that are linearly dependent at these frequencies.
    """
    stacked = np.vstack([part for one in X for part in (one.real, one.imag)])
    length = np.linalg.norm(stacked, axis=0)
    singular = np.linalg.svd(stacked / np.where(length > 0.0, length, 1.0), compute_uv=False)
    if not length.all() or singular[-1] < 1e-10 * singular[0]:
        raise DataError(
            "equation error: the regressors depend on each other at these frequencies, or one is not excited there. "
            "Leave one out, widen the band, or fly an input that moves them apart."
        )
    inverse = scipy.linalg.pinv(stacked / length) / length[:, None]
    theta = inverse @ np.concatenate([part for one in z for part in (one.real, one.imag)])
    fit = np.concatenate([one @ theta for one in X])
    left = np.eye(len(stacked)) - stacked @ inverse
    lost = float(np.sum(np.abs(np.concatenate(z) - fit) ** 2))
    variance = lost / float(np.sum((left @ noise) * left))
    power = float(np.sum(np.abs(np.concatenate(z)) ** 2))
    covariance = variance * (inverse @ noise @ inverse.T)
    return FrequencyFit(theta, covariance, float(np.sqrt(variance)), fit, 1.0 - lost / power if power > 0.0 else np.nan)


def _noise_gram(n: int, dt: float, f: np.ndarray) -> np.ndarray:
    """(2 f, 2 f) covariance of the parts of the detrended transform of white noise of variance one."""
    weights = np.full(n, dt)
    weights[[0, -1]] *= 0.5
    line = np.linalg.qr(np.column_stack([np.ones(n), np.linspace(-1.0, 1.0, n)]))[0]
    gram, straight = np.zeros((2 * f.size, 2 * f.size)), np.zeros((2 * f.size, 2))
    block = max(1, LONG // (2 * f.size))
    for a in range(0, n, block):
        times = dt * np.arange(a, min(a + block, n))
        W = np.exp(-2j * np.pi * np.outer(f, times)) * weights[a : a + block]
        rows = np.vstack([W.real, W.imag])
        gram += rows @ rows.T
        straight += rows @ line[a : a + block]
    return gram - straight @ straight.T


def sampled_response(
    Phi: np.ndarray, push: np.ndarray, C: np.ndarray, feed: np.ndarray, turn: np.ndarray, jump: np.ndarray
) -> np.ndarray:
    """Transforms of the outputs of ``x[k+1] = Phi x[k] + p[k]``, ``y[k] = C x[k] + d[k]``, many systems at once.

    At integer multiples of 1 / (n dt) the sums over n samples are related exactly, with z = exp(i w dt)::

        y~ = C (z I - Phi)^-1 [p~ + z (x[0] - x[n])] + d~

    so that sampling introduces no error up to half the sampling frequency.

    Parameters
    ----------
    Phi : (m, s, s) array
    push, feed : (m, f, s), (m, f, o) complex arrays
        Transforms of p and d.
    C : (m, o, s) array
    turn : (f,) complex array
        z.
    jump : (m, s) array
        x[0] - x[n], in the scale of the transforms.

    Returns
    -------
    (m, f, o) complex array
    """
    resolvent = turn[None, :, None, None] * np.eye(Phi.shape[1]) - Phi[:, None]
    drive = push + turn[None, :, None] * jump[:, None, :]
    try:
        x = np.linalg.solve(resolvent, drive[..., None])[..., 0]
    except np.linalg.LinAlgError:
        x = np.full(drive.shape, np.nan + 0j)
    return np.einsum("mos,mfs->mfo", C, x) + feed


def as_real(transforms: np.ndarray) -> np.ndarray:
    """(..., 2 f, c) real parts above imaginary parts, as the outputs of an output-error problem.

    At integer multiples of 1/T the transforms of white noise are uncorrelated and their two parts have equal variances,
    so `fit_output_error` on these is maximum likelihood in the frequency domain.
    """
    return np.concatenate([transforms.real, transforms.imag], axis=-2)
