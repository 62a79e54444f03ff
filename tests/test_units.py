"""Units as flight-test files write them."""

from __future__ import annotations

import numpy as np
import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from structsel.readers.table import split_header
from structsel.readers.units import convert, is_convertible

# --- units ---------------------------------------------------------------------------------------


UNITS = [
    ("deg", "rad"), ("deg/s", "rad/s"), ("deg/s^2", "rad/s^2"), ("ft", "m"), ("knot", "m/s"), ("ft/s", "m/s"),
    ("mph", "m/s"), ("km/h", "m/s"), ("hPa", "Pa"), ("psi", "Pa"), ("lbf", "N"), ("slug/ft^3", "kg/m^3"),
    ("degC", "K"), ("degF", "K"), ("percent", "-"), ("lb", "kg"), ("g", "kg"), ("ms", "s"), ("us", "s"), ("min", "s"),
    ("rad/s", "rpm"),
]  # fmt: skip


@settings(deadline=None)  # the first call builds the unit registry
@given(pair=st.sampled_from(UNITS), x=st.floats(-1e4, 1e4))
def test_conversion_is_pints_own(pair, x):
    unit, target = pair
    quantity = pint.application_registry.Quantity(x, unit).to(target if target != "-" else "dimensionless")
    assert_allclose(convert(np.array([x]), unit, target)[0], quantity.magnitude, rtol=1e-12, atol=1e-12)


@given(x=st.floats(-720.0, 720.0, allow_subnormal=False))
def test_degrees_become_radians_and_back(x):
    there = convert(np.array([x]), "deg", "rad")
    assert_allclose(there, x * np.pi / 180.0, rtol=1e-15)
    assert_allclose(convert(there, "rad", "deg"), x, rtol=1e-14, atol=1e-300)


@pytest.mark.parametrize(
    ("unit", "target", "factor"),
    [
        ("g", "m/s^2", 9.80665),
        ("m/s2", "m/s^2", 1.0),
        ("rad/s2", "rad/s^2", 1.0),
        ("kts", "m/s", 1852.0 / 3600.0),
        ("KTAS", "m/s", 1852.0 / 3600.0),
        ("NM", "m", 1852.0),
        ("nm", "m", 1852.0),
        ("nmi", "m", 1852.0),
        ("NM/h", "m/s", 1852.0 / 3600.0),
        ("mil", "rad", 1e-3),
        ("mb", "Pa", 100.0),
        ("KT", "m/s", 1852.0 / 3600.0),
        ("kt", "m/s", 1852.0 / 3600.0),
        ("%", "-", 0.01),
        ("1/s", "rad/s", 1.0),
        ("-", "rad", 1.0),
        ("psf", "Pa", 4.4482216152605 / 0.3048**2),
        ("°", "rad", np.pi / 180.0),
    ],
)
def test_units_are_read_as_flight_test_files_write_them(unit, target, factor):
    assert_allclose(convert(np.ones(1), unit, target)[0], factor, rtol=1e-12)


@pytest.mark.parametrize(
    ("unit", "target"),
    [
        ("deg", "m/s"),
        ("deg", "-"),
        ("%", "rad"),
        ("Hz", "rad/s"),
        ("Hz", "rpm"),
        ("kg", "N"),
        ("furlongs", "no"),
    ],
)
def test_units_that_measure_something_else_do_not_convert(unit, target):
    assert not is_convertible(unit, target)


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("alpha [deg]", "alpha", "deg"),
        ("V (kt)", "V", "kt"),
        ("CL [-]", "CL", "-"),
        ("ay (cockpit)", "ay (cockpit)", None),
        ("acc[1]", "acc[1]", None),
        (" q ", "q", None),
    ],
)
def test_brackets_in_a_header_are_a_unit_only_if_they_read_as_one(text, name, unit):
    assert split_header(text) == (name, unit)
