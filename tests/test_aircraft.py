"""Aircraft from TOML: what is taken, and what is refused with which words."""

from __future__ import annotations

import copy
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pydantic import ValidationError

from structsel.aircraft import Aircraft, Inertia
from structsel.errors import AircraftError

EXAMPLES = Path(__file__).parents[1] / "examples"
SHARED = Path(__file__).parents[2] / "shared"

GOOD = {
    "name": "test jet",
    "mass": 7472.0,
    "S": 30.1,
    "b": 14.5,
    "cbar": 2.43,
    "inertia": {"Ix": 2.0e4, "Iy": 9.0e4, "Iz": 1.0e5, "Ixz": 500.0},
    "thrust": {"offset": [0.5, 0.0, -0.6], "inclination": 0.05},
    "sensors": {"accelerometer": {"position": [1, 0.2, -0.1]}, "vane": {"position": [5.0, 0.0, 0.0]}},
    "tolerances": {"main": 0.01, "mass": "exact", "thrust": "free"},
}


def changed(path: str, value: object) -> dict:
    content = copy.deepcopy(GOOD)
    table = content
    *tables, key = path.split(".")
    for part in tables:
        table = table.setdefault(part, {})
    table[key] = value
    return content


def test_the_form_of_the_design_is_read_from_toml(tmp_path):
    path = tmp_path / "aircraft.toml"
    path.write_text(
        'name = "HFB-320"\nmass = 7472.0\nS = 30.1\nb = 14.5\ncbar = 2.43\n'
        "[inertia]\nIx = 1.0e4\nIy = 2.0e4\nIz = 3.0e4\nIxz = 500.0\n"
        "[thrust]\noffset = [0.0, 0.0, 0.0]\ninclination = 0.0\n"
        "[sensors.accelerometer]\nposition = [0.0, 0.0, 0.0]\n[sensors.vane]\nposition = [5.0, 0.0, 0.0]\n"
        '[tolerances]\nmain = "free"\n[simulation]\nstates = "raw"\n'
    )
    aircraft = Aircraft.from_toml(path)
    assert (aircraft.name, aircraft.mass, aircraft.S, aircraft.b, aircraft.cbar) == (
        "HFB-320",
        7472,
        30.1,
        14.5,
        2.43,
    )
    assert aircraft.inertia == Inertia(Ix=1e4, Iy=2e4, Iz=3e4, Ixz=500.0)
    assert_allclose(aircraft.position("vane"), [5.0, 0.0, 0.0])
    assert aircraft.simulation.states == "raw"
    assert aircraft.tolerances.main == "free"


def test_a_written_file_is_read_back_as_the_same_aircraft(tmp_path):
    sensors = {"vane": {"position": [5.0, 0.0, -0.2]}, "nose boom 2": {"noise": {"alpha": 1e-3}}}
    aircraft = Aircraft.from_dict({**GOOD, "name": 'Öhman "A"', "sensors": sensors})
    aircraft.to_toml(tmp_path / "aircraft.toml")
    assert Aircraft.from_toml(tmp_path / "aircraft.toml") == aircraft


def test_tolerances_left_out_take_the_designs_defaults():
    tolerances = Aircraft.from_dict(GOOD).tolerances
    assert tolerances.model_dump() == {
        "main": 0.01, "secondary": 0.15, "mass": "exact", "inertia": 0.05, "cg": 0.005, "thrust": "free",
        "vane_scale": 0.015, "alignment": 0.005, "delay": 0.005, "lever_arm": 0.15, "form": 0.0,
    }  # fmt: skip


def test_what_is_left_out_has_a_plain_default():
    aircraft = Aircraft(name="bare", S=1.0, b=2.0, cbar=0.5)
    assert aircraft.mass is None
    assert aircraft.V0 is None
    assert_allclose(aircraft.position("vane"), np.zeros(3))
    assert_allclose(aircraft.thrust.direction, [1.0, 0.0, 0.0])
    with pytest.raises(AircraftError, match=r"compute_coefficients needs the moments of inertia; aircraft 'bare'"):
        aircraft.require_inertia("compute_coefficients")


