"""Operations on the signals of a recording: derivatives, spikes, wraps and delays. The provenance records each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol, TypeVar

import numpy as np

from structsel.errors import DataError
from structsel.formatting import count_of
from structsel.nomenclature import is_known
from structsel.numerics import differentiation
from structsel.numerics.dynamic_elements import shift
from structsel.numerics.signal_quality import find_spikes
from structsel.recording.checks import GAP, RECOMPUTED_KINDS, find_gaps
from structsel.recording.finding import Finding

_UNIFORM = 0.02  # time steps: times in files are rounded, and smaller deviations count as uniform sampling


class _HasSignals(Protocol):
    """What the methods below need of a recording."""

    @property
    def name(self) -> str: ...
    @property
    def t(self) -> np.ndarray: ...
    @property
    def dt(self) -> float: ...
    @property
    def duration(self) -> float: ...
    @property
    def findings(self) -> tuple[Finding, ...]: ...
    def __getitem__(self, name: str) -> np.ndarray: ...
    def unit(self, name: str) -> str: ...
    def require(self, *names: str, finite: bool = False, by: str | None = None) -> None: ...
    def with_channels(
        self: _R, *, note: str = "", units: Mapping[str, str] | None = None, at_cg: Iterable[str] = (),
        findings: Iterable[Finding] = (), **arrays: np.ndarray | float,
    ) -> _R: ...  # fmt: skip


_R = TypeVar("_R", bound=_HasSignals)


class SignalMethods:
    """Methods of a recording that return it with modified signals."""

    def differentiate(self: _R, *names: str, method: str = "central", order: int = 4) -> _R:
        """Add the time derivatives ``p_dot``, ... of channels.

        If the sampling is not uniform, the chain rule over the sample number is used; the spline needs no such rule,
        and "fourier" needs uniform sampling. The spline also interpolates samples that are NaN; the provenance has
        their number.

        Parameters
        ----------
        *names : str
        method, order
            As `structsel.numerics.differentiation.differentiate` takes them.

        Raises
        ------
        ChannelError
            If a channel is missing.
        DataError
            If there is a gap in time, or a sample is not finite.
        """
        self.require(*names, finite=method != "spline", by="differentiate")
        t, dt = self.t, self.dt
        gaps = find_gaps(t, GAP * dt)
        if gaps.size:
            i = int(gaps[0])
            raise DataError(
                f"differentiate needs time without gaps; '{self.name}' has no samples between {t[i]:g} and "
                f"{t[i + 1]:g} s.\nUse recording.split() first and differentiate each part."
            )
        rate = self.duration / (len(t) - 1)
        uniform = bool(np.abs(t - (t[0] + np.arange(len(t)) * rate)).max() <= _UNIFORM * dt)
        sampling = "uniform sampling" if uniform else "non-uniform sampling"
        made = {}
        for name in names:
            x = self[name]
            if method == "spline":
                made[f"{name}_dot"] = differentiation.smooth_derivative(x, t)
            elif uniform:
                made[f"{name}_dot"] = differentiation.differentiate(x, rate, method, order)
            elif method == "fourier":
                raise DataError(
                    f"differentiate by fourier needs uniform sampling; '{self.name}' has none.\n"
                    'Use method="spline", which works with any sampling.'
                )
            else:
                per_sample = differentiation.differentiate(t, 1.0, method, order)
                made[f"{name}_dot"] = differentiation.differentiate(x, 1.0, method, order) / per_sample
        label = f"method {method}" if method in differentiation.SMOOTHERS else f"method {method}, order {order}"
        if not uniform and method != "spline":
            sampling += ", chain rule"
        missing = {name: int((~np.isfinite(self[name])).sum()) for name in names}
        filled = "".join(
            f", {count} missing samples of {name} interpolated" for name, count in missing.items() if count
        )
        units = {
            f"{name}_dot": f"{self.unit(name)}/s"
            for name in names
            if self.unit(name) != "?" and not is_known(f"{name}_dot")
        }
        note = f"{', '.join(made)}: differentiated, {label}, {sampling}{filled}"
        return self.with_channels(note=note, units=units, **made)

    def remove_spikes(self: _R, *names: str, threshold: float = 5.0) -> _R:
        """Replace isolated wrong samples of channels by a local fit, and report each.

        A channel with replaced samples gets a finding of kind "spike" and a line in the provenance with the number,
        time and old value of every replaced sample.

        Parameters
        ----------
        *names : str
        threshold : float [-]
            In standard deviations of the channel's noise; the other criteria are those of
            `structsel.numerics.signal_quality.find_spikes`.

        Raises
        ------
        ChannelError
            If a channel is missing.
        """
        self.require(*names, by="remove_spikes")
        made = self
        for name in dict.fromkeys(names):
            old = self[name]
            samples, values = find_spikes(old, threshold=threshold)
            if not samples.size:
                continue
            corrected = old.copy()
            corrected[samples] = values
            each = ", ".join(f"{i} (t = {self.t[i]:g} s, was {old[i]:.6g}, is {corrected[i]:.6g})" for i in samples)
            count = count_of(samples.size, "spike sample")
            note = f"{name}: {count} above {threshold:g} sigma replaced: {each}"
            message = f"{count} replaced by a local fit, first"
            remedy = "the provenance lists every sample and its old value"
            found = Finding.of_samples("spike", name, message, "note", remedy, self.t, samples)
            made = _replace_channels(made, note, {name: corrected}, found)
        return made

    def unwrap(self: _R, *names: str, turn: float = 2.0 * np.pi) -> _R:
        """Remove jumps by complete turns from angles, which then continue beyond pi (or 360 degrees).

        A jump within a quarter turn of a multiple of a turn is a wrap; other jumps are kept. NaN samples are ignored.

        Parameters
        ----------
        *names : str
        turn : float [rad]
            Jump of the channel where it wraps: pi for a bank angle that is recorded in half turns.

        Raises
        ------
        ChannelError
            If a channel is missing.
        """
        self.require(*names, by="unwrap")
        made = self
        for name in dict.fromkeys(names):
            angle = self[name].copy()
            finite = np.flatnonzero(np.isfinite(angle))
            jumps = np.diff(angle[finite]) / turn
            turns = np.round(jumps)
            turns[np.abs(jumps - turns) > 0.25] = 0.0
            angle[finite[1:]] -= turn * np.cumsum(turns)
            wraps = np.flatnonzero(turns)
            if wraps.size:
                at = ", ".join(str(int(finite[i + 1])) for i in wraps)
                note = f"{name}: {count_of(wraps.size, 'wrap')} of {turn:.6g} rad removed, at samples {at}"
                made = _replace_channels(made, note, {name: angle})
        return made

    def align(self: _R, delays: Mapping[str, float]) -> _R:
        """Advance delayed channels, each by its own delay.

        Parameters
        ----------
        delays : mapping of str to float [s]
            Positive if the channel is delayed; `reconstruct` estimates the delays of a recording.

        Returns
        -------
        Recording
            The last samples of an advanced channel are unknown: they are NaN, with a finding "not-finite".

        Raises
        ------
        ChannelError
            If a channel is missing.
        DomainError
            If a delay is not finite.
        """
        self.require(*delays, by="align")
        aligned = {name: shift(self[name], self.t, delay) for name, delay in delays.items()}
        lost = {name: int(np.isnan(x).sum() - np.isnan(self[name]).sum()) for name, x in aligned.items()}
        each = ", ".join(f"{name} by {delay:g} s ({lost[name]} samples lost)" for name, delay in delays.items())
        return _replace_channels(self, f"advanced in time: {each}", aligned)


def _replace_channels(recording: _R, note: str, channels: Mapping[str, np.ndarray], *found: Finding) -> _R:
    """Recording with modified channels, which keep their findings that are not computed from the samples."""
    kept = (f for f in recording.findings if f.channel in channels and f.kind not in RECOMPUTED_KINDS)
    return recording.with_channels(note=note, findings=(*kept, *found), **channels)  # type: ignore[arg-type]
