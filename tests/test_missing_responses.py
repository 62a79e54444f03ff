"""A simulated model that lacks a coefficient is named once, with the assumption and the remedy."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel import AeroModel, demo_flights, linearise, refine, simulate, trim
from structsel.errors import StructselWarning
from structsel.numerics.atmosphere import G0
from structsel.simulation.missing_responses import missing_responses
from tests.commands import code_blocks, run
from tests.models import DEMO, model_of

_, AIRCRAFT, _ = demo_flights()
LIFT_AND_PITCH = AeroModel({name: DEMO[name] for name in ("CZ", "Cm")}, "mine")
CX_IS_MISSING = (
    "Model 'mine' has no CX: its motion is computed with zero axial force, so trim and flight are not those of the "
    "aircraft. Select CX too, or add it to the model."
)


def warned(function):
    """Result of a function, and the messages of its warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = function()
    return result, [str(one.message) for one in caught if issubclass(one.category, StructselWarning)]


def level(model):
    return trim(model, AIRCRAFT, 45.0, 600.0, free=["de", "thrust"])


def test_a_trim_without_cx_names_it_and_its_thrust_is_that_of_the_weight_alone():
    found, said = warned(lambda: level(LIFT_AND_PITCH))
    assert said == [CX_IS_MISSING]
    # Along body x only thrust and weight are left: T cos(inclination) = m g sin(theta).
    along_x = found["thrust"] * AIRCRAFT.thrust.direction[0]
    assert_allclose(along_x, AIRCRAFT.mass * G0 * np.sin(found["theta"]), rtol=1e-6)
    complete, said = warned(lambda: level(AeroModel({name: DEMO[name] for name in ("CX", "CZ", "Cm")})))
    assert said == []
    assert found["thrust"] > 1.8 * complete["thrust"]


def test_simulation_and_linear_model_say_the_same_once_each():
    start, _ = warned(lambda: level(LIFT_AND_PITCH))
    _, said = warned(lambda: simulate(LIFT_AND_PITCH, AIRCRAFT, start.inputs(np.arange(0.0, 1.0, 0.1)), start=start))
    assert said == [CX_IS_MISSING]
    _, said = warned(lambda: linearise(LIFT_AND_PITCH, AIRCRAFT, start))
    assert said == [CX_IS_MISSING]


def test_a_linear_model_needs_the_coefficients_of_its_axis_only():
    start, _ = warned(lambda: trim(DEMO, AIRCRAFT, 45.0, 600.0))
    lateral = AeroModel({name: DEMO[name] for name in ("CZ", "CY", "Cl", "Cn")})
    assert warned(lambda: linearise(lateral, AIRCRAFT, start, axis="lateral"))[1] == []
    (said,) = warned(lambda: linearise(LIFT_AND_PITCH, AIRCRAFT, start, axis="lateral"))[1]
    assert "has no CY, Cl and Cn: its motion is computed with zero side force, rolling moment and yawing" in said


@pytest.mark.parametrize(
    ("held", "lateral", "missing"),
    [
        (("CX", "CZ", "Cm"), False, ()),
        (("CX", "CZ", "Cm"), True, ("CY", "Cl", "Cn")),
        (("CX", "CZ", "Cm", "Cl"), False, ("CY", "Cn")),
        (("CL", "Cm"), False, ("CD",)),
        (("CL", "CD", "Cm"), False, ()),
        (("CY", "Cl", "Cn"), False, ("CX", "CZ", "Cm")),
        (("CX", "CY", "CZ", "Cl", "Cm", "Cn"), True, ()),
    ],
)
def test_what_is_missing_is_what_the_motion_depends_on(held, lateral, missing):
    assert missing_responses(model_of({name: {"alpha": 0.1} for name in held}), lateral=lateral) == missing


def test_a_start_with_sideslip_needs_the_lateral_coefficients():
    straight = {"V": 45.0, "alpha": 0.1, "theta": 0.1, "h": 600.0}
    three = AeroModel({name: DEMO[name] for name in ("CX", "CZ", "Cm")}, "three")
    inputs = {"t": np.arange(0.0, 1.0, 0.1), "de": 0.0, "dr": 0.0, "thrust": 1600.0}
    assert warned(lambda: simulate(three, AIRCRAFT, inputs, start=straight, outside="ignore"))[1] == []
    (said,) = warned(lambda: simulate(three, AIRCRAFT, inputs, start={**straight, "beta": 0.1}, outside="ignore"))[1]
    assert said.startswith("Model 'three' has no CY, Cl and Cn: ")


def test_a_refinement_of_a_model_without_cx_warns():
    recordings, aircraft, _ = demo_flights()
    found = refine(LIFT_AND_PITCH, aircraft, recordings[0], free=["Cm:1"], outputs=["alpha", "q"])
    assert found.doubts[0] == CX_IS_MISSING


def test_the_command_warns_once_for_trim_modes_and_simulation(tmp_path):
    LIFT_AND_PITCH.to_json(tmp_path / "model.json")
    AIRCRAFT.to_toml(tmp_path / "aircraft.toml")
    asked = ("simulate", tmp_path / "model.json", "--aircraft", tmp_path / "aircraft.toml", "--trim", "45,600")
    result = run(*asked, "--modes", "--free", "de,thrust")
    assert re.sub(r"\s+", " ", result.stderr).strip() == f"warning: {CX_IS_MISSING}"


def test_the_sequence_of_the_readme_selects_what_its_trim_needs():
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    (selected,) = re.findall(r"--responses (\S+)[^\n]*\n[^\n]*--out out/mine", "\n".join(code_blocks(readme, "sh")))
    assert {"CX", "CZ", "Cm"} <= set(selected.split(","))
