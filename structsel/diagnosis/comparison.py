"""comparison(): the differences that a diagnosis explains, and what each effect would add to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from structsel.aircraft import Aircraft
from structsel.comparison.flight import Flight
from structsel.comparison.noise import bins_of, edge_of
from structsel.comparison.preparing import prepare
from structsel.comparison.tolerances import tolerances_of
from structsel.diagnosis.diagnose import but_without, split_flight
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.signatures import Library, work_out
from structsel.diagnosis.switching import with_proposals
from structsel.effects import Effect
from structsel.errors import DataError
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import Base
from structsel.numerics.fourier_series import spectrum
from structsel.recording import Recording

Contribution = Mapping[str, Mapping[str, tuple[Array, Array]]]
"""Recording to response to (t, values): what effects add to measured less simulated."""


@dataclass(frozen=True, eq=False)
class EffectSignature:
    """One form of one effect: what its parameters add to measured less simulated.

    Attributes
    ----------
    effect : str
    form : str
        Distinguishes this form from the others of the effect; may be empty.
    parameters : tuple of str
        Names of the k linear parameters.
    columns : tuple of mapping of response to (m, k) array
        One mapping for each part, in the order of `EffectComparison.parts`: cosine coefficients of what one prior
        standard deviation of each parameter adds. Responses that the form does not touch are absent.
    """

    effect: str
    form: str
    parameters: tuple[str, ...]
    columns: tuple[Mapping[str, Array], ...]


@dataclass(frozen=True, eq=False)
class EffectComparison:
    """Differences between recordings and a simulation, and the signatures of effects on them.

    Attributes
    ----------
    responses : tuple of str
        Those compared: coefficients or channels, and the kinematic residuals.
    t : mapping of recording to (n,) array [s]
    differences : mapping of recording to mapping of response to (n,) array
        Measured less simulated, in the unit of the response.
    """

    responses: tuple[str, ...]
    t: Mapping[str, Array]
    differences: Mapping[str, Mapping[str, Array]]
    _flights: tuple[Flight, ...] = field(repr=False)
    _effects: tuple[Effect, ...] = field(repr=False)

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of what is held out in turn: the recordings, or parts of a single one."""
        return tuple(f.name for f in self._parts)

    @cached_property
    def transformed(self) -> tuple[Mapping[str, Array], ...]:
        """Differences of each part as (m,) cosine coefficients by response, the level first."""
        return tuple(
            {c: spectrum(f.difference[c], bins_of(f), edge_of(f)) for c in self.responses} for f in self._parts
        )

    @cached_property
    def signatures(self) -> tuple[EffectSignature, ...]:
        """Every form of every effect that these recordings can show; computed when first used."""
        return tuple(
            EffectSignature(
                s.hypothesis.name, s.variant.about, tuple(p.name for p in s.variant.parameters), tuple(s.spectra)
            )
            for s in self._library.signatures
        )

    @property
    def not_testable(self) -> Mapping[str, str]:
        """Effect to what it needs that these recordings lack."""
        return dict(self._library.not_testable)

    @cached_property
    def _parts(self) -> list[Flight]:
        return split_flight(self._flights[0]) if len(self._flights) == 1 else list(self._flights)

    @cached_property
    def _library(self) -> Library:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1):
            library = work_out(self._effects, self._parts, self.responses)
            return with_proposals(library, self._parts, tolerances_of(self._parts))

    def log_bayes_factor(
        self,
        contribution: Contribution,
        responses: Sequence[str] | None = None,
        *,
        known: Contribution | None = None,
    ) -> float:
        """Log evidence of the differences less a given contribution, minus that of the differences as they are.

        The parameters within the tolerances of the aircraft are free in both. The noise is estimated from the
        differences less the contribution, and is the same in both.

        Parameters
        ----------
        contribution : mapping of recording to mapping of response to (t, values)
            What an effect adds to measured less simulated: (k,) times [s] and values in the unit of the response.
        responses : sequence of str, optional
            Those that are compared; by default all, and an effect adds nothing to those without a contribution.
        known : mapping as `contribution`, optional
            What other effects add; it is subtracted first.

        Returns
        -------
        float
            Natural logarithm. Large where the contribution is in the differences, and tolerances and noise cannot
            account for it.

        Raises
        ------
        DataError
            The contribution is of a recording or a response that is not compared.
        """
        from threadpoolctl import threadpool_limits

        known = known or {}
        given = (contribution, known)
        unknown = [f"recording '{name}'" for one in given for name in one if name not in self.t]
        wanted = self.responses if responses is None else tuple(responses)
        unknown += [f"response '{c}'" for c in wanted if c not in self.responses]
        unknown += [f"response '{c}'" for one in given for held in one.values() for c in held if c not in wanted]
        if unknown:
            raise DataError(f"a contribution is given for {unknown[0]}, which is not compared.")
        with threadpool_limits(1):
            flights = [_less(_only(f, wanted), known.get(f.name, {})) for f in self._flights]
            explained = DiagnosisProblem.set_up([_less(f, contribution.get(f.name, {})) for f in flights], ())
            rows = [replace(r, flight=f).difference() for r, f in zip(explained.rows, flights)]
            base = explained.base
            unexplained = Base(rows, base.given, base.groups, base.scales)
        return base.log_evidence - unexplained.log_evidence


def comparison(
    simulation: Any,
    recordings: Sequence[Recording],
    aircraft: Aircraft,
    *,
    effects: Sequence[Effect] | None = None,
    without_effects: Sequence[str] = (),
    progress: Callable[[str, int, int], None] | None = None,
) -> EffectComparison:
    """Differences between recordings and a simulation, as `diagnose` sees them before it ranks effects.

    Use it to try another ranking method on the same differences and signatures, or to ask whether an effect of known
    size could be detected in these recordings.

    Parameters
    ----------
    simulation, recordings, aircraft, effects, without_effects, progress
        As `diagnose` takes them.

    Returns
    -------
    EffectComparison

    Raises
    ------
    DataError, ModelError
        As `diagnose`.

    Examples
    --------
    >>> from structsel.demo import demo_missing_physics
    >>> from structsel.diagnosis import comparison
    >>> case = demo_missing_physics("cross-coupling", flights=2)
    >>> compared = comparison(case.simulated, case.recordings, case.aircraft)
    >>> compared.parts
    ('m01', 'm02')
    """
    from threadpoolctl import threadpool_limits

    effects = but_without(effects, without_effects)
    with threadpool_limits(1):
        flights = prepare(simulation, recordings, aircraft, progress, aligned=True).flights
    return EffectComparison(
        tuple(flights[0].responses),
        {f.name: f.t for f in flights},
        {f.name: {c: f.difference[c] for c in flights[0].responses} for f in flights},
        flights,
        effects,
    )


def _only(flight: Flight, responses: Sequence[str]) -> Flight:
    """A prepared flight with some of its responses."""
    simulated = {c: x for c, x in flight.simulated.items() if c in responses}
    return replace(flight, measured={c: flight.measured[c] for c in responses}, simulated=simulated)


def _less(flight: Flight, contribution: Mapping[str, tuple[Array, Array]]) -> Flight:
    """A prepared flight less what an effect adds to it."""
    measured = {
        c: y - np.interp(flight.t, *contribution[c]) if c in contribution else y for c, y in flight.measured.items()
    }
    return replace(flight, measured=measured)
