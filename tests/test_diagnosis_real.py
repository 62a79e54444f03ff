"""Effects missing from a simulation of a real plant: cases of benchmarks/real_recordings.py that are diagnosed."""

import subprocess
import sys
from pathlib import Path

import pytest

import structsel as ss
from tests.benchmark_modules import load_benchmark

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings (../shared/data) are not here"),
]


real = load_benchmark("real_recordings")
wrong = load_benchmark("errors_in_real_recordings")


@pytest.mark.parametrize(
    ("name", "effect", "response", "left"),
    [
        ("silverbox", "stiffening", "output", 0.1),
        ("boucwen", "mechanical-hysteresis", "place", 0.5),
        ("gtm_stall", "static-stall", "CZ", 0.3),
        ("hfb320_drag", "drag-polar", "CX", 0.3),
    ],
)
def test_effects_missing_from_a_linear_simulation_are_named_and_reduce_the_error(name, effect, response, left):
    _, found = real.run(name)
    first, *_, last = [found.findings[0], *(f for f in found.findings if f.kind != "random")]
    assert found.verdict == "mismatch"
    assert first.effect == effect
    assert first.physics[0].probability == max(p.probability for p in first.physics) > 0.3
    bars = (last if response in last.bars else first).bars[response]
    assert bars.physics.rrmse < left * bars.delivered.rrmse


@pytest.mark.parametrize(
    "name", ["crazyflie_correct", "silverbox_correct", "boucwen_correct", "gtm_correct", "hfb320_correct"]
)
def test_what_has_its_own_model_is_within_tolerances(name):
    _, found = real.run(name)
    assert found.verdict == "consistent"
    assert not found.findings


@pytest.mark.parametrize("error", ["Cm_de halved", "no Cm_q", "thrust times 0.7"])
def test_an_error_that_is_put_into_a_model_of_a_real_flight_has_its_name(error):
    change, accept = wrong.ERRORS[error]
    case = change(wrong.hfb320())
    found = ss.diagnose(case.simulated(), case.recordings, case.aircraft)
    assert found.findings[0].effect in accept


@pytest.mark.parametrize("name", ["uav_ground", "uav_ground_second", "uav_airspeed", "uav_airspeed_second"])
def test_the_wind_of_a_windy_day_is_found_in_what_a_simulation_in_still_air_states(name):
    _, found = real.run(name)
    first = found.findings[0]
    assert first.effect == "steady-wind"
    north = first.physics[0].parameters["north"]
    assert abs(north.value + 1.8) < 3.0 * north.std  # the mean of what remains over the ground


@pytest.mark.parametrize("name", ["uav_ground_correct", "uav_ground_second_correct"])
def test_with_the_wind_of_the_day_the_simulation_is_correct(name):
    _, found = real.run(name)
    assert found.verdict == "consistent"


@pytest.fixture(scope="module")
def citation(tmp_path_factory):
    """Cases cut from one flight, each in two ways."""
    folder = tmp_path_factory.mktemp("citation")
    subprocess.run([sys.executable, str(DATA / "citation-flight" / "make_case.py"), str(folder)], check=True)
    return folder


@pytest.mark.parametrize(
    ("case", "accepted", "response"),
    [
        ("cg-30s", {"cg-shift"}, "Cm"),
        ("cg-60s", {"cg-shift"}, "Cm"),
        ("stall-30s", {"stall-hysteresis", "static-stall"}, "CZ"),
        ("stall-60s", {"stall-hysteresis", "static-stall"}, "CZ"),
        ("flaps-60s", {"configuration-change"}, "CZ"),
    ],
)
def test_what_happened_in_a_flight_is_named_however_it_was_cut(citation, case, accepted, response):
    folder = citation / case
    recordings = ss.read_recordings(folder / "recordings")
    found = ss.diagnose(folder / "simulated", recordings, ss.Aircraft.from_toml(folder / "aircraft.toml"))
    assert found.verdict == "mismatch"
    assert found.findings[0].effect in accepted
    assert response in found.findings[0].axes
