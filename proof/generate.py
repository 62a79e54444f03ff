"""From a seed to a case: the same seed gives the same case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from proof.case_files import Case
from proof.scenario.declared import DeclaredEffect, declare
from proof.scenario.errors import SEVERITIES
from proof.scenario.sizing import NotAttainable
from structsel import effects
from structsel.effects import Effect
from structsel.errors import AircraftError, SimulationError

_TRIES = 12
POLYNOMIAL = {"single": 0.54, "null": 0.20, "pair": 0.10, "outside": 0.08, "clutter": 0.08}
JSBSIM = {"single": 0.62, "pair": 0.12, "null": 0.14, "outside": 0.06, "clutter": 0.06}
"""How often each family is drawn."""
_AIMED = {"easy": 0.35, "medium": 0.4, "hard": 0.25}


def draw_case(
    seed: int,
    *,
    source: str = "polynomial",
    family: str | None = None,
    effect: str | None = None,
    severity: str | None = None,
    aircraft: str | None = None,
) -> Case:
    """Draw a case; what is not given is drawn.

    Parameters
    ----------
    seed : int
    source : {"polynomial", "jsbsim"}
        Plant of the truth.
    family : {"single", "pair", "null", "outside", "clutter"}, optional
    effect : str, optional
        Of a single.
    severity : {"easy", "medium", "hard"}, optional
        Intended; the key has the severity that was reached.
    aircraft : str, optional
        Of JSBSim.

    Raises
    ------
    SimulationError
        A dozen draws gave no case whose flights are possible and whose effect is large enough; or JSBSim is not
        installed.
    """
    rejected = (NotAttainable, SimulationError, AircraftError)
    last: Exception | None = None
    for attempt in range(_TRIES):
        try:
            if source == "jsbsim":
                return _jsbsim(seed, attempt, family, effect, severity, aircraft)
            return _polynomial(seed, attempt, family, effect, severity)
        except rejected as error:
            last = error
    raise SimulationError(
        f"seed {seed}: no {family or 'case'} {effect or ''} of {source} in {_TRIES} draws; the last: {last}"
    )


def declared_effects(library: Sequence[Effect] | None = None) -> tuple[DeclaredEffect, ...]:
    """Effects of structsel's library that declare their case; see `structsel.effects.TruthCase`.

    Raises
    ------
    DataError
        A declaration that neither plant can take.
    """
    known = effects.EFFECTS if library is None else library
    return tuple(declare(h.name, h.kind, h.truth) for h in known if h.truth is not None)


def drawable(source: str) -> frozenset[str]:
    """Effects for which a source has cases."""
    declared = {d.name for d in declared_effects()}
    if source == "jsbsim":
        from proof.jsbsim.effects_added import ADDED_FORCES
        from proof.jsbsim.effects_faults import FAULTS

        return frozenset({*ADDED_FORCES, *FAULTS, "gust", "wrong-derivative"} | declared)
    from proof.polynomial.cases import NAMES

    return frozenset({*NAMES} | declared)


def _polynomial(seed: int, attempt: int, family: str | None, effect: str | None, severity: str | None) -> Case:
    from proof.polynomial.cases import make

    rng = np.random.default_rng([seed, attempt, 11])
    drawn, aim = _choice(rng, POLYNOMIAL), _choice(rng, _AIMED)  # drawn even where given: the stream stays alike
    return make(
        "single" if effect else family or drawn, rng, seed, attempt, effect, severity or aim, declared_effects()
    )


def _jsbsim(
    seed: int, attempt: int, family: str | None, effect: str | None, severity: str | None, aircraft: str | None
) -> Case:
    from proof.jsbsim.aircraft import FLEET, JSBSimPlant
    from proof.jsbsim.cases import CaseBuilder

    rng = np.random.default_rng([seed, attempt, 0x5B])
    name = aircraft or str(rng.choice(FLEET))
    drawn: Any = family or _choice(rng, JSBSIM)
    aim: Any = severity or str(rng.choice(list(SEVERITIES)))
    return CaseBuilder(JSBSimPlant(name), drawn, aim, effect, seed, rng, declared_effects()).case()


def _choice(rng: np.random.Generator, probabilities: Mapping[str, float]) -> str:
    return str(rng.choice(list(probabilities), p=list(probabilities.values())))
