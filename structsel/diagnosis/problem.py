"""The regression problem of a diagnosis: whitened rows of every flight, and the columns of the tolerances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.noise import (
    Noise,
    Rows,
    SparseRows,
    as_spectra,
    bins_of,
    difference_spectra,
    edge_of,
    side_by_side,
)
from structsel.comparison.noise_estimate import estimate_noise
from structsel.comparison.nuisance import Nuisance
from structsel.comparison.tolerances import biases_of, tolerances_of
from structsel.diagnosis.signatures import Signature
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import Base, Further, Trial, group_by_width
from structsel.numerics.fourier_series import spectrum

Spectra = Mapping[str, Array]
_LARGEST_WIDENING = 0.3  # relative, of the tolerance of a derivative
_CLEARLY_WIDER = 1.01  # ratio of tolerances from which the noise of their response is estimated again
_TOLERANCE_FRACTIONS = (1.0, 0.3, 0.1, 0.03)
"""Prior standard deviations over the stated tolerances: a tolerance is a bound, and most simulations are better."""


@dataclass(frozen=True, eq=False)
class DiagnosisProblem:
    """Flights that are prepared for the regression on effects.

    Attributes
    ----------
    flights : tuple of Flight
    responses : tuple of str
    nuisances : list of Nuisance
    allowed : sequence of mapping of response to (bins, k) array
        Spectra of the nuisance parameters per flight, scaled by their tolerances.
    own : list of mapping of response to (bins, j) array
        Spectra of the biases of each flight.
    accepted : tuple of Signature
        Effects that are in the model, with free parameters.
    noise : Noise
    rows : list of Rows
    base : Base
    """

    flights: tuple[Flight, ...]
    responses: tuple[str, ...]
    nuisances: list[Nuisance]
    allowed: Sequence[Spectra]
    own: Sequence[Spectra]
    accepted: tuple[Signature, ...]
    noise: Noise
    rows: list[Rows]
    base: Base

    @classmethod
    def set_up(
        cls,
        flights: Sequence[Flight],
        library: Sequence[Signature],
        groups: Sequence[tuple[int, ...]] | None = None,
        tolerances: Sequence[Nuisance] = (),
    ) -> DiagnosisProblem:
        """Problem of flights without effects in the model.

        Parameters
        ----------
        flights : sequence of Flight
        library : sequence of Signature
            Effects that may be in the differences: they must not be counted as noise.
        groups : sequence of tuple of int, optional
            Flights that are held out together; by default each in turn.
        tolerances : sequence of Nuisance, optional
            By default those of `tolerances_of`.
        """
        nuisances = list(tolerances) or tolerances_of(flights)
        allowed: list[Spectra] = []
        own: list[Spectra] = []
        for i, f in enumerate(flights):
            allowed.append(as_spectra(side_by_side([(n.sd, n.columns[i]) for n in nuisances], f), f))
            own.append(as_spectra(side_by_side([(sd, columns) for _, sd, columns in biases_of(f)], f), f))
        pool = _pool(flights, _no_noise(library), flights[0].responses)
        first = estimate_noise(flights, allowed, flights[0].responses, pool)
        nuisances, allowed, changed = _widened(flights, nuisances, allowed, first)
        return cls._build(tuple(flights), nuisances, allowed, own, (), pool, groups, first.but_for(changed))

    @property
    def judged_responses(self) -> list[str]:
        """Responses by which an effect is judged: the coefficients; of a plant without any, all simulated responses."""
        aerodynamic = [c for c in self.responses if c in COEFFICIENTS]
        return aerodynamic or [c for c in self.responses if c in self.flights[0].simulated]

    @property
    def found(self) -> frozenset[str]:
        """Names of the effects that are in the model."""
        return frozenset(s.hypothesis.name for s in self.accepted)

    @property
    def is_plant(self) -> bool:
        """Whether no coefficient is simulated."""
        return not set(self.responses) & set(COEFFICIENTS)

    @property
    def deviations(self) -> tuple[Array, Array]:
        """Deviation of each parameter from its stated value, and its standard error, (k,) each [stated tolerances]."""
        k = len(self.nuisances)
        scale, posterior = self.base.scales[self.base.chosen][:k], self.base.posterior
        return scale * posterior.mean[:k], scale * np.sqrt(np.diag(posterior.covariance)[:k])

    def with_effects(self, accepted: Sequence[Signature], library: Sequence[Signature]) -> DiagnosisProblem:
        """Problem with effects in the model. The noise of the responses on which they act is estimated again."""
        now = {id(s): s for s in accepted}
        before = {id(s): s for s in self.accepted}
        touched = {c for k in now.keys() ^ before.keys() for c in (now | before)[k].responses}
        known = self.noise.but_for(touched)
        return self._with_noise(_no_noise(library), known, accepted)

    def with_noise_without(self, forms: Sequence[Signature], library: Sequence[Signature]) -> DiagnosisProblem:
        """Problem with the noise that some forms leave, which are not in the library; estimated where they act.

        Parameters
        ----------
        forms : sequence of Signature
        library : sequence of Signature
            As for `set_up`.
        """
        known = self.noise.but_for({c for s in forms for c in s.responses})
        return self._with_noise([*forms, *_no_noise(library)], known, self.accepted)

    def _with_noise(self, others: Sequence[Signature], known: Noise, accepted: Sequence[Signature]) -> DiagnosisProblem:
        """Problem with effects in the model, and the noise that these and others leave where it is not known."""
        pool = _pool(self.flights, others, [c for c in self.responses if c not in known.log_std])
        return self._build(
            self.flights, self.nuisances, self.allowed, self.own, tuple(accepted), pool, self.base.groups, known
        )

    @classmethod
    def _build(
        cls,
        flights: tuple[Flight, ...],
        nuisances: list[Nuisance],
        allowed: Sequence[Spectra],
        own: Sequence[Spectra],
        accepted: tuple[Signature, ...],
        pool: Mapping[str, Array],
        groups: Sequence[tuple[int, ...]] | None,
        known: Noise | None = None,
    ) -> DiagnosisProblem:
        responses = flights[0].responses
        shared = allowed
        if accepted:
            shared = [
                join([(a, len(nuisances)), *((s.spectra[i], s.width) for s in accepted)], responses, bins_of(f))
                for i, (f, a) in enumerate(zip(flights, allowed))
            ]
        noise = estimate_noise(flights, shared, responses, pool, known)
        rows = [Rows.of(f, responses, noise, mine) for f, mine in zip(flights, own)]
        B = [r.whiten(mine) for r, mine in zip(rows, shared)]
        free = np.ones(B[0].shape[1] - len(nuisances))
        scales = np.array([[*(n.scale(fraction) for n in nuisances), *free] for fraction in _TOLERANCE_FRACTIONS])
        base = Base([r.difference() for r in rows], B, groups, scales)
        return cls(flights, responses, nuisances, allowed, own, accepted, noise, rows, base)

    def try_signatures(self, signatures: Sequence[Signature]) -> list[Trial]:
        """Evidence of each of several forms, in addition to the effects in the model."""
        made: dict[int, tuple[Further, ...]] = {}
        for same in group_by_width([s.width for s in signatures]):
            width, spectra = signatures[same[0]].width, zip(*(signatures[k].spectra for k in same))
            products = [r.against(x, width, given) for r, x, given in zip(self.rows, spectra, self._sparse)]
            made |= zip(same, zip(*products))
        return self.base.try_each([made[k] for k in range(len(signatures))])

    def products(self, m: int, several: Sequence[Spectra], width: int) -> list[Further]:
        """Products of each of several spectra of flight m with its rows."""
        return self.rows[m].against(several, width, self._sparse[m])

    @cached_property
    def _sparse(self) -> list[SparseRows]:
        """Rows of the tolerances, the effects in the model and the differences."""
        made = []
        for i, (r, allowed) in enumerate(zip(self.rows, self.allowed)):
            parts = [(allowed, len(self.nuisances)), *((s.spectra[i], s.width) for s in self.accepted)]
            made.append(r.without_zeros([*parts, (difference_spectra(r.flight), 1)]))
        return made

    @cached_property
    def held_out_residuals(self) -> list[tuple[Rows, Array]]:
        """Each flight that is held out, and its whitened rows minus their prediction from the other flights."""
        base = self.base
        return [
            (self.rows[m], base.residual(m, base.solved[g + 1])) for g, group in enumerate(base.groups) for m in group
        ]

    @cached_property
    def fitted_residuals(self) -> list[tuple[Rows, Array]]:
        """Each flight, and its whitened rows minus their fit to all flights."""
        mean = self.base.posterior.mean
        return [(r, self.base.residual(m, mean)) for m, r in enumerate(self.rows)]

    def with_effect(self, signature: Signature) -> DiagnosisProblem:
        """Problem with one more effect, and the same noise."""
        more = [r.whiten(s, signature.width) for r, s in zip(self.rows, signature.spectra)]
        return replace(self, accepted=(*self.accepted, signature), base=self.base.with_columns(more))

    @cached_property
    def as_given(self) -> DiagnosisProblem:
        """Problem with exact tolerances, except those that improve the prediction: timing of samples, constant errors.

        A delay or a constant that is estimated from few flights may increase the error of the next one.
        """
        sampling = tuple(j for j, n in enumerate(self.nuisances) if n.delivered)
        constants = tuple(j for j, n in enumerate(self.nuisances) if n.constant)
        # Where recordings share no constants, two of the four are the others again.
        each = dict.fromkeys([(*sampling, *constants), sampling, constants, ()])
        tried = [self._held_but(free) for free in each]
        return min(tried, key=lambda one: sum(float(left @ left) for _, left in one.held_out_residuals))

    def with_exceeded(self, tolerance: Nuisance, wider: float) -> DiagnosisProblem:
        """Problem as given, with one parameter free, whose prior is wider than its tolerance by a factor; the last."""
        given = {id(n) for n in self.as_given.nuisances} - {id(tolerance)}
        at = {id(n): j for j, n in enumerate(self.nuisances)}
        return self._held_but([*(at[k] for k in at if k in given), at[id(tolerance)]], wider)

    def _held_but(self, free: Sequence[int], wider: float = 1.0) -> DiagnosisProblem:
        """Problem with the chosen nuisance parameters free, the last of them by a wider prior, and the others exact."""
        k = len(self.nuisances)
        columns = [*free, *range(k, k + sum(s.width for s in self.accepted))]
        scales = np.ones((1, len(columns)))
        scales[0, len(free) - 1 : len(free)] = wider
        return replace(
            self,
            nuisances=[self.nuisances[j] for j in free],
            allowed=[{c: x[:, free] for c, x in a.items()} for a in self.allowed],
            base=self.base.select_columns(columns, scales),
        )

    def subset(self, kept: Sequence[int]) -> DiagnosisProblem:
        """Problem with some of its effects, in this order, and the same noise."""
        at = [self.place(k) for k in range(len(self.accepted))]
        columns = [*range(len(self.nuisances)), *(j for k in kept for j in range(at[k].start, at[k].stop))]
        return replace(self, accepted=tuple(self.accepted[k] for k in kept), base=self.base.select_columns(columns))

    def place(self, k: int) -> slice:
        """Columns of the k-th effect in the model."""
        start = len(self.nuisances) + sum(s.width for s in self.accepted[:k])
        return slice(start, start + self.accepted[k].width)


def join(parts: Sequence[tuple[Spectra, int]], responses: Sequence[str], bins: int) -> dict[str, Array]:
    """Spectra side by side; zeros where a part does not act on a response."""
    return {c: np.column_stack([p.get(c, np.zeros((bins + 1, k))) for p, k in parts]) for c in responses}


def _no_noise(library: Sequence[Signature]) -> list[Signature]:
    """Forms of a library that must not be counted as noise."""
    # The responses are computed from the readings of instruments: sensor errors would explain their noise as well.
    # Resonances would explain any narrow band of it.
    return [s for s in library if s.hypothesis.kind not in ("sensor", "structural")]


def _pool(flights: Sequence[Flight], signatures: Sequence[Signature], responses: Sequence[str]) -> dict[str, Array]:
    """Coefficients of effects that may be in the differences, by response, the flights one after another."""
    ends = np.cumsum([0, *map(bins_of, flights)])
    made = {}
    for c in responses:
        mine = [s for s in signatures if c in s.responses]
        columns = np.cumsum([0, *(s.width for s in mine)])
        made[c] = np.zeros((columns[-1], ends[-1])).T
        for j, s in zip(columns, mine):
            for n, spectra in zip(ends, s.spectra):
                if c in spectra:
                    x = spectra[c][1:]
                    made[c][n : n + len(x), j : j + s.width] = x
    return {c: x for c, x in made.items() if x.shape[1]}


def _widened(
    flights: Sequence[Flight], nuisances: Sequence[Nuisance], allowed: Sequence[Spectra], noise: Noise
) -> tuple[list[Nuisance], list[Spectra], set[str]]:
    """Tolerances of the simulation, widened for noise in the states, their spectra, and where they are clearly wider.

    A simulation that is evaluated at noisy states responds to the noise; the measured response does not. Every
    derivative then appears too large, by at most the ratio of noise power to simulated power.
    """
    made: list[dict[str, Array]] = [dict(a) for a in allowed]
    wider, changed = list(nuisances), set()
    for c in flights[0].simulated:
        power = sum(float(np.sum(noise.std(f, c, bins_of(f))[1:] ** 2)) for f in flights)
        simulated = sum(float(np.sum(spectrum(f.simulated[c], bins_of(f), edge_of(f))[1:] ** 2)) for f in flights)
        fraction = min(_LARGEST_WIDENING, power / simulated) if simulated > 0.0 else 0.0
        for j, n in enumerate(nuisances):
            if n.response == c and n.sd > 0.0:
                wider[j] = replace(n, sd=float(np.hypot(n.sd, fraction)), least=float(np.hypot(n.least, fraction)))
                for a in made:
                    a[c][:, j] *= wider[j].sd / n.sd
                if wider[j].sd > _CLEARLY_WIDER * n.sd:
                    changed.add(c)
    return wider, list(made), changed
