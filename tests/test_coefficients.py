from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.aircraft import Aircraft
from structsel.candidates import Term
from structsel.coefficients import compute_all, compute_coefficients
from structsel.demo import TRUTH, demo_aircraft, demo_flight, demo_flights
from structsel.errors import AircraftError, ChannelError, DataError, DomainError
from structsel.recording import Recording, read_recording

ROOT = Path(__file__).parents[1]
HFB = ROOT.parent / "shared" / "data" / "hfb320" / "hfb320_1_10.asc"
AIRCRAFT = demo_aircraft()
SIX = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")


@pytest.fixture(scope="module")
def clean():
    return demo_flight("all-axes", noise=0.0, turbulence=1.0, duration=10.0, exact_derivatives=True)


@pytest.fixture(scope="module")
def calm():
    return demo_flight("all-axes", noise=0.0, turbulence=0.0, duration=10.0, exact_derivatives=True)


def keep(recording, *names, without=()):
    chosen = names or tuple(name for name in recording.names if name not in without)
    return Recording(recording.name, recording.t, {name: recording[name] for name in chosen})


def replace(recording, **channels):
    return Recording(recording.name, recording.t, {**recording.channels, **channels})


def truth_at(recording, response):
    return sum(value * Term.parse(term).evaluate(recording) for term, value in TRUTH[response].items())


def said(recording, kind):
    return {finding.channel: finding.message for finding in recording.findings if finding.kind == kind}


@pytest.mark.parametrize("response", SIX)
def test_the_coefficients_of_a_simulated_flight_are_those_it_was_simulated_with(calm, response):
    # Instruments away from the centre of gravity, thrust line off it and tilted, Ixz, all undone.
    made = compute_coefficients(calm, AIRCRAFT)
    assert_allclose(made[response], truth_at(made, response), rtol=0, atol=1e-12)


@pytest.mark.parametrize("response", SIX)
def test_differenced_rates_cost_little(calm, response):
    # The pilot's steps bend the rates within a sample of 0.02 s, which no difference sees: 2.5 per cent of
    # the coefficient's spread. Between two commands fourth order leaves a few parts in a million.
    made = compute_coefficients(keep(calm, without=("p_dot", "q_dot", "r_dot")), AIRCRAFT)
    error, spread = made[response] - truth_at(made, response), made[response].std()
    assert error.std() < 0.025 * spread
    assert np.abs(error[(made.t > 5.0) & (made.t < 5.9)]).max() < 1e-5 * spread


def test_lift_and_drag_are_the_force_turned_into_the_wind(clean):
    made = compute_coefficients(clean, AIRCRAFT)
    a, b = made["alpha"], made["beta"]
    force = np.stack([made[name] for name in ("CX", "CY", "CZ")])
    wind = np.stack([np.cos(a) * np.cos(b), np.sin(b), np.sin(a) * np.cos(b)])
    assert_allclose(made["CD"], -np.sum(force * wind, axis=0), atol=1e-14)
    # Lift, drag and side force together are as long as the force.
    side = np.linalg.norm(force, axis=0) ** 2 - made["CL"] ** 2 - made["CD"] ** 2
    assert np.all(side > -1e-12)


def test_candidate_channels_are_what_their_names_say(clean):
    made = compute_coefficients(clean, AIRCRAFT)
    V = made["V"]
    assert_allclose(made["p_hat"], clean["p"] * 14.63 / (2 * V), rtol=1e-12)
    assert_allclose(made["q_hat"], clean["q"] * 1.5875 / (2 * V), rtol=1e-12)
    assert_allclose(made["r_hat"], clean["r"] * 14.63 / (2 * V), rtol=1e-12)
    assert_allclose(made["alpha_dot_hat"], made["alpha_dot"] * 1.5875 / (2 * V), rtol=1e-12)
    assert_allclose(made["beta_dot_hat"], made["beta_dot"] * 14.63 / (2 * V), rtol=1e-12)
    assert_allclose(made["V_ratio"], V / 45.0, rtol=1e-12)
    assert_allclose(made["qbar"], 0.5 * clean["rho"] * V**2, rtol=1e-12)
    assert_allclose(made["CT"], clean["thrust"] / (made["qbar"] * 23.23), rtol=1e-12)
    # 336.4 m/s is the standard speed of sound at 1000 m.
    assert_allclose(made["mach"][0], V[0] / 336.43, rtol=1e-4)


