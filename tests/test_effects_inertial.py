"""Mass, centre of gravity and inertia: simulated with the true ones, compared with the stated."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lsim

from tests.effect_fits import best, effect_named, explain
from tests.exact_flights import AIRCRAFT, compare, fly


def aircraft(**other):
    return AIRCRAFT.model_validate(AIRCRAFT.model_dump() | other)


def test_a_heavier_aircraft_is_found_with_its_mass():
    found = best(compare(fly(aircraft=aircraft(mass=2288.0 * 1.1))), effect_named("mass-error"))
    assert found.variant.about == "in all manoeuvres"
    assert found.explained > 0.98
    assert_allclose(found.values["fraction"], 0.1, rtol=0.02)


@pytest.mark.parametrize(("axis", "shift"), [(0, 0.08), (1, 0.15), (2, 0.1)])
def test_a_centre_of_gravity_elsewhere_is_found_by_the_moment_of_all_forces(axis, shift):
    d = shift * np.eye(3)[axis]
    made = []
    for f in compare(fly()):
        force = np.column_stack([f.simulated["CX"] + f["CT"], f.simulated["CY"], f.simulated["CZ"]])
        moment = -np.cross(d, force) / [AIRCRAFT.b, AIRCRAFT.cbar, AIRCRAFT.b]
        more = {r: f.simulated[r] + m for r, m in zip(("Cl", "Cm", "Cn"), moment.T)}
        made.append(replace(f, measured={**f.measured, **more}))
    found = best(made, effect_named("cg-shift"))
    assert found.variant.about == "in all manoeuvres"
    assert found.explained > 0.99
    assert_allclose(found.values["xyz"[axis]], shift, rtol=0.02)


@pytest.mark.parametrize(
    ("name", "size", "expected"), [("Ix", 1.15, 0.15), ("Iy", 0.85, -0.15), ("Ixz", 518.0, 400.0 / 11159.0)]
)
def test_inertia_other_than_stated_is_found_by_its_axis(name, size, expected):
    inertia = AIRCRAFT.inertia.model_dump()
    inertia[name] = size if name == "Ixz" else inertia[name] * size
    flights = compare(fly(aircraft=aircraft(inertia=inertia)))
    variants = {tuple(p.name for p in v.parameters): v for v in effect_named("inertia-error").variants(flights)}
    found = explain(flights, variants[(name,)])
    assert found.explained > 0.95
    assert_allclose(found.values[name], expected, rtol=0.06)
    assert explain(flights, variants[("Iz",)]).explained < 0.6


def test_fuel_that_swings_sideways_is_found_at_its_frequency():
    # 4 per cent of the mass on a pendulum of 0.6 Hz, 5 per cent damped, driven by the lateral specific force.
    w, mass_fraction = 2.0 * np.pi * 0.6, 0.04
    made = []
    for f in compare(fly()):
        CY = f.simulated["CY"]
        swung = lsim(([w**2], [1.0, 0.1 * w, w**2]), CY * f["qbar"], f.t - f.t[0])[1] / f["qbar"]
        made.append(replace(f, measured={**f.measured, "CY": CY - mass_fraction * (swung - CY)}))
    found = best(made, effect_named("slosh"))
    assert found.variant.about == "sideways"
    assert found.explained > 0.75
    assert_allclose(found.variant.shape["frequency"], 0.6, rtol=0.15)
    assert_allclose(found.values["fraction of the mass"], mass_fraction, rtol=0.35)


@pytest.mark.parametrize("effect", ["mass-error", "cg-shift"])
def test_a_growing_effect_is_complete_in_a_later_manoeuvre(effect):
    flights = compare(fly())
    flights = [*flights, replace(flights[0], name="again")]
    growing = [v for v in effect_named(effect).variants(flights) if "growing from" in v.about]
    assert growing
    for variant in growing:
        last, later = variant.columns(flights[-1]), variant.columns(replace(flights[-1], name="tried"))
        assert all(np.array_equal(later[r], x) for r, x in last.items())
        assert max(np.abs(x).max() for x in later.values()) > 0.0


def test_inertia_cannot_be_stated_where_none_is_stated():
    bare = aircraft(inertia=None)
    flights = [replace(f, aircraft=bare) for f in compare(fly())]
    assert effect_named("inertia-error").needs(flights) == "moments of inertia"
