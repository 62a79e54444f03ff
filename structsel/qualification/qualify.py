"""qualify(): proof of match of a simulation, manoeuvre by manoeuvre, with the tolerances of 14 CFR part 60."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ModelError, SimulationError
from structsel.model import AeroModel
from structsel.nomenclature import LATERAL_OUTPUTS, LONGITUDINAL_OUTPUTS, suggest
from structsel.numerics.oscillations import Oscillation, fit_oscillation
from structsel.qualification.manoeuvre_kinds import MEASURED, ManoeuvreKind, classify, split_by_input
from structsel.qualification.result import (
    AFTER,
    BEFORE,
    ParameterCheck,
    Qualification,
    QualificationTest,
    history_check,
    value_check,
)
from structsel.qualification.tolerances import TESTS, ObjectiveTest
from structsel.recording import Recording, require_recordings
from structsel.recording.arguments import as_recordings, require_kind
from structsel.simulation import Atmosphere, trim
from structsel.validation import resimulate

_OUTPUTS = (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS, "h")
_FEWEST = 20  # samples of a manoeuvre
_OSCILLATING = {"phugoid": ("V",), "dutch-roll": ("r", "beta", "phi")}
_NONE = "none"


def qualify(
    model: AeroModel,
    aircraft: Aircraft,
    recordings: Recording | Sequence[Recording],
    *,
    corrected: AeroModel | None = None,
    kinds: Mapping[str, str] | None = None,
    air: Atmosphere | None = None,
    definitions: Mapping[str, str] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Qualification:
    """Compare simulations with recorded manoeuvres within the tolerances for flight simulators.

    A recording with several inputs is divided at their starts. Each manoeuvre is simulated from its first recorded
    state with the recorded inputs, and taken for the test that its controls and its free motion suit: trim, short
    period, phugoid, roll response, rudder response, Dutch roll, change of power, flap or gear. Time histories pass if
    every sample is within the tolerance; period and damping are measured from the free motion, recorded and simulated.

    Parameters
    ----------
    model : AeroModel
    aircraft : Aircraft
        With mass and inertia.
    recordings : Recording or sequence of Recording
        With the inputs of the model, and V, alpha, theta and h.
    corrected : AeroModel, optional
        The model after a correction, such as that of `diagnose`.
    kinds : mapping of str to str, optional
        Kind of a manoeuvre by its name, in place of the one that is found; ``"none"`` for no test.
    air, definitions
        As `structsel.simulation.simulate` takes them.
    progress : callable, optional
        Called with the name of the manoeuvre, manoeuvres done and manoeuvres in all.

    Returns
    -------
    Qualification

    Raises
    ------
    ArgumentError
        The models, the aircraft or the recordings are objects of another type.
    ModelError
        A kind that does not exist, or of a manoeuvre that does not exist.
    ChannelError, DataError, AircraftError
        As `structsel.resimulate`.

    References
    ----------
    [FSTD].
    """
    call = "qualify(model, aircraft, recordings)"
    require_kind(model, AeroModel, call)
    require_kind(aircraft, Aircraft, call)
    if corrected is not None:
        require_kind(corrected, AeroModel, call, "corrected model")
    flights = as_recordings(recordings, call)
    require_recordings(flights, samples=_FEWEST, by="qualify")
    parts = [part for flight in flights for part in split_by_input(flight) if len(part[0]) >= _FEWEST]
    _check_kinds(kinds or {}, [part.name for part, _ in parts])
    models = {BEFORE: model} if corrected is None else {BEFORE: model, AFTER: corrected}
    tests, doubts = [], []
    for count, (part, movement) in enumerate(parts):
        found = classify(part, movement)
        if wanted := (kinds or {}).get(part.name):
            found = ManoeuvreKind("" if wanted == _NONE else wanted, "stated by the user", found.free)
        shown = tuple(name for name in _OUTPUTS if name in part)
        simulated, checks = {}, {}
        for stage, one in models.items():
            result = resimulate(
                one, aircraft, part, outputs=shown, window=part.duration + part.dt, air=air, definitions=definitions
            )
            simulated[stage] = result.whole[0]
            doubts += [f"{stage}: {text}" for text in one.identification_warnings([part])]
            options = {"air": air, "definitions": definitions}
            checks[stage] = _checks(found, part, result.whole[0], one, aircraft, options)
        tests.append(QualificationTest(part.name, found.kind, found.why, found.free, part, simulated, checks))
        if progress is not None:
            progress(part.name, count + 1, len(parts))
    name = model.name or "model"
    after = "" if corrected is None else corrected.name or "corrected model"
    return Qualification(name, after, tuple(tests), tuple(dict.fromkeys(doubts)))


def _check_kinds(kinds: Mapping[str, str], names: Sequence[str]) -> None:
    for name, kind in kinds.items():
        if name not in names:
            raise ModelError(
                f"qualify has no manoeuvre '{name}'.{suggest(name, names)}\nManoeuvres: {', '.join(names)}."
            )
        if kind not in TESTS and kind != _NONE:
            raise ModelError(
                f"qualify has no test '{kind}'.{suggest(kind, TESTS)}\nTests: {', '.join(TESTS)}, {_NONE}."
            )


def _checks(
    found: ManoeuvreKind,
    recorded: Recording,
    simulated: Recording,
    model: AeroModel,
    aircraft: Aircraft,
    options: Mapping[str, object],
) -> tuple[ParameterCheck, ...]:
    """Check of each parameter of the test."""
    test = TESTS.get(found.kind)
    if test is None:
        return ()
    if test.how == "history":
        return tuple(
            history_check(g, one, recorded[one.parameter], simulated[one.parameter])
            for g, group in enumerate(test.tolerances)
            for one in group
            if one.parameter in recorded and one.parameter in simulated
        )
    if found.kind == "trim":
        values = _trim_values(recorded, model, aircraft, options)
    else:
        values = [_measures(r, found) for r in (recorded, simulated)]
    return _value_checks(test, *values)


def _value_checks(
    test: ObjectiveTest, recorded: Mapping[str, float], simulated: Mapping[str, float]
) -> tuple[ParameterCheck, ...]:
    return tuple(
        value_check(g, one, recorded.get(one.parameter, math.nan), simulated.get(one.parameter, math.nan))
        for g, group in enumerate(test.tolerances)
        for one in group
    )


def _trim_values(
    recorded: Recording, model: AeroModel, aircraft: Aircraft, options: Mapping[str, object]
) -> list[dict[str, float]]:
    """Means of the recording, and the trim of the model at the same airspeed, altitude and climb angle."""
    mean = {name: float(np.mean(recorded[name])) for name in recorded.names}
    wanted = ("de", "theta", "thrust")
    climb = mean["theta"] - mean["alpha"]
    # Lateral controls are those of the recording, so that only the longitudinal equations are solved for.
    held = {name: mean[name] for name in ("df", "gear") if name in mean}
    try:
        found = trim(model, aircraft, mean["V"], mean["h"], climb=climb, controls=held, **options)  # type: ignore[arg-type]
        simulated = {name: float(found[name]) for name in wanted if name in found.to_dict()}
    except SimulationError:
        simulated = {}
    return [{name: mean[name] for name in wanted if name in mean}, simulated]


def _measures(recording: Recording, found: ManoeuvreKind) -> dict[str, float]:
    """Period, time to half amplitude, damping and delay of the peaks, from the free motion; empty if not measured."""
    rows = recording.t >= found.free
    names = [name for name in _OSCILLATING[found.kind] if name in recording]
    if not names or not rows.any():
        return {}
    fit = fit_oscillation(recording.t[rows], np.column_stack([recording[name][rows] for name in names]))
    if fit is None or fit.r2 < MEASURED:
        return {}
    values = {"period": fit.period, "half_time": fit.half_time, "damping": fit.damping}
    if {"phi", "beta"} <= set(names):
        values["peak_delay"] = _peak_delay(fit, names.index("phi"), names.index("beta"))
    return values


def _peak_delay(fit: Oscillation, phi: int, beta: int) -> float:
    """Time from a peak of sideslip to that of bank [s], within half a period."""
    angle = fit.phases[phi] - fit.phases[beta]
    return float(np.angle(np.exp(1j * angle)) / fit.omega)
