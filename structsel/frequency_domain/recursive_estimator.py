"""RecursiveEstimator: parameters by equation error in the frequency domain, sample by sample."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from structsel.candidates import Term
from structsel.errors import ChannelError, DataError, DomainError
from structsel.formatting import count_of, finite_or_none
from structsel.numerics.recursive_transforms import RecursiveTransforms
from structsel.recording import Recording
from structsel.results import Estimates, NamedEstimates
from structsel.tables import Summary

SPACING = 0.04
"""Spacing of the default frequencies [Hz] [M00]."""
BAND = (0.1, 1.5)
"""Band of the default frequencies [Hz], that of rigid-body motion [M00]."""
_UNEVEN = 0.05  # of the sampling interval; chosen, not critical


@dataclass(frozen=True, eq=False, repr=False)
class RecursiveEstimate(NamedEstimates, Estimates):
    """Parameters at one time.

    Attributes
    ----------
    response : str
    names : tuple of str
        Terms.
    t : float [s]
        Of the last sample.
    values, std : (k,) array
        NaN as long as the samples do not determine the parameters. Standard errors for noise that is white over the
        band.
    r2 : float
        Fraction of the power of the response over the band.
    samples : int
    forgetting : float
    """

    response: str
    names: tuple[str, ...]
    t: float
    values: np.ndarray
    std: np.ndarray
    r2: float
    samples: int
    forgetting: float

    def __post_init__(self) -> None:
        self.freeze()

    def _estimates(self) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, float]:
        return self.names, self.values, self.std, np.inf

    @property
    def determined(self) -> bool:
        """Whether the samples determine the parameters."""
        return bool(np.isfinite(self.values).all())

    def to_dict(self) -> dict[str, Any]:
        """Time, values and standard errors, for JSON."""
        content = {
            "schema": "structsel.recursive_estimate/1",
            "response": self.response,
            "t": self.t,
            "samples": self.samples,
            "r2": self.r2,
            "parameters": [
                {"name": name, "value": float(value), "std": float(std)}
                for name, value, std in zip(self.names, self.values, self.std)
            ],
        }
        found: dict[str, Any] = finite_or_none(content)
        return found

    def summary(self) -> Summary:
        """Values and standard errors."""
        warnings = () if self.determined else ("The samples do not determine the parameters yet.",)
        about = f"{self.response} at t = {self.t:.4g} s, {count_of(self.samples, 'sample')}"
        return Summary(
            "Recursive estimate", about, facts=(("R2", f"{self.r2:.4f}"),), tables=(self.estimate_table("term"),),
            warnings=warnings,
        )  # fmt: skip


class RecursiveEstimator:
    """Estimate the parameters of one response while a flight is recorded.

    The finite Fourier transforms of response and terms grow with each sample, and equation error on them gives the
    parameters [M00]. With ``forgetting=1`` the estimate after the last sample is that of `equation_error` over the
    same frequencies, to rounding. A constant and a linear trend are removed from all signals.

    Parameters
    ----------
    response : str
        A channel, such as ``"CZ"``. ``"q_dot"``, without such a channel in the samples, is the derivative of ``"q"``,
        taken in the frequency domain: nothing is differentiated.
    terms : iterable of str or Term
        Such as ``["alpha", "q", "de"]``; no constant.
    frequencies : (f,) array, optional [Hz]
        By default from 0.1 to 1.5 Hz, 0.04 Hz apart.
    forgetting : float
        Weight of a sample over that of the next one: 1 forgets nothing, 1 - dt / T about what is older than T seconds.

    Raises
    ------
    DomainError
        Frequencies or a forgetting factor that cannot be used.
    ChannelError
        A constant among the terms, or none.

    References
    ----------
    [M00], [KM16].
    """

    def __init__(
        self,
        response: str,
        terms: Iterable[str | Term],
        *,
        frequencies: Sequence[float] | np.ndarray | None = None,
        forgetting: float = 1.0,
    ) -> None:
        self.response = response
        self.terms = tuple(term if isinstance(term, Term) else Term(term) for term in terms)
        if not self.terms or any(term.is_constant for term in self.terms):
            raise ChannelError("RecursiveEstimator needs terms without the constant, which the band does not contain.")
        given = np.arange(BAND[0], BAND[1] + 1e-9, SPACING) if frequencies is None else frequencies
        self.frequencies = np.asarray(given, dtype=float)
        if not (self.frequencies.size and self.frequencies.min() > 0.0 and np.isfinite(self.frequencies).all()):
            raise DomainError("RecursiveEstimator needs frequencies above zero [Hz].")
        if 2 * self.frequencies.size <= len(self.terms):
            raise DomainError(
                f"{self.frequencies.size} frequencies give {2 * self.frequencies.size} equations for "
                f"{count_of(len(self.terms), 'parameter')}; give more frequencies."
            )
        if not 0.0 < forgetting <= 1.0:
            raise DomainError(
                f"RecursiveEstimator needs a forgetting factor above 0 and not above 1; got {forgetting}."
            )
        self.forgetting = float(forgetting)
        self._sums: RecursiveTransforms | None = None
        self._start: tuple[float, np.ndarray] | None = None
        self._t = np.nan
        self._derivative = False

    def __repr__(self) -> str:
        samples = 0 if self._sums is None else self._sums.count
        return f"<RecursiveEstimator {self.response} on {', '.join(map(str, self.terms))}: {samples} samples>"

    def update(self, t: float, sample: Mapping[str, float]) -> None:
        """Add one sample.

        Parameters
        ----------
        t : float [s]
            One sampling interval after the last sample.
        sample : mapping of str to float
            Channels in SI units and radians.

        Raises
        ------
        ChannelError
            A channel is missing.
        DataError
            A channel is not finite, or the sampling interval changes.
        """
        self.feed(_Samples(np.array([t]), {name: np.array([value]) for name, value in sample.items()}))

    def feed(
        self, samples: Recording | _Samples, *, every: float | None = None, after: float | None = None
    ) -> list[RecursiveEstimate]:
        """Add all samples of a recording, or of the next part of one.

        Parameters
        ----------
        samples : Recording
        every : float, optional [s]
            Interval of the estimates that are returned.
        after : float, optional [s]
            Only samples later than this are added.

        Returns
        -------
        list of RecursiveEstimate
            Empty without `every`.

        Raises
        ------
        ChannelError, DataError
            As `update`.
        """
        signals = self._signals(samples)
        found = []
        for t, x in zip(samples["t"], signals):
            if after is not None and t <= after:
                continue
            before = self._t
            self._add(float(t), x)
            if every is not None and np.floor(before / every + 1e-9) < np.floor(t / every + 1e-9):
                found.append(self.estimate())
        return found

    def estimate(self) -> RecursiveEstimate:
        """Parameters from all samples so far; NaN where they do not determine them."""
        names = tuple(map(str, self.terms))
        count = 0 if self._sums is None else self._sums.count
        try:
            if self._sums is None:
                raise DataError("no samples yet")
            fit = self._sums.regress(self._derivative)
            values, std, r2 = fit.theta.copy(), fit.std, fit.r2
        except DataError:
            values, std, r2 = np.full(len(names), np.nan), np.full(len(names), np.nan), np.nan
        return RecursiveEstimate(self.response, names, self._t, values, std, r2, count, self.forgetting)

    def _signals(self, samples: Recording | _Samples) -> np.ndarray:
        """(n, k + 1) terms, then the response or the channel whose derivative it is."""
        base = self.response.removesuffix("_dot")
        self._derivative = self.response not in samples and base != self.response
        name = base if self._derivative else self.response
        if name not in samples:
            there = ", ".join(samples.names)
            raise ChannelError(f"RecursiveEstimator needs channel '{name}'; the samples have {there}.")
        signals = np.column_stack([*(term.evaluate(samples) for term in self.terms), samples[name]])
        if not np.isfinite(signals).all():
            row = int(np.argwhere(~np.isfinite(signals))[0][0])
            raise DataError(
                f"RecursiveEstimator needs finite samples; that at t = {samples['t'][row]:g} s is not.\n"
                "Start a new estimator after the gap, or interpolate."
            )
        return signals

    def _add(self, t: float, x: np.ndarray) -> None:
        if self._sums is None and self._start is None:
            self._start, self._t = (t, x), t
            return
        if self._sums is None:
            assert self._start is not None
            dt = t - self._start[0]
            if not dt > 0.0 or self.frequencies.max() >= 0.5 / dt:
                raise DataError(
                    f"RecursiveEstimator needs time that increases and a sampling frequency above "
                    f"{2 * self.frequencies.max():g} Hz; the first two samples are {dt:g} s apart."
                )
            self._sums = RecursiveTransforms(x.size, self.frequencies, dt, self.forgetting)
            self._sums.add(self._start[1])
        elif abs(t - self._t - self._sums.dt) > _UNEVEN * self._sums.dt:
            raise DataError(
                f"RecursiveEstimator needs samples {self._sums.dt:g} s apart; after t = {self._t:g} s comes {t:g} s.\n"
                "Start a new estimator after a gap; resample what is sampled unevenly."
            )
        self._sums.add(x)
        self._t = t


@dataclass(frozen=True)
class _Samples:
    """Samples by channel, without the checks of a Recording, which needs two."""

    t: np.ndarray
    channels: Mapping[str, np.ndarray]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return tuple(self.channels)

    def __contains__(self, name: object) -> bool:
        return name == "t" or name in self.channels

    def __getitem__(self, name: str) -> np.ndarray:
        return self.t if name == "t" else self.channels[name]

    def __iter__(self) -> Any:
        return iter(self.channels)

    def __len__(self) -> int:
        return len(self.channels)