def test_to_dict_gives_back_what_from_dict_took():
    aircraft = Aircraft.from_dict(GOOD)
    assert Aircraft.from_dict(aircraft.to_dict()) == aircraft
    assert aircraft.to_dict()["schema"] == "structsel.aircraft/1"


def test_the_tensor_has_the_products_with_a_minus_sign():
    tensor = Inertia(Ix=3.0, Iy=4.0, Iz=5.0, Ixz=0.5, Ixy=0.2, Iyz=0.1).tensor
    assert_allclose(tensor, [[3.0, -0.2, -0.5], [-0.2, 4.0, -0.1], [-0.5, -0.1, 5.0]])


def test_inclination_tilts_the_thrust_up_and_the_arm_is_the_moment_per_newton():
    # M = z Fx - x Fz, with F = T (cos i, 0, -sin i): M/T = z cos i + x sin i.
    thrust = Aircraft.from_dict(GOOD).thrust
    assert_allclose(thrust.direction, [math.cos(0.05), 0.0, -math.sin(0.05)], rtol=1e-15)
    assert_allclose(thrust.arm[1], -0.6 * math.cos(0.05) + 0.5 * math.sin(0.05), rtol=1e-14)
    assert_allclose(np.linalg.norm(thrust.direction), 1.0, rtol=1e-15)