def test_a_second_run_changes_nothing(clean):
    # The vanes must not be carried to the centre of gravity twice.
    once = compute_coefficients(clean, AIRCRAFT)
    twice = compute_coefficients(once, AIRCRAFT)
    for name in once.names:
        assert_allclose(twice[name], once[name], rtol=1e-13, atol=1e-15, err_msg=name)
    assert [str(f) for f in twice.findings] == [str(f) for f in once.findings]


def test_a_longitudinal_recording_gives_what_it_can_and_says_what_it_cannot(calm):
    level = {"sensors": {}, "thrust": {"offset": (0.0, 0.0, -0.15)}}
    aircraft = Aircraft.from_dict({**AIRCRAFT.to_dict(), **level})
    names = ("V", "alpha", "ax", "az", "q", "q_dot", "de", "thrust", "rho")
    made = compute_coefficients(keep(calm, *names), aircraft)
    assert {"CX", "CZ", "CL", "CD", "Cm", "q_hat", "alpha_dot_hat"} <= set(made.names)
    assert not {"CY", "Cl", "Cn", "p_hat", "beta_dot_hat"} & set(made.names)
    left_out, assumed = said(made, "left-out"), said(made, "assumed")
    assert {"CY", "Cl", "Cn", "beta"} <= set(left_out)
    assert "no p and r recorded" in left_out["Cl"]
    assert "inertial coupling in Cm" in assumed["p"]
    assert "part of the drag is taken as zero" in assumed["CD"]


def test_an_unrecorded_thrust_stays_inside_and_is_said(clean):
    made = compute_coefficients(clean, AIRCRAFT)
    without = compute_coefficients(keep(clean, without=("thrust",)), AIRCRAFT)
    assert "CT" not in without
    assert "CX, CD, CZ, CL and the moments hold the propulsive part" in said(without, "left-out")["thrust"]
    assert_allclose(without["CX"] - made["CX"], made["CT"] * np.cos(0.03), rtol=1e-9)
    assert_allclose(without["CZ"] - made["CZ"], -made["CT"] * np.sin(0.03), rtol=1e-9)
    # Moment of the line through (1.8, 0, -0.15) m, tilted up 0.03 rad.
    arm = -0.15 * np.cos(0.03) + 1.8 * np.sin(0.03)
    assert_allclose(without["Cm"] - made["Cm"], made["CT"] * arm / 1.5875, rtol=1e-7)


def test_a_recorded_mass_overrides_the_aircrafts(clean):
    made = compute_coefficients(clean, AIRCRAFT)
    heavier = compute_coefficients(replace(clean, mass=np.full(len(clean), 2 * 2288.231)), AIRCRAFT)
    assert_allclose(heavier["CY"], 2 * made["CY"], rtol=1e-12)
    assert_allclose(heavier["Cl"], made["Cl"], rtol=1e-12)


def test_the_density_of_a_recording_with_altitude_alone_is_the_standard_one(clean):
    made = compute_coefficients(keep(clean, without=("rho",)), AIRCRAFT)
    assert_allclose(made["qbar"], 0.5 * clean["rho"] * made["V"] ** 2, rtol=1e-6)
    assert any("standard atmosphere at h" in note for note in made.provenance)


def test_manoeuvres_have_one_reference_airspeed_in_common(clean, calm):
    nameless = Aircraft.from_dict({key: v for key, v in AIRCRAFT.to_dict().items() if key != "V0"})
    first, second = compute_all([clean, calm], nameless)
    assert_allclose(first["V_ratio"].mean(), 1.0, rtol=1e-12)
    assert_allclose(second["V"] / second["V_ratio"], first["V"] / first["V_ratio"], rtol=1e-12)
    assert "the mean V of 'all-axes'" in said(second, "assumed")["V_ratio"]
    given = compute_all([clean], nameless, V0=50.0)[0]
    assert_allclose(given["V_ratio"], given["V"] / 50.0, rtol=1e-12)


