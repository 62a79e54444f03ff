"""JSBSim behind our verbs: the same flight as simulate()'s, the same coefficients, a bundled aircraft in order."""

import math
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.coefficients import compute_coefficients
from structsel.demo.aircraft import TRUTH
from structsel.errors import ChannelError, SimulationError
from structsel.model import AeroModel
from structsel.numerics import rigid_body as rb
from structsel.reconstruction import reconstruct
from structsel.recording import Recording
from structsel.simulation import Atmosphere, simulate, trim
from structsel.simulation.jsbsim import open_jsbsim
from structsel.simulation.jsbsim.fdm import FlightDynamicsModel

CLOCK = np.arange(0.0, 30.0, 0.02)
MODEL = AeroModel.from_terms(TRUTH)
INERTIA = {"ixx": 5368.39, "iyy": 6928.93, "izz": 11158.75, "ixz": -117.64}


def test_without_jsbsim_the_message_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    with pytest.raises(SimulationError, match=r'pip install "structsel\[jsbsim\]"'):
        open_jsbsim("c172p")


@pytest.fixture(scope="module")
def installed():
    pytest.importorskip("jsbsim", reason='JSBSim is not installed: pip install "structsel[jsbsim]"')


# --- an aircraft whose coefficients we know --------------------------------------------------------------------

PROPERTIES = {
    "alpha": ("aero/alpha-rad",),
    "beta": ("aero/beta-rad",),
    "p_hat": ("aero/bi2vel", "velocities/p-aero-rad_sec"),
    "q_hat": ("aero/ci2vel", "velocities/q-aero-rad_sec"),
    "r_hat": ("aero/bi2vel", "velocities/r-aero-rad_sec"),
    "de": ("fcs/elevator-pos-rad",),
    "da": ("fcs/left-aileron-pos-rad",),
    "dr": ("fcs/rudder-pos-rad",),
}


def written(term, value, lengths):
    """One term as a function of JSBSim's: a force in lb or a moment in lb ft."""
    factors = []
    for factor in () if term == "1" else term.split("*"):
        name, _, power = factor.partition("^")
        factors += PROPERTIES[name] * int(power or 1)
    properties = "".join(f"<property>{p}</property>" for p in ("aero/qbar-psf", "metrics/Sw-sqft", *lengths, *factors))
    return f"<function><product>{properties}<value>{value!r}</value></product></function>"


def aircraft_xml():
    axes = dict(zip(TRUTH, ("X", "Y", "Z", "ROLL", "PITCH", "YAW")))
    lengths = {"Cl": ("metrics/bw-ft",), "Cm": ("metrics/cbarw-ft",), "Cn": ("metrics/bw-ft",)}
    aerodynamics = "".join(
        f'<axis name="{axes[response]}">'
        + "".join(written(term, value, lengths.get(response, ())) for term, value in terms.items())
        + "</axis>"
        for response, terms in TRUTH.items()
    )
    origin = "<x>0</x><y>0</y><z>0</z>"
    inertia = "".join(f'<{name} unit="KG*M2">{value}</{name}>' for name, value in INERTIA.items())
    return f"""<?xml version="1.0"?>
<fdm_config name="simple" version="2.0" release="ALPHA">
<metrics><wingarea unit="M2">23.23</wingarea><wingspan unit="M">14.63</wingspan><chord unit="M">1.5875</chord>
<location name="AERORP" unit="M">{origin}</location></metrics>
<mass_balance>{inertia}<emptywt unit="KG">2288.231</emptywt><location name="CG" unit="M">{origin}</location>
</mass_balance>
<ground_reactions></ground_reactions>
<external_reactions><force name="thrust" frame="BODY">
<location unit="M"><x>-1.8</x><y>0</y><z>0.15</z></location>
<direction><x>{math.cos(0.03)}</x><y>0</y><z>{-math.sin(0.03)}</z></direction></force></external_reactions>
<aerodynamics>{aerodynamics}</aerodynamics>
</fdm_config>"""


