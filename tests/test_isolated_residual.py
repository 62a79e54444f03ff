"""A residual that lasts in one response alone is a mismatch without a name."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import structsel as ss
from structsel.diagnosis.detection import Detection, detect
from structsel.diagnosis.event import Event
from structsel.diagnosis.isolated import IsolatedResidual, find_isolated, lasting_residuals
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import with_detection
from structsel.recording import Recording
from tests.noisy_flights import flights_with

DT = 0.02
FLIGHT = SimpleNamespace(dt=DT, measured={c: np.sqrt(2.0) * np.sin(np.arange(50_000)) for c in ("CX", "CZ", "Cm")})


def test_a_wave_lasts_by_its_own_correlation_and_noise_hardly_does():
    t = np.arange(50_000) * DT
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(t.size)
    found = lasting_residuals(
        [FLIGHT], [{"CX": noise, "CZ": np.sin(2.0 * np.pi * 0.2 * t), "Cm": np.gradient(noise, DT)}]
    )
    # A mean over 0.3 s has the wave times a sine over its argument; 0.6 s later its correlation is a cosine.
    expected = np.sqrt(0.5 * np.cos(2.0 * np.pi * 0.2 * 0.6)) * np.sinc(0.2 * 0.3)
    assert found["CZ"] == pytest.approx(expected, rel=0.01)
    # A mean has 15 samples; by chance 3,300 independent means have a covariance of a few per cent of their variance.
    assert found["CX"] < 0.3 / np.sqrt(15)
    assert found["Cm"] < 0.05 * np.std(np.gradient(noise, DT))


@pytest.mark.parametrize(
    ("size", "others", "low", "high"),
    [
        (0.06, 0.010, 0.95, 1.0),  # alone
        (0.06, 0.020, 0.0, 0.5),  # others are not accurate
        (0.10, 0.030, 0.0, 0.05),
        (0.04, 0.016, 0.0, 0.05),  # as much as others may have
        (0.03, 0.000, 0.05, 0.3),  # little
    ],
)
def test_it_is_a_mismatch_where_it_is_large_beside_accurate_others(size, others, low, high):
    assert low <= IsolatedResidual("Cm", size, others).probability <= high


def test_it_is_of_the_unknown_as_far_as_the_effects_do_not_explain_it():
    alone = IsolatedResidual("Cm", 0.1, 0.0)
    assert replace(alone, fraction=0.2).probability == pytest.approx(0.2 * alone.probability)


def slow(size: float) -> np.ndarray:
    return size * np.sin(np.arange(50_000) * DT)


def test_the_response_that_lasts_most_is_alone_among_three_coefficients():
    moment = find_isolated([FLIGHT], [{"CX": slow(0.01), "CZ": slow(0.005), "Cm": slow(0.1)}], {})
    assert moment is not None
    assert moment.response == "Cm"
    assert moment.others == 0.0  # far less than the noise of the forces
    assert moment.expected == 0.0
    assert find_isolated([FLIGHT], [{"CZ": slow(0.01), "Cm": slow(0.1)}], {}) is None


WHITE = 0.1  # of a force that varies by one


def as_lasting_as_noise() -> np.ndarray:
    """A slow wave whose lasting part is the white noise."""
    return slow(WHITE / np.sqrt(0.5 * np.cos(0.6)) / np.sinc(0.3 / (2.0 * np.pi)))


def noisy_forces(white: float = WHITE) -> SimpleNamespace:
    """A flight whose forces vary slowly by one, with white noise."""
    rng = np.random.default_rng(2)
    wave = np.sqrt(2.0) * np.sin(0.01 * np.arange(50_000))
    forces = {c: wave + white * rng.standard_normal(wave.size) for c in ("CX", "CY", "CZ")}
    return SimpleNamespace(dt=DT, measured={**forces, "Cm": wave})


@pytest.mark.parametrize(
    ("response", "size", "beside", "low", "high"),
    [
        ("CX", 0.6, 0.0, 0.0, 0.05),  # as much as accelerometers may have
        ("CX", 1.2, 0.0, 0.95, 1.0),
        ("CX", 1.2, 0.15, 0.85, 1.0),  # the other accelerometer has a little
        ("CZ", 1.2, 0.0, 0.0, 0.05),  # as much as the noise of alpha may have
        ("CZ", 2.5, 0.0, 0.95, 1.0),
    ],
)
def test_a_force_is_alone_beyond_what_its_instruments_may_have(response, size, beside, low, high):
    """`size` and `beside` (of CY): lasting residual over white noise."""
    unit = as_lasting_as_noise()
    left = {"CX": 0.0 * unit, "CZ": 0.0 * unit, "Cm": 0.0 * unit, "CY": beside * unit, response: size * unit}
    found = find_isolated([noisy_forces()], [left], {})
    assert found is not None
    assert found.response == response
    assert found.size == pytest.approx(size * WHITE, rel=0.02)
    assert found.expected == pytest.approx((beside + {"CX": 0.75, "CZ": 1.75}[response]) * WHITE, rel=0.05)
    assert low <= found.probability <= high


def test_the_form_of_a_simulation_may_leave_a_residual_that_lasts():
    left = [{"CX": slow(0.01), "CZ": slow(0.005), "Cm": slow(0.1)}]
    moment = find_isolated([FLIGHT], left, {"Cm": 0.07})
    assert moment is not None
    assert moment.expected == 0.07
    assert moment.probability < 0.05
    inexact = find_isolated([FLIGHT], left, {"CX": 0.05})
    assert inexact is not None
    assert (inexact.others, inexact.expected) == (0.05, 0.0)
    assert inexact.probability < 0.01


def test_usual_noise_of_the_other_instruments_does_not_count():
    unit = as_lasting_as_noise()
    quiet, loud = (
        find_isolated([noisy_forces()], [{"CX": x * unit, "CY": 0.0 * unit, "CZ": 0.0 * unit, "Cm": unit}], {})
        for x in (0.3, 0.7)
    )
    assert quiet is not None
    assert loud is not None
    assert quiet.others == 0.0
    assert quiet.probability > 0.95
    assert loud.others > 0.05
    assert loud.probability < 0.01


def test_a_force_that_holds_its_values_is_not_judged():
    held = noisy_forces()
    held.measured["CX"] = np.repeat(held.measured["CX"][::10], 10)
    found = find_isolated([held], [{"CX": slow(0.5), "CZ": slow(0.0), "Cm": slow(0.0)}], {})
    assert found is not None
    assert found.expected == np.inf
    assert found.probability < 0.01


@pytest.mark.parametrize(("response", "size"), [("Cm", 0.15), ("CX", 0.5)])
def test_a_periodic_response_is_detected_and_a_correct_simulation_has_none(response, size):
    correct = flights_with({}, speeds=(40.0, 45.0, 50.0, 55.0), h=(1000.0,) * 4)
    alone = detect(correct, DiagnosisProblem.set_up(correct, ()))
    assert alone.isolated is None or alone.isolated.probability < 0.05
    wave = [np.sin(2.0 * np.pi * 0.37 * f.t) * size * f.measured[response].std() for f in correct]
    forced = [replace(f, measured={**f.measured, response: f.measured[response] + w}) for f, w in zip(correct, wave)]
    found = detect(forced, DiagnosisProblem.set_up(forced, ()))
    assert found.isolated is not None
    assert (found.axes, found.event) == ((response,), ())
    assert found.probability > 0.9
    assert found.probability_by_rows < 0.5
    assert found.says.startswith(f"The residual of {response} lasts as that of no other response does: ")


def test_a_periodic_force_is_unknown_and_its_residual_is_not_called_white():
    recordings, aircraft, truth = ss.demo_flights(4, turbulence=0.0)
    forced = []
    for r in recordings:
        channels = {c: r[c] for c in r.names if c != "t"}
        channels["ax"] = channels["ax"] + 0.15 * np.sin(2.0 * np.pi * 0.37 * r.t)
        forced.append(Recording(r.name, r.t, channels))
    found = ss.diagnose(ss.AeroModel.from_terms(truth), forced, aircraft)
    assert [(f.effect, f.axes) for f in found.findings] == [("unknown", ("CX",))]
    assert found.findings[0].probability > 0.9
    assert [c for c, (_, white) in found.remaining.items() if not white] == ["CX"]


def test_its_probability_is_that_of_unknown():
    seen = Detection((), {"Cm": -5.0}, [(-3.0, Event("m", 2.0, 0.5, "step"))], (), IsolatedResidual("Cm", 0.08, 0.01))
    p = with_detection({"nothing": 0.8, "gust": 0.2}, seen, (), {"gust"})
    assert p["gust"] == 0.2
    assert p["unknown"] == pytest.approx(0.8 * seen.probability)
    assert sum(p.values()) == pytest.approx(1.0)