def test_an_aircraft_cannot_be_changed():
    aircraft = Aircraft.from_dict(GOOD)
    with pytest.raises(ValidationError, match="frozen"):
        aircraft.mass = 1.0
    with pytest.raises(ValidationError, match="frozen"):
        aircraft.inertia.Ix = 1.0


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("S", -30.1, r"S: input should be greater than 0 \(it is -30\.1\)"),
        ("cbar", 0.0, r"cbar: input should be greater than 0"),
        ("mass", float("nan"), r"mass: input should be a finite number"),
        ("mass", "7472", r"mass: input should be a valid number"),
        ("mass", True, r"mass: input should be a valid number"),
        ("mas", 7472.0, r"mas: no such key\. Did you mean 'mass'"),
        ("inertia.Iyy", 1.0, r"inertia\.Iyy: no such key\..*Keys here: Ix, Iy, Iz"),
        ("inertia.Ixz", 9e4, r"inertia: the products of inertia are too large"),
        ("inertia", {"Ix": 1.0, "Iy": 1.0}, r"inertia\.Iz: missing"),
        ("thrust.inclination", 5.0, r"thrust\.inclination: input should be less than or equal"),
        ("thrust.offset", [0.0, 1.0], r"thrust\.offset\.2: missing"),
        ("sensors.vane.pos", [0, 0, 0], r"sensors\.vane\.pos: no such key\..*Keys here: position, noise"),
        ("sensors.vane.position", ["a", 0, 0], r"sensors\.vane\.position\.0: input should be a valid number"),
        ("tolerances.mian", 0.1, r"tolerances\.mian: no such key\. Did you mean 'main'"),
        ("tolerances.main", "exat", r"tolerances\.main: input should be 'exact' or 'free' \(it is 'exat'\)"),
        ("tolerances.main", -0.1, r"tolerances\.main: input should be greater than or equal to 0"),
        ("simulation.states", "true", r"simulation\.states: input should be 'reconstructed' or 'raw'"),
        ("schema", "structsel.aircraft/9", r"schema: input should be 'structsel\.aircraft/1'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_by_its_key(path, value, words):
    with pytest.raises(AircraftError, match=words) as caught:
        Aircraft.from_dict(changed(path, value))
    assert "aircraft 'test jet' cannot be used." in str(caught.value)


def test_inertias_that_no_body_can_have_are_a_remark():
    aircraft = Aircraft.from_dict(changed("inertia.Iz", 2e5))
    assert any("exceeds the sum of the other two by 81.8%" in remark for remark in aircraft.remarks)


@pytest.mark.parametrize("key", ["name", "S", "b", "cbar"])
def test_a_missing_constant_is_named(key):
    content = {k: v for k, v in GOOD.items() if k != key}
    with pytest.raises(AircraftError, match=rf"{key}: missing"):
        Aircraft.from_dict(content)


def test_every_problem_of_a_file_is_stated_at_once_with_the_files_name(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('name = "x"\nS = -1\nb = 2\ncbar = 0\nwings = 2\n')
    with pytest.raises(AircraftError, match=r"bad\.toml") as caught:
        Aircraft.from_toml(path)
    assert all(f"\n{key}: " in str(caught.value) for key in ("S", "cbar", "wings"))


def test_files_that_are_missing_or_no_toml_are_named(tmp_path):
    with pytest.raises(AircraftError, match=r"nowhere\.toml' cannot be read"):
        Aircraft.from_toml(tmp_path / "nowhere.toml")
    (tmp_path / "broken.toml").write_text("S = = 3")
    with pytest.raises(AircraftError, match=r"broken\.toml' is not TOML: .*line 1"):
        Aircraft.from_toml(tmp_path / "broken.toml")


@given(
    masses=st.lists(st.floats(0.1, 100.0), min_size=5, max_size=12),
    places=st.lists(st.tuples(*[st.floats(-5, 5)] * 3), min_size=12, max_size=12),
)
def test_any_set_of_point_masses_is_a_body(masses, places):
    # Inertia summed from point masses and a solid ball, which keeps it away from a line.
    r, m = np.array(places[: len(masses)]), np.array(masses)
    x, y, z = r.T
    inertia = Inertia(
        Ix=float(m @ (y**2 + z**2)) + 1.0,
        Iy=float(m @ (x**2 + z**2)) + 1.0,
        Iz=float(m @ (x**2 + y**2)) + 1.0,
        Ixz=float(m @ (x * z)),
        Ixy=float(m @ (x * y)),
        Iyz=float(m @ (y * z)),
    )
    assert inertia.excess < 1e-9


def test_a_small_breach_of_the_triangle_rule_is_reported_not_refused():
    aircraft = Aircraft.from_dict(changed("inertia", {"Ix": 322780, "Iy": 799125, "Iz": 1.13167e6}))
    # 1131670 / (322780 + 799125) = 1.0087
    assert aircraft.inertia.excess == pytest.approx(1131670 / 1121905 - 1.0, rel=1e-12)
    assert any("exceeds the sum" in remark for remark in aircraft.remarks)
    assert "! the largest principal moment" in str(aircraft)


def test_feet_for_metres_in_one_of_two_is_remarked():
    assert any("aspect ratio" in remark for remark in Aircraft.from_dict(changed("S", 324.0 * 10)).remarks)


def test_the_example_of_the_hfb_reproduces_the_published_ratios():
    aircraft = Aircraft.from_toml(EXAMPLES / "hfb320.toml")
    assert_allclose(aircraft.S / aircraft.mass, 4.028e-3, rtol=2e-4)
    assert_allclose(aircraft.S * aircraft.cbar / aircraft.inertia.Iy, 8.0027e-4, rtol=1e-5)
    assert_allclose(aircraft.thrust.arm[1] / aircraft.inertia.Iy, -7.0153e-6, rtol=1e-4)
    assert aircraft.remarks == ()


def test_the_example_of_the_attas_has_the_published_aspect_ratio():
    aircraft = Aircraft.from_toml(EXAMPLES / "attas.toml")
    assert_allclose(aircraft.b**2 / aircraft.S, 7.22, atol=0.005)
    assert aircraft.remarks == ()


@pytest.mark.skipif(not (SHARED / "data" / "diagnose-examples").exists(), reason="shared data are not here")
def test_the_aircraft_of_the_diagnosis_examples_are_read():
    paths = sorted((SHARED / "data" / "diagnose-examples").glob("*/aircraft.toml"))
    assert len(paths) == 4
    assert all(Aircraft.from_toml(path).inertia is not None for path in paths)
