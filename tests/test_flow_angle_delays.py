"""Delays of the flow angles are found from accelerometers and gyros, and removed before effects are sought."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import structsel as ss
from structsel.comparison.flight import Flight, prepare_flight
from structsel.comparison.flow_angle_delays import find_flow_angle_delays
from structsel.comparison.preparing import prepare
from structsel.demo import demo_flights, demo_missing_physics
from structsel.recording import Recording
from tests.benchmark_modules import load_benchmark
from tests.models import DEMO

DATA = Path(__file__).parents[2] / "shared" / "data"
DELAY = 0.2  # s


def late(recording: Recording, delay: float, *angles: str) -> Recording:
    """Angles read later."""
    changed = {c: np.interp(recording.t - delay, recording.t, recording[c]) for c in angles}
    return replace(recording, channels={**recording.channels, **changed}, findings=())


def flown(recordings: list[Recording], aircraft: ss.Aircraft) -> list[Flight]:
    return [prepare_flight(r, aircraft, {"CZ": np.zeros(len(r))}) for r in recordings]


@pytest.fixture(scope="module")
def calm() -> tuple[list[Recording], ss.Aircraft]:
    recordings, aircraft, _ = demo_flights(4, 5, turbulence=0.0)
    return recordings, aircraft


@pytest.mark.parametrize("delay", [0.1, DELAY, -0.1])
def test_a_delay_of_both_vanes_is_found_within_a_hundredth_of_a_second(calm, delay):
    recordings, aircraft = calm
    found = find_flow_angle_delays(flown([late(r, delay, "alpha", "beta") for r in recordings], aircraft))
    assert {d.channel for d in found} == {"alpha", "beta"}
    assert all(d.probability > 0.95 for d in found)
    assert all(abs(d.delay - delay) < 0.01 for d in found)


def test_a_delay_of_one_sample_is_removed_and_is_no_finding(calm):
    recordings, aircraft = calm
    found = find_flow_angle_delays(flown([late(r, 0.02, "alpha", "beta") for r in recordings], aircraft))
    assert {d.channel for d in found} == {"alpha", "beta"}
    assert all(abs(d.delay - 0.02) < 0.004 for d in found)
    assert all(d.probability > 0.9 and d.beyond_sampling < 0.1 for d in found)


def test_a_delay_of_two_samples_is_a_finding(calm):
    recordings, aircraft = calm
    found = find_flow_angle_delays(flown([late(r, 0.04, "alpha") for r in recordings], aircraft))
    assert [d.channel for d in found if d.beyond_sampling > 0.9] == ["alpha"]


def test_a_late_gyro_does_not_make_the_angle_of_attack_early(calm):
    recordings, aircraft = calm
    found = find_flow_angle_delays(flown([late(r, 0.06, "q") for r in recordings], aircraft))
    assert all(d.probability < 0.1 for d in found)


def test_the_delay_of_one_vane_is_not_one_of_the_other(calm):
    recordings, aircraft = calm
    found = find_flow_angle_delays(flown([late(r, DELAY, "alpha") for r in recordings], aircraft))
    assert [d.channel for d in found if d.probability > 0.5] == ["alpha"]


def test_without_a_delay_none_is_probable(calm):
    assert all(d.probability < 0.05 for d in find_flow_angle_delays(flown(*calm)))


@pytest.mark.parametrize("turbulence", [1.0, 3.0])
def test_gusts_that_show_before_the_motion_are_no_delay(turbulence):
    recordings, aircraft, _ = demo_flights(4, 6, turbulence=turbulence)
    assert all(d.probability < 0.05 for d in find_flow_angle_delays(flown(recordings, aircraft)))


def with_vane(aircraft: ss.Aircraft, x: float, stated: bool) -> ss.Aircraft:
    """The aircraft with its vane stated to be elsewhere, or not stated."""
    content = aircraft.to_dict()
    there = aircraft.position("vane")
    content["sensors"]["vane"]["position"] = [there[0] + x, there[1], there[2]]
    if not stated:
        del content["sensors"]["vane"]
    return ss.Aircraft.from_dict(content)


@pytest.mark.parametrize("x", [-4.0, -1.0, 1.0, 4.0])
def test_a_vane_that_stands_elsewhere_is_no_delay(calm, x):
    recordings, aircraft = calm
    assert all(d.probability < 0.05 for d in find_flow_angle_delays(flown(recordings, with_vane(aircraft, x, True))))


def test_a_vane_whose_place_is_not_stated_is_no_delay(calm):
    recordings, aircraft = calm
    found = find_flow_angle_delays(flown(recordings, with_vane(aircraft, 0.0, False)))
    assert all(d.probability < 0.1 for d in found)  # weak evidence of both; one in eight before


def test_a_diagnosis_removes_the_delay_first_and_then_finds_the_effect():
    case = demo_missing_physics("cross-coupling", flights=4)
    plain = ss.diagnose(case.simulated, case.recordings, case.aircraft)
    delayed = [late(r, DELAY, "alpha", "beta") for r in case.recordings]
    # A simulation of the forces along the flights does not depend on the readings.
    found = ss.diagnose(case.simulated, delayed, case.aircraft)
    assert found.findings[0].effect == plain.findings[0].effect == "cross-coupling"
    assert found.findings[0].probability == pytest.approx(plain.findings[0].probability, abs=0.1)
    assert any("delay of the angle of attack by 0.2" in remark for remark in found.remarks)


def test_a_simulation_evaluated_at_delayed_readings_has_a_delay_as_finding(calm):
    recordings, aircraft = calm
    found = ss.diagnose(DEMO, [late(r, DELAY, "alpha") for r in recordings], aircraft)
    assert found.findings[0].effect == "sensor-delay"
    assert found.findings[0].physics[0].parameters["delay of alpha"].value == pytest.approx(DELAY, abs=0.01)


def test_a_delay_that_may_not_be_named_is_removed_without_a_finding(calm):
    recordings, aircraft = calm
    delayed = [late(r, DELAY, "alpha") for r in recordings]
    found = ss.diagnose(DEMO, delayed, aircraft, without_effects=["sensor-delay"])
    assert "sensor-delay" not in {p.effect for f in found.findings for p in f.physics}
    assert any("delay of the angle of attack by 0.2" in remark for remark in found.remarks)


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings (../shared/data) are not here")
def test_hfb_320_has_a_delay_that_a_model_from_its_own_recordings_has_too():
    case = load_benchmark("real_recordings").hfb320_drag()
    made = prepare(case.simulation, case.recordings, case.aircraft, aligned=True)
    assert not made.delays
    assert any("which the simulation has too" in remark for remark in made.remarks)


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings (../shared/data) are not here")
@pytest.mark.parametrize("delay", [0.1, 0.25])
def test_at_the_boom_of_attas_a_delay_is_found_where_one_was_put_in_and_none_in_place_of_the_boom(delay):
    real = load_benchmark("real_recordings")
    case, unstated = real.attas_correct(), real.attas_vane()
    (alpha, _) = find_flow_angle_delays(
        flown([late(r, delay, "alpha", "beta") for r in case.recordings], case.aircraft)
    )
    assert alpha.probability > 0.95
    assert alpha.delay == pytest.approx(delay, abs=0.02)
    assert all(d.probability < 0.05 for d in find_flow_angle_delays(flown(case.recordings, case.aircraft)))
    assert all(d.probability < 0.05 for d in find_flow_angle_delays(flown(unstated.recordings, unstated.aircraft)))


@pytest.mark.parametrize("angles", [("alpha",), ("beta",), ("alpha", "beta")])
def test_reconstruct_estimates_a_delay_and_does_not_take_it_for_a_wrong_sign(calm, angles):
    recordings, aircraft = calm
    for recording in recordings[:2]:
        found = ss.reconstruct(late(recording, DELAY, *angles), aircraft, delays="estimate")
        assert found.verdict == "trusted"
        assert all(abs(d.delay) < 0.005 for d in found.delays if d.channel in angles)  # what is left of it