@pytest.fixture(scope="module")
def xml(installed, tmp_path_factory):
    path = tmp_path_factory.mktemp("jsbsim") / "simple.xml"
    path.write_text(aircraft_xml(), encoding="utf-8")
    return path


# Density is held, since JSBSim takes h as a geometric altitude and simulate() as a geopotential one; gravity is that of
# a sphere of 3e9 m at 1000 m.
RHO, H = 1.1, 1000.0
AIR = Atmosphere(rho=RHO, gravity=rb.G0 * (1.0 - 2.0 * H / 3e9))
ANGLES = ("alpha", "beta", "phi", "theta", "psi")
RATES = ("p", "q", "r")
PLACE = ("x", "y", "h")


@pytest.fixture(scope="module")
def simple(xml):
    return open_jsbsim(xml, rho=RHO)


@pytest.fixture(scope="module")
def steady(simple):
    return simple.trim(45.0, H)


@pytest.fixture(scope="module")
def ours(simple, steady):
    return simulate(MODEL, simple.aircraft, moved(steady), start=steady, air=AIR)


def moved(trim):
    """Inputs in all three axes, smooth, so that both integrate them to their full order."""
    t = CLOCK
    waves = {"de": 0.02 * np.sin(t) ** 3, "da": 0.03 * np.sin(0.8 * t) ** 3, "dr": 0.02 * np.sin(0.6 * t) ** 3}
    return trim.inputs(t, **waves)


def largest_difference(one, other, names):
    return max(float(np.abs(one[name] - other[name]).max()) for name in names)


def test_constants_are_those_of_the_file(simple):
    aircraft = simple.aircraft
    assert_allclose([aircraft.S, aircraft.b, aircraft.cbar, aircraft.mass], [23.23, 14.63, 1.5875, 2288.231], rtol=2e-6)
    # JSBSim turns kg m^2 into slug ft^2 by a rounded 1.35594; exactly it is 1.35582.
    inertia = aircraft.inertia
    assert_allclose([inertia.Ix, inertia.Iy, inertia.Iz], [5368.39, 6928.93, 11158.75], rtol=1e-4)
    # Its file has the product as in the tensor, ours as the integral over the mass.
    assert_allclose(inertia.Ixz, 117.64, rtol=1e-4)
    assert_allclose(aircraft.thrust.offset, (1.8, 0.0, -0.15), atol=1e-6)
    assert_allclose(aircraft.thrust.inclination, 0.03, atol=1e-9)
    assert_allclose(simple.reference_points["aerodynamic"], 0.0, atol=1e-9)
    assert simple.controls == ("de", "da", "dr", "df", "gear", "thrust")


def test_thirty_seconds_agree_with_our_own_flight_to_integration_accuracy(simple, steady, ours):
    theirs = simple.fly(moved(steady), start=steady)
    assert np.ptp(ours["phi"]) > 0.1
    assert np.ptp(ours["alpha"]) > 0.04
    # Measured: 5e-6 m/s, 1.2e-7 rad, 7e-8 rad/s, 8e-5 m of 1350 m. The remainder of the sphere is the direction of
    # gravity, turned by 1350 m / 3e9 m: 4e-6 m/s^2 at the end.
    assert largest_difference(theirs, ours, ("V",)) < 2e-5
    assert largest_difference(theirs, ours, ANGLES) < 5e-7
    assert largest_difference(theirs, ours, RATES) < 3e-7
    assert largest_difference(theirs, ours, PLACE) < 3e-4
    assert largest_difference(theirs, ours, ("ax", "ay", "az", "p_dot", "q_dot", "r_dot")) < 1e-5
    assert largest_difference(theirs, ours, TRUTH) < 5e-7


def test_the_difference_falls_with_the_step_of_the_integration(simple, steady, ours):
    coarse, fine = (simple.fly(moved(steady), start=steady, substeps=k) for k in (1, 4))
    # Second order or better: a quarter of the step, less than a sixteenth of the difference.
    assert largest_difference(fine, ours, RATES) < largest_difference(coarse, ours, RATES) / 12.0


