"""Effects missing from a simulation of a real plant: cases of benchmarks/real_recordings.py that are diagnosed."""

from pathlib import Path

import pytest

from tests.benchmark_modules import load_benchmark

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings (../shared/data) are not here"),
]


real = load_benchmark("real_recordings")


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
