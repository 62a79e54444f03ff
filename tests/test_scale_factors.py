"""Scale errors of attitude, gyros and accelerometers: found where they were set, and nowhere else."""

from pathlib import Path

import numpy as np
import pytest

import structsel as ss
from structsel.aircraft import Aircraft
from structsel.demo import demo_instruments
from structsel.errors import ModelError
from structsel.numerics.kinematics import STATES
from structsel.reconstruction import ReconstructOptions, reconstruct
from structsel.reconstruction.observability import reconstructibility
from structsel.reconstruction.problem import build_problem
from structsel.reconstruction.scale_factors import _log_bayes_factor, _with_constants
from structsel.reconstruction.settings import ESTIMATED
from structsel.reconstruction.ukf import ukf_filter

DATA = Path(__file__).parents[2] / "shared" / "data"


def scaled(flight, **factors):
    return flight.measured.with_channels(**{name: flight.measured[name] * by for name, by in factors.items()})


def silent(aircraft):
    content = aircraft.to_dict()
    for sensor in content["sensors"].values():
        sensor.pop("noise", None)
    return Aircraft.from_dict(content)


def scales_of(found):
    return {c.name: c for c in found.constants if c.name.startswith("K")}


def test_scale_errors_that_were_set_are_found_within_their_intervals_and_the_result_is_trusted():
    flight = demo_instruments("all-axes", 3, duration=20.0)
    found = reconstruct(scaled(flight, theta=1.04, phi=1.07, p=1.03), flight.aircraft, scales="auto")
    truth = {"Ktheta": 0.04, "Kphi": 0.07, "Kp": 0.03}
    scales = scales_of(found)
    assert set(scales) == set(truth)
    for name, value in truth.items():
        assert abs(scales[name].value - value) < 3.0 * scales[name].std < 0.01, scales[name]
    # The biases are as in a flight without scale errors. A bias of p was scaled with its channel.
    for c in found.constants:
        if c.name not in truth:
            expected = flight.errors[c.name] * (1.03 if c.name == "bp" else 1.0)
            assert abs(c.value - expected) < 3.5 * c.std, c
    assert found.trusted, found.distrust
    made, true = found.recording, flight.truth
    for name in ("phi", "theta", "p"):
        assert np.sqrt(np.mean((made[name] - true[name]) ** 2)) < 3e-3, name
    # The derivative of p has lost its scale error, too: p_dot of the same flight without one is nearest.
    assert np.polyfit(true["p_dot"], made["p_dot"], 1)[0] == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["phi", "theta", "p", "q", "r", "ax", "ay", "az"])
@pytest.mark.parametrize("stated", [True, False], ids=["stated", "silent"])
def test_each_scale_error_is_found_alone_if_the_flight_determines_it(channel, stated):
    flight = demo_instruments("all-axes", 4, duration=20.0)
    aircraft = flight.aircraft if stated else silent(flight.aircraft)
    scales = scales_of(reconstruct(scaled(flight, **{channel: 1.06}), aircraft, scales="auto"))
    assert set(scales) <= {f"K{channel}"}
    for one in scales.values():
        assert abs(one.value - 0.06) < 3.0 * one.std
    if channel in ("phi", "theta", "p", "q", "r", "az"):
        assert scales


@pytest.mark.parametrize("count", [1, pytest.param(24, marks=pytest.mark.slow)])
def test_no_scale_error_is_invented(count):
    # At even odds before the flight for one of eight, at most one of 48 results should have one: 2.4 standard errors.
    invented = 0
    for seed in range(count):
        flight = demo_instruments(seed % 6, seed, duration=12.0)
        for aircraft in (flight.aircraft, silent(flight.aircraft)):
            invented += bool(scales_of(reconstruct(flight.measured, aircraft, scales="auto")))
    assert invented <= 0.05 * 2 * count


def test_the_gain_is_that_of_the_likelihood_of_the_innovations():
    # Two filters, with and without the state, against the closed form from the posterior of the first.
    flight = demo_instruments("all-axes", 3, duration=12.0)
    options = ReconstructOptions()
    for by in (1.0, 1.01):
        setup = build_problem(scaled(flight, phi=by), flight.aircraft, options)
        setup = setup.with_verdict(reconstructibility(setup.problem))
        more = _with_constants(setup, ["Kphi"], options).problem
        (at,) = np.flatnonzero(more.active == STATES.index("Kphi"))
        one, other = ukf_filter(more, spread=0.0), ukf_filter(setup.problem, spread=0.0)
        expected = one.log_likelihood - other.log_likelihood
        gain = _log_bayes_factor(one.x[-1, at], one.std[-1, at], more.start_std[at])
        assert gain == pytest.approx(expected, abs=0.2 + 0.01 * abs(expected))


def test_without_scale_errors_in_the_model_the_scale_error_costs_trust():
    flight = demo_instruments("all-axes", 3, duration=12.0)
    found = reconstruct(scaled(flight, phi=1.10), flight.aircraft, scales="none")
    assert not scales_of(found)
    assert any(text.startswith("phi has a scale error of ") for text in found.distrust)
    with pytest.raises(ModelError, match="scales='all'"):
        reconstruct(flight.measured, flight.aircraft, scales="all")


def test_a_scale_error_that_is_named_is_estimated_whatever_its_odds():
    flight = demo_instruments("all-axes", 3, duration=12.0)
    found = reconstruct(flight.measured, flight.aircraft, estimate=(*ESTIMATED, "Kphi"))
    assert set(scales_of(found)) == {"Kphi"}
    assert abs(found["Kphi"].value) < 3.0 * found["Kphi"].std


def test_output_error_finds_the_scale_errors_too():
    flight = demo_instruments("all-axes", 3, duration=15.0)
    found = reconstruct(scaled(flight, theta=1.04, phi=1.07), flight.aircraft, method="output-error", scales="auto")
    scales = scales_of(found)
    assert set(scales) >= {"Kphi", "Ktheta"}
    assert abs(scales["Kphi"].value - 0.07) < 5.0 * scales["Kphi"].std < 0.02
    assert abs(scales["Ktheta"].value - 0.04) < 5.0 * scales["Ktheta"].std < 0.02


def test_longitudinal_channels_have_no_lateral_scale_errors():
    flight = demo_instruments("elevator-3211", 5, duration=12.0)
    kept = ("V", "alpha", "theta", "h", "ax", "az", "q")
    left = ss.Recording("longitudinal", flight.measured.t, {name: flight.measured[name] for name in kept})
    found = reconstruct(left.with_channels(theta=1.06 * left["theta"]), flight.aircraft, scales="auto")
    assert set(scales_of(found)) == {"Ktheta"}
    assert abs(found["Ktheta"].value - 0.06) < 3.0 * found["Ktheta"].std