def test_a_round_rotating_earth_makes_the_expected_difference(xml, steady, ours):
    theirs = open_jsbsim(xml, earth="round", rho=RHO).fly(moved(steady), start=steady)
    # Coriolis at 45 degrees north, heading north: 2 Omega V sin(45) = 4.6e-3 m/s^2 to the right; in 30 s less than the
    # 2.1 m it would push a body that does not weathercock, and much more than the integration's error.
    assert 0.2 < largest_difference(theirs, ours, ("y",)) < 2.1
    # Gravity at 45 degrees and 1000 m is 9.8031 m/s^2, 0.04 % less.
    assert 1e-3 < largest_difference(theirs, ours, ("V",)) < 0.05


def test_the_forced_coefficients_are_the_model_s(simple, ours):
    forced = simple.coefficients(ours)
    for name, expected in MODEL.evaluate(compute_coefficients(ours, simple.aircraft)).items():
        assert_allclose(forced[name], expected, atol=1e-9, rtol=0.0, err_msg=name)


def test_our_trim_and_that_of_jsbsim_are_the_same(simple, steady):
    found = trim(MODEL, simple.aircraft, 45.0, H, air=AIR)
    for name in ("alpha", "theta", "phi", "de", "da", "dr"):
        assert_allclose(steady[name], found[name], atol=1e-9)
    assert_allclose(steady["thrust"], found["thrust"], rtol=1e-8)


def test_an_impossible_trim_says_so_and_keeps_the_nearest(simple):
    with pytest.raises(SimulationError, match="no steady flight at V = 15 m/s") as caught:
        simple.trim(15.0, H)
    assert caught.value.partial["h"] == H


def test_what_cannot_be_set_is_named(simple, steady):
    with pytest.raises(ChannelError, match="no control 'throttle'; it has de, da, dr, df, gear, thrust"):
        simple.fly({"t": CLOCK, "throttle": 0.5}, start=steady)
    with pytest.raises(ChannelError, match="no control 'throttle'"):
        simple.trim(45.0, H, controls={"throttle": 0.5})
    with pytest.raises(ChannelError, match="need a clock"):
        simple.fly({"de": 0.0}, start=steady)


def test_an_aircraft_that_is_not_there_is_named(installed, tmp_path):
    with pytest.raises(SimulationError, match="cannot load the aircraft 'nobody'"):
        open_jsbsim("nobody")
    with pytest.raises(SimulationError, match=r"cannot load the aircraft .*nobody\.xml"):
        open_jsbsim(tmp_path / "nobody.xml")


# --- a bundled aircraft ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cessna(installed):
    return open_jsbsim("c172p")


@pytest.fixture(scope="module")
def doublets(cessna):
    t = np.arange(0.0, 25.0, 0.02)

    def doublet(size, start):
        return size * ((t > start) & (t < start + 1.0)) - size * ((t >= start + 1.0) & (t < start + 2.0))

    steady = cessna.trim(50.0, H)
    return cessna.fly(
        steady.inputs(t, de=doublet(0.03, 1.0), da=doublet(0.08, 6.0), dr=doublet(0.08, 12.0)), start=steady
    )


def test_a_bundled_aircraft_trims_and_stays_there(cessna):
    steady = cessna.trim(50.0, H)
    assert max(abs(x) for x in steady.unbalance.values()) < 1e-4
    flight = cessna.fly(steady.inputs(np.arange(0.0, 5.0, 0.02)), start=steady)
    for name, tolerance in (("V", 0.01), ("alpha", 1e-4), ("phi", 1e-3), ("h", 0.05)):
        assert_allclose(flight[name], steady[name], atol=tolerance, err_msg=name)


