"""Shapes of effects are found between the values of the library, with their standard errors."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

import structsel as ss
from structsel.comparison.preparing import prepare
from structsel.diagnosis.diagnose import set_up
from structsel.diagnosis.reshaping import reshape
from structsel.diagnosis.scoring import score_all
from structsel.effects import EFFECTS

FREQUENCY, DAMPING = 0.71, 0.05  # Hz, -; neither is in the library
WIDTH = 0.013  # rad


def swinging(flight):
    """Force of a mass on a spring, by the side force that moves it; in equilibrium at the start."""
    w, force, t = 2.0 * np.pi * FREQUENCY, flight.forces[1], flight.t - flight.t[0]
    moved = scipy.signal.lsim(([w**2], [1.0, 2.0 * DAMPING * w, w**2]), force - force[0], t)[1]
    return {"CY": 0.1 * (force[0] + moved)}


def with_play(flight):
    """Pitching moment that a dead play of the elevator takes away."""
    surface = np.empty(len(flight.t))
    surface[0] = flight["de"][0]
    for k in range(1, len(surface)):
        surface[k] = np.clip(surface[k - 1], flight["de"][k] - 0.5 * WIDTH, flight["de"][k] + 0.5 * WIDTH)
    return {"Cm": flight.slope("Cm", "de") * (surface - flight["de"])}


@pytest.mark.parametrize(
    ("effect", "lacking", "truth"),
    [
        ("slosh", swinging, {"frequency": FREQUENCY, "damping": DAMPING}),
        ("backlash", with_play, {"width": WIDTH}),
    ],
)
def test_shapes_are_found_between_those_of_the_library(effect, lacking, truth):
    recordings, aircraft, model = ss.demo_flights(3, turbulence=0.0)
    flights = []
    for f in prepare(ss.AeroModel.from_terms(model), recordings, aircraft, aligned=True).flights:
        added = lacking(f)
        flights.append(replace(f, measured={c: x + added.get(c, 0.0) for c, x in f.measured.items()}))
    problem, library, _ = set_up(flights, [e for e in EFFECTS if e.name == effect])
    (before,) = score_all(problem, library)
    (after,) = reshape(problem, [before])
    assert after.log_evidence > before.log_evidence + 10.0
    form = after.signature.variant
    for name, value in truth.items():
        assert abs(form.shape[name] - value) < 3.0 * form.spread[name] < 0.3 * value
        assert abs(form.shape[name] - value) < 0.3 * abs(before.signature.variant.shape[name] - value)
    assert form.searched > 0.0


def test_a_form_with_the_values_of_its_shape_is_itself_and_with_others_has_those():
    recordings, aircraft, model = ss.demo_flights(2, turbulence=0.0)
    flights = prepare(ss.AeroModel.from_terms(model), recordings, aircraft, aligned=True).flights
    seen = set()
    for effect in EFFECTS:
        forms = [] if effect.needs(flights) else [v for v in effect.variants(flights) if v.again is not None]
        # Of forms that differ by their values only, one is enough.
        for form in {v.about: v for v in forms}.values():
            seen.add(effect.name)
            same, other = (form.again(*(x * by for x in form.shape.values())) for by in (1.0, 1.03))
            assert (same.about, same.parameters, same.words) == (form.about, form.parameters, form.words)
            before, after = form.columns(flights[0]), same.columns(flights[0])
            assert {c: x.tolist() for c, x in before.items()} == {c: x.tolist() for c, x in after.items()}
            assert other.shape == pytest.approx({name: 1.03 * x for name, x in form.shape.items()})
    assert seen >= {"slosh", "structural-mode", "backlash", "actuator-saturation", "actuator-rate-limit"}


def test_a_simulation_without_a_side_force_has_forms_of_slosh():
    recordings, aircraft, model = ss.demo_flights(2, turbulence=0.0)
    longitudinal = ss.AeroModel.from_terms({c: model[c] for c in ("CX", "CZ", "Cm")})
    flights = prepare(longitudinal, recordings, aircraft, aligned=True).flights
    assert not flights[0].forces[1].any()
    (slosh,) = (e for e in EFFECTS if e.name == "slosh")
    assert all(np.isfinite([p.sd for p in form.parameters]).all() for form in slosh.variants(flights))