def test_without_an_inertia_there_are_forces_but_no_moments(clean):
    bare = Aircraft.from_dict({key: v for key, v in AIRCRAFT.to_dict().items() if key != "inertia"})
    made = compute_coefficients(clean, bare)
    assert "CZ" in made
    assert "Cm" not in made
    assert "has no inertia" in said(made, "left-out")["Cm"]


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        (lambda r: keep(r, without=("alpha",)), ChannelError, r"compute_coefficients needs channel 'alpha'"),
        (lambda r: keep(r, without=("rho", "h")), ChannelError, r"'qbar' \[Pa\], or 'rho' .* or 'h'"),
        (lambda r: replace(r, qbar=np.r_[900.0, 0.0, np.full(499, 900.0)]), DomainError,
         r"'qbar' \[Pa\] above zero; in 'all-axes' it is 0 at sample 1 \(t = 0.02 s\), 1 such .*\n"
         r".*between\(0.04, 10\)"),
        (lambda r: replace(r, V=np.zeros(501)), DomainError, r"'V' \[m/s\].* at sample 0 .*501 such"),
        (lambda r: replace(r, p=np.r_[np.nan, np.zeros(500)]), DataError, r"'p' \[rad/s\].*nan at sample 0"),
        (lambda r: keep(r.between(0.0, 0.05), without=("q_dot",)), DataError, "'all-axes': .* at least 5 samples"),
    ],
)  # fmt: skip
def test_what_cannot_be_computed_is_named_with_recording_and_sample(clean, change, error, says):
    with pytest.raises(error, match=says):
        compute_coefficients(change(clean), AIRCRAFT)


def test_a_mass_must_come_from_somewhere(clean):
    massless = Aircraft.from_dict({key: v for key, v in AIRCRAFT.to_dict().items() if key != "mass"})
    with pytest.raises(AircraftError, match=r"'all-axes' has no channel 'mass' \[kg\]"):
        compute_coefficients(clean, massless)


def test_least_squares_on_turbulent_noisy_flights_comes_near_the_truth():
    # Main derivatives only; six flights, rates differenced. Stated: within 15 per cent.
    recordings, aircraft, truth = demo_flights()
    made = compute_all(recordings, aircraft)
    main = {"CZ": "alpha", "CY": "beta", "Cl": "p_hat", "Cm": "de", "Cn": "dr"}
    for response, term in main.items():
        terms = list(truth[response])
        X = np.concatenate(
            [np.column_stack([np.broadcast_to(Term.parse(k).evaluate(r), len(r)) for k in terms]) for r in made]
        )
        y = np.concatenate([r[response] for r in made])
        got = np.linalg.lstsq(X, y, rcond=None)[0][terms.index(term)]
        assert got == pytest.approx(truth[response][term], rel=0.15), response


@pytest.mark.skipif(not HFB.exists(), reason="the HFB-320 record is not here; see examples/hfb320_map.toml")
def test_hfb320_equation_error_estimates_are_the_published_tests():
    # Equation error on this record, V0 = 104.67 m/s, q made dimensionless with 1.215/V0: that is q_hat V/V0.
    recording = read_recording(HFB, ROOT / "examples" / "hfb320_map.toml")
    made = compute_coefficients(recording, Aircraft.from_toml(ROOT / "examples" / "hfb320.toml"))
    columns = {
        "1": np.ones(len(made)),
        "V": made["V_ratio"],
        "alpha": made["alpha"],
        "q": made["q_hat"] * made["V_ratio"],
        "de": made["de"],
    }
    published = {
        "CD": {"1": 0.121, "V": -0.0631, "alpha": 0.322},
        "CL": {"1": -0.0755, "V": 0.1408, "alpha": 4.2365},
        "Cm": {"1": 0.092, "V": 0.0216, "alpha": -0.9554, "q": -41.70, "de": -1.598},
    }
    for response, values in published.items():
        X = np.column_stack([columns[name] for name in values])
        theta = np.linalg.lstsq(X, made[response], rcond=None)[0]
        assert_allclose(theta, list(values.values()), rtol=0.01, err_msg=response)