def test_positive_surfaces_make_negative_moments(cessna, doublets):
    for surface, moment in (("de", "Cm"), ("da", "Cl"), ("dr", "Cn")):
        pushed = doublets.with_channels(**{surface: doublets[surface] + 0.05})
        assert (cessna.coefficients(pushed)[moment] < cessna.coefficients(doublets)[moment]).all()


def test_the_coefficients_of_a_bundled_aircraft_s_flight_are_those_of_its_readings(cessna, doublets):
    # Inertia with all its products, thrust line, signs and units are then right.
    made = compute_coefficients(doublets, cessna.aircraft)
    for name in TRUTH:
        assert_allclose(made[name], doublets[name], atol=1e-12, err_msg=name)


def test_its_forced_coefficients_are_those_of_the_flight(cessna, doublets):
    forced = cessna.coefficients(doublets)
    # In flight the rate of angle of attack is a step old and the engine not in steady state.
    for name in TRUTH:
        assert_allclose(forced[name], doublets[name], atol=0.01 * np.ptp(doublets[name]), err_msg=name)


def test_its_flight_is_kinematically_consistent(cessna, doublets):
    noise = dict.fromkeys(("phi", "theta", "psi", "alpha", "beta"), 0.002) | dict.fromkeys(("V", "vn", "ve", "vd"), 0.1)
    noise |= dict.fromkeys(("ax", "ay", "az"), 0.02) | dict.fromkeys(("p", "q", "r"), 0.001)
    noise |= {"h": 0.5, "x": 1.0, "y": 1.0}
    seen = Recording("c172p", doublets.t, {name: doublets[name] for name in noise}, provenance=doublets.provenance)
    found = reconstruct(seen, cessna.aircraft, noise=noise)
    assert np.ptp(doublets["phi"]) > 0.2
    for name in ("bax", "bay", "baz", "bp", "bq", "br"):
        # No noise was added: a hundredth of what noise would make of it (measured: below 4e-6 m/s^2, 7e-7 rad/s).
        assert abs(found[name].value) < min(2e-5, 0.05 * found[name].std)


def test_the_stabiliser_holds_the_attitude(cessna):
    steady = cessna.trim(50.0, H)
    t = np.arange(0.0, 20.0, 0.02)
    push = {"da": 0.03 * ((t > 1.0) & (t < 2.0))}
    loose, held = (cessna.fly(steady.inputs(t, **push), start=steady, stabilise=s) for s in (False, True))
    assert abs(held["phi"][-1] - steady["phi"]) < 0.2 * abs(loose["phi"][-1] - steady["phi"])
    assert np.abs(held["da"] - steady["da"] - push["da"]).max() > 0.005  # what was applied is recorded


@pytest.mark.parametrize("psi", [0.0, -1e-6, 3.0, -3.0])
def test_the_heading_is_read_from_minus_pi_to_pi(cessna, psi):
    fdm = FlightDynamicsModel("c172p", None, True, None)
    state = np.zeros(12)
    state[[0, 8, 11]] = 50.0, psi, H
    fdm.place(state, {})
    assert_allclose([fdm.value("psi"), fdm.now()["psi"]], psi, atol=1e-12)


@pytest.mark.parametrize("psi", [0.0, math.pi])
def test_a_heading_hold_does_not_jump_by_a_turn(cessna, psi):
    steady = cessna.trim(50.0, H)
    start = dict(zip(rb.STATES, steady.state.tolist())) | {"psi": psi}
    flight = cessna.fly(steady.inputs(np.arange(0.0, 2.0, 0.02)), start=start, stabilise={"dr": {"psi": 0.5}})
    assert np.ptp(flight["dr"]) < 0.02
    assert np.ptp(flight["psi"]) < 0.1


def test_jsbsim_keeps_quiet(installed, capfd):
    aircraft = open_jsbsim("c172p")
    steady = aircraft.trim(50.0, H)
    aircraft.coefficients(aircraft.fly(steady.inputs(np.arange(0.0, 0.2, 0.02)), start=steady))
    assert capfd.readouterr() == ("", "")
