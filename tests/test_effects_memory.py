"""Air that remembers."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from structsel.effects.operators import oscillate
from structsel.numerics.dynamic_elements import delayed, first_order_lag, separation_point, varying_lag
from structsel.recording import Recording
from structsel.simulation import Actuator
from tests.effect_fits import best, effect_named, explain
from tests.exact_flights import AIRCRAFT, aerodynamics, compare, fly


def test_lag_and_oscillator_do_what_scipy_does_to_a_signal_linear_between_samples():
    t = np.arange(0.0, 10.0, 0.02)
    x = np.cumsum(np.random.default_rng(2).standard_normal(len(t)))
    from_rest = lsim(([1.0], [0.3, 1.0]), x - x[0], t)[1] + x[0]
    assert_allclose(first_order_lag(x, 0.02, 0.3), from_rest, atol=1e-10)
    w = 2.0 * np.pi * 2.5
    from_rest = lsim(([w**2], [1.0, 0.1 * w, w**2]), x - x[0], t)[1] + x[0]
    assert_allclose(oscillate(x, 0.02, 2.5, 0.05), from_rest, atol=1e-9)


def test_a_delay_moves_a_ramp_by_its_time():
    t = np.arange(0.0, 4.0, 0.02)
    assert_allclose(delayed(t, 0.02, 0.25)[20:], t[20:] - 0.25, atol=1e-12)
    assert_allclose(delayed(t, 0.02, -0.25)[:-20], t[:-20] + 0.25, atol=1e-12)


def test_a_lag_whose_rate_changes_follows_its_equation():
    t = np.arange(0.0, 6.0, 0.01)
    decay = 1.0 + 0.5 * np.sin(t)
    exact = solve_ivp(
        lambda s, z: np.cos(3.0 * s) - (1.0 + 0.5 * np.sin(s)) * z, (0.0, 6.0), [0.0], t_eval=t, rtol=1e-9
    )
    assert_allclose(varying_lag(np.cos(3.0 * t), 0.01, decay), exact.y[0], atol=1e-4)


def stalled(tau1, tau2, onset=0.13, sharp=25.0):
    """Flights whose measured lift is what Goman and Khrabrov leave of the simulated, by an ODE solver."""
    made = []
    for f in compare(fly(size=1.6)):
        alpha, rate = f["alpha"], f["alpha_dot"]

        def move(s, X, f=f, alpha=alpha, rate=rate):
            a, d = np.interp(s, f.t, alpha), np.interp(s, f.t, rate)
            return (0.5 * (1.0 - np.tanh(sharp * (a - tau2 * d - onset))) - X) / tau1

        start = 0.5 * (1.0 - np.tanh(sharp * (alpha[0] - onset)))
        X = solve_ivp(move, (f.t[0], f.t[-1]), [start], t_eval=f.t, rtol=1e-8, max_step=0.1).y[0]
        kept = 0.25 * (1.0 + np.sqrt(X)) ** 2
        sin, cos = np.sin(alpha), np.cos(alpha)
        CL = f.simulated["CX"] * sin - f.simulated["CZ"] * cos
        less = {
            "CX": (kept - 1.0) * CL * sin - 0.1 * (1.0 - X) * cos,
            "CZ": -(kept - 1.0) * CL * cos - 0.1 * (1.0 - X) * sin,
        }
        made.append(replace(f, measured={**f.measured, **{r: f.simulated[r] + x for r, x in less.items()}}))
    return made


def test_a_stall_that_remembers_is_found_with_its_onset_and_the_fraction_of_lift():
    flights = stalled(0.5, 0.12)
    found = best(flights, effect_named("stall-hysteresis"))
    assert found.explained > 0.97
    assert_allclose(found.variant.shape["onset"], 0.13, atol=0.02)
    assert_allclose(found.values["lift lost"], 1.0, rtol=0.25)
    assert_allclose(found.variant.shape["tau1"], 0.5, rtol=0.6)


def test_separation_without_memory_is_the_steady_curve():
    alpha = np.linspace(0.0, 0.3, 50)
    X = separation_point(alpha, np.ones(50), 0.02, 0.0, 0.0, 25.0, 0.15)
    assert_allclose(X, 1.0 / (1.0 + np.exp(50.0 * (alpha - 0.15))), atol=1e-12)


@pytest.mark.parametrize(
    ("effect", "terms", "values"),
    [
        ("downwash-lag", {"Cm": {"alpha_dot_hat": -8.0}, "CZ": {"alpha_dot_hat": -2.5}},
         {"Cm per alpha_dot_hat": -8.0, "CZ per alpha_dot_hat": -2.5}),
        ("sidewash-lag", {"Cn": {"beta_dot_hat": 0.02}, "CY": {"beta_dot_hat": -0.1}},
         {"Cn per beta_dot_hat": 0.02, "CY per beta_dot_hat": -0.1}),
    ],
)  # fmt: skip
def test_a_wake_that_comes_delayed_is_found_in_force_and_moment(effect, terms, values):
    found = best(compare(fly(aerodynamics(terms))), effect_named(effect))
    assert found.explained > 0.93
    for name, value in values.items():
        assert_allclose(found.values[name], value, rtol=0.08)


@pytest.mark.parametrize("axial", [1.0, 0.0])
def test_lift_that_builds_up_is_stated_by_its_kind_whatever_the_axial_force_does(axial):
    # Jones's indicial lift at aspect ratio 3: each change of angle of attack lacks 0.283 exp(-0.540 s) of its lift.
    made = []
    for f in compare(fly()):
        decay = 0.540 * 2.0 * f["V"].mean() / AIRCRAFT.cbar
        missing = -lsim(([0.283], [1.0, decay]), np.gradient(f["alpha"], f.dt), f.t - f.t[0])[1]
        less = {"CZ": -5.58 * missing, "CX": axial * (0.003 + 9.0 * f["alpha"]) * missing, "Cm": -0.9 * missing}
        made.append(replace(f, measured={**f.measured, **{r: f.simulated[r] + x for r, x in less.items()}}))
    variants = {v.about: v for v in effect_named("unsteady-lift").variants(made)}
    found = explain(made, variants["indicial lift of aspect ratio 3"])
    assert found.explained > 0.95
    assert_allclose(found.values["fraction"], 1.0, rtol=0.08)
    assert_allclose(found.values["fraction of the axial force"], axial, atol=0.1)


def test_a_rotor_that_follows_all_controls_delayed_is_found_with_its_lag():
    delayed_by = Actuator(lag=0.15)
    recorded_inputs = {c: lambda x: x for c in ("de", "da", "dr")}
    recordings = []
    for r in fly(actuators=dict.fromkeys(recorded_inputs, delayed_by), true_inputs=recorded_inputs):
        channels = {c: r[c] for c in r.names if c != "t"} | {"collective": np.full(len(r), 0.1)}
        recordings.append(Recording(r.name, r.t, channels, {"collective": "rad"}))
    found = best(compare(recordings), effect_named("rotor-inflow-lag"))
    assert found.explained > 0.98
    assert_allclose(found.values["lag"], 0.15, rtol=0.1)


def test_each_effect_states_the_channels_it_lacks():
    flights = compare(fly())
    assert "rotor" in effect_named("rotor-inflow-lag").needs(flights)
    calm = compare(fly(size=0.05))
    assert "angle of attack above 8 deg" in effect_named("stall-hysteresis").needs(calm)
