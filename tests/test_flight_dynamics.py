"""The compiled flight against dense integration, conservation laws and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from structsel.aircraft import Aircraft
from structsel.candidates import Term
from structsel.demo.aircraft import TRUTH, demo_aircraft
from structsel.demo.flights import integrate
from structsel.errors import ChannelError, DataError, DomainError, ModelError
from structsel.model import AeroModel, ResponseModel
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data, body_to_earth, nondimensional_rates
from structsel.numerics.atmosphere import standard_atmosphere
from structsel.numerics.dynamic_elements import actuate
from structsel.numerics.flight_model import OUTPUTS, REASONS, STATES, outputs_index
from structsel.numerics.flight_simulation import simulate_batch, state_derivatives
from structsel.simulation import Atmosphere, prepare
from tests.models import DEMO, model_of

STATE_COLUMNS = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h")
NOTHING = AeroModel({"CX": ResponseModel((), np.zeros(0))})


def wobble(t, start):
    """Inputs of a short three-axis manoeuvre, smooth enough for any integrator."""
    return start.inputs(
        t,
        de=0.03 * np.sin(1.3 * t) * np.exp(-0.1 * t),
        da=0.04 * np.sin(0.9 * t),
        dr=0.03 * np.sin(0.7 * t + 1.0) - 0.03 * np.sin(1.0),
        thrust=200.0 * np.sin(0.5 * t),
    )


def coefficients(truth, channels):
    return [sum(v * Term(n).evaluate(channels) for n, v in truth[axis].items()) for axis in truth]


def airframe_of(aircraft):
    line = aircraft.thrust
    return rb.Airframe(
        aircraft.mass, aircraft.inertia.tensor, aircraft.S, aircraft.b, aircraft.cbar, line.offset, line.inclination,
        aircraft.engine.angular_momentum,
    )  # fmt: skip


def dense_flight(truth, aircraft, inputs, start, extra=lambda coefficients, channels: coefficients):
    """The same flight by solve_ivp on the uncompiled equations, smooth piece by smooth piece."""
    t = inputs["t"]

    def slope(now, x):
        de, da, dr, thrust = (np.interp(now, t, inputs[c]) for c in ("de", "da", "dr", "thrust"))
        V, alpha, beta = air_data(*x[:3])
        hats = nondimensional_rates(V, x[3], x[4], x[5], aircraft.b, aircraft.cbar)
        values = {
            "alpha": alpha,
            "beta": beta,
            "de": de,
            "da": da,
            "dr": dr,
            **dict(zip(("p_hat", "q_hat", "r_hat"), hats)),
        }
        channels = {name: np.atleast_1d(value) for name, value in values.items()}
        six = [float(c[0]) for c in coefficients(truth, channels)]
        rho = standard_atmosphere(x[11])[2]
        return rb.state_derivative(x, six, rho, airframe_of(aircraft), thrust)

    path = [np.array(start)]
    for a, b in pairwise(t):
        path.append(solve_ivp(slope, (a, b), path[-1], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1])
    return np.array(path)


def aircraft_with(**changes):
    return Aircraft.from_dict(demo_aircraft().to_dict() | changes)


def test_a_flight_is_that_of_a_dense_integrator_on_the_uncompiled_equations(trimmed):
    aircraft = aircraft_with(
        engine={"angular_momentum": 60.0},
        inertia={"Ix": 5368.0, "Iy": 6929.0, "Iz": 11159.0, "Ixz": 118.0, "Ixy": 90.0, "Iyz": -60.0},
    )
    t = np.arange(0.0, 5.01, 0.1)
    inputs = wobble(t, trimmed)
    ready = prepare(DEMO, aircraft, inputs, start=trimmed, substeps=40)
    got = ready.simulate(STATE_COLUMNS).outputs[0]
    assert_allclose(got, dense_flight(TRUTH, aircraft, inputs, trimmed.state), rtol=1e-8, atol=1e-8)


def test_the_error_falls_with_the_fourth_power_of_the_step(trimmed):
    inputs = wobble(np.arange(0.0, 4.01, 0.2), trimmed)
    ends = [
        prepare(DEMO, demo_aircraft(), inputs, start=trimmed, substeps=k).simulate(STATE_COLUMNS).outputs[0, -1]
        for k in (2, 4, 64)
    ]
    first, second = np.abs(ends[0] - ends[2]), np.abs(ends[1] - ends[2])
    # Two neighbouring powers of the step may happen to cancel in one state.
    assert_allclose(np.median(np.log2(first / second)), 4.0, atol=0.3)


def test_the_demonstration_flight_is_simulated_again_from_its_own_surfaces(trimmed):
    simulated = integrate([0], 1, 15.0, 0.0, demo_aircraft(), steps_at="sample")[0]
    assert_allclose(trimmed.state, simulated.states[0, :12], atol=1e-9)
    surfaces = dict(zip(("de", "da", "dr"), simulated.states[:, 12:].T))
    inputs = {"t": simulated.t, "thrust": simulated.thrust, **surfaces}
    got = prepare(DEMO, demo_aircraft(), inputs, start=trimmed).simulate(STATE_COLUMNS).outputs[0]
    # Surfaces straight between samples are not quite those of the actuator's lag.
    for name, column, other in zip(STATE_COLUMNS, got.T, simulated.states.T):
        assert np.abs(column - other).max() < 3e-3 * np.ptp(other), name


def test_tumbling_without_moments_keeps_energy_and_angular_momentum():
    inertia = {"Ix": 900.0, "Iy": 1500.0, "Iz": 2000.0, "Ixz": 150.0, "Ixy": -80.0, "Iyz": 60.0}
    rotor = 120.0
    body = Aircraft(
        name="body", mass=700.0, S=1.0, b=1.0, cbar=1.0, inertia=inertia, engine={"angular_momentum": rotor}
    )
    t = np.arange(0.0, 6.001, 0.01)
    start = {"u": 50.0, "v": 0.0, "w": 0.0, "theta": 0.05, "h": 3000.0, "p": 0.02, "q": 0.05, "r": 0.4}
    ready = prepare(NOTHING, body, {"t": t}, start=start, air=Atmosphere(gravity=0.0))
    batch = ready.simulate(STATE_COLUMNS)
    assert batch.samples[0] == len(t)
    path = batch.outputs[0]
    tensor = body.inertia.tensor
    rates = path[:, 3:6]
    energy = 0.5 * np.einsum("ni,ij,nj->n", rates, tensor, rates)
    assert_allclose(energy, energy[0], rtol=1e-9)
    momentum = rates @ tensor.T + np.array([rotor, 0.0, 0.0])
    in_space = np.einsum("nij,nj->ni", body_to_earth(*path[:, 6:9].T), momentum)
    assert_allclose(in_space, np.tile(in_space[0], (len(t), 1)), atol=1e-7 * np.linalg.norm(in_space[0]))
    # Without forces the velocity over the ground is constant whatever the attitude does.
    turn = Rotation.from_euler("ZYX", path[:, [8, 7, 6]])
    assert_allclose(turn.apply(path[:, :3]), np.tile(turn[0].apply(path[0, :3]), (len(t), 1)), atol=1e-8)
    assert np.ptp(path[:, 6]) > 0.1


def test_a_body_without_air_forces_falls_on_a_parabola_in_the_wind():
    body = Aircraft(name="stone", mass=5.0, S=0.1, b=1.0, cbar=1.0, inertia={"Ix": 1.0, "Iy": 1.0, "Iz": 1.0})
    t = np.linspace(0.0, 8.0, 401)
    V, theta, psi = 60.0, 0.6, 0.4
    start = {"V": V, "alpha": 0.0, "theta": theta, "psi": psi, "h": 800.0}
    ready = prepare(NOTHING, body, {"t": t}, start=start, air=Atmosphere(wind=(3.0, -2.0, 0.5)))
    x, y, h, ax, speed = ready.simulate(("x", "y", "h", "ax", "V")).outputs[0].T
    along, up = V * np.cos(theta), V * np.sin(theta) * t - 0.5 * rb.G0 * t**2
    assert_allclose(x, along * np.cos(psi) * t + 3.0 * t, atol=1e-8)
    assert_allclose(y, along * np.sin(psi) * t - 2.0 * t, atol=1e-8)
    assert_allclose(h, 800.0 + up - 0.5 * t, atol=1e-8)
    assert_allclose(ax, 0.0, atol=1e-12)
    assert_allclose(speed, np.hypot(along, V * np.sin(theta) - rb.G0 * t), atol=1e-8)


def test_wind_that_changes_with_height_changes_the_airspeed_of_a_falling_body():
    body = Aircraft(name="stone", mass=5.0, S=0.1, b=1.0, cbar=1.0, inertia={"Ix": 1.0, "Iy": 1.0, "Iz": 1.0})
    t = np.linspace(0.0, 5.0, 251)
    heights, wind = [0.0, 1000.0], [[0.0, 0.0, 0.0], [-20.0, 0.0, 0.0]]
    start = {"V": 50.0, "alpha": 0.0, "theta": 0.0, "h": 1000.0}
    ready = prepare(NOTHING, body, {"t": t}, start=start, air=Atmosphere(wind=wind, heights=heights))
    speed, vn, h = ready.simulate(("V", "vn", "h")).outputs[0].T
    # Over the ground it keeps 50 - 20 m/s; the head wind dies away below it.
    assert_allclose(vn, 30.0, atol=1e-9)
    fall = rb.G0 * t
    assert_allclose(h, 1000.0 - 0.5 * rb.G0 * t**2, atol=1e-8)
    assert_allclose(speed, np.hypot(30.0 + 20.0 * h / 1000.0, fall), atol=1e-8)


def test_rates_of_the_flow_in_the_coefficients_are_solved_for_exactly(trimmed):
    truth = {name: dict(terms) for name, terms in TRUTH.items()}
    truth["CY"]["beta_dot_hat"] = -1.6
    truth["Cn"]["beta*beta_dot_hat"] = 0.3
    truth["CZ"]["alpha_dot_hat"] = -7.0
    truth["Cm"]["alpha_dot_hat"] = -9.0
    aircraft = demo_aircraft()
    ready = prepare(model_of(truth), aircraft, trimmed.inputs(np.array([0.0, 1.0])), start=trimmed)
    state = trimmed.state + np.array([1.0, 2.0, -1.5, 0.1, 0.08, -0.05, 0.1, 0.05, 0.0, 0.0, 0.0, 0.0])
    controls = np.array([trimmed.controls[name] + 0.02 for name in ready.compiled.controls])
    slope, outputs = state_derivatives(ready.compiled, ready.manoeuvre, state[None], controls[None])
    held = dict(zip(OUTPUTS, outputs[0]))
    V, alpha, beta = air_data(*state[:3])
    hats = nondimensional_rates(V, *state[3:6], aircraft.b, aircraft.cbar)
    channels = {"alpha": alpha, "beta": beta, **dict(zip(("p_hat", "q_hat", "r_hat"), hats)),
                **dict(zip(ready.compiled.controls, controls))}  # fmt: skip
    channels["alpha_dot_hat"] = held["alpha_dot"] * aircraft.cbar / (2 * V)
    channels["beta_dot_hat"] = held["beta_dot"] * aircraft.b / (2 * V)
    channels = {name: np.atleast_1d(value) for name, value in channels.items()}
    six = [float(c[0]) for c in coefficients(truth, channels)]
    thrust = controls[ready.compiled.controls.index("thrust")]
    dense = rb.state_derivative(state, six, standard_atmosphere(state[11])[2], airframe_of(aircraft), thrust)
    assert_allclose(slope[0], dense, rtol=1e-11, atol=1e-11)
    # The rates reported are those of the velocity.
    assert_allclose(held["alpha_dot"], (state[0] * dense[2] - state[2] * dense[0]) / (state[0] ** 2 + state[2] ** 2))
    assert abs(channels["beta_dot_hat"][0]) > 1e-3


# --- batches ---------------------------------------------------------------------------------------------------


def test_a_batch_is_what_each_set_flies_alone(trimmed):
    ready = prepare(DEMO, demo_aircraft(), wobble(np.arange(0.0, 4.0, 0.02), trimmed), start=trimmed)
    names = ["Cm:alpha", "CZ:alpha", "start:w", "bias:de", "drift:q", "Cl:p_hat", "delay", "Cup"]
    nominal = ready.compiled.parameters(ready.manoeuvre)[ready.compiled.parameter_index(names)]
    rng = np.random.default_rng(4)
    theta = nominal * (1.0 + 0.1 * rng.standard_normal((7, 8))) + np.abs(rng.normal(0.0, 0.01, (7, 8)))
    together = ready.simulate(("V", "alpha", "q", "ay"), names, theta, instruments=True)
    for row, outputs in zip(theta, together.outputs):
        assert_array_equal(
            ready.simulate(("V", "alpha", "q", "ay"), names, row[None], instruments=True).outputs[0], outputs
        )
    assert together.outputs.flags.c_contiguous
    assert np.ptp(together.outputs, axis=0).max() > 1.0


def test_parameters_by_name_act_on_the_named_coefficient(trimmed):
    ready = prepare(DEMO, demo_aircraft(), trimmed.inputs(np.arange(0.0, 2.0, 0.02)), start=trimmed)
    names = ["start:w", "bias:de", "drift:psi", "Calpha0", "KV"]
    nominal = ready.compiled.parameters(ready.manoeuvre)[ready.compiled.parameter_index(names)]
    theta = nominal + np.diag([0.7, 0.01, 0.03, 0.02, 0.05])
    outputs = ("w", "q_dot", "psi", "alpha", "V")
    plain = ready.simulate(outputs, instruments=True).outputs[0]
    got = ready.simulate(outputs, names, theta, instruments=True).outputs
    assert_allclose(got[0, 0, 0] - plain[0, 0], 0.7)
    qbar = 0.5 * standard_atmosphere(1000.0)[2] * 45.0**2
    moment = TRUTH["Cm"]["de"] * 0.01 * qbar * 23.23 * 1.5875 / 6928.93
    assert_allclose(got[1, 0, 1] - plain[0, 1], moment, rtol=1e-9)
    assert_allclose(got[2, -1, 2] - plain[-1, 2], 0.03 * 1.98, rtol=1e-6)
    assert_allclose(got[3, :, 3] - plain[:, 3], 0.02, atol=1e-12)
    assert_allclose(got[4, :, 4], 1.05 * plain[:, 4], rtol=1e-12)


@pytest.mark.parametrize("between", ["linear", "hold"])
def test_a_delay_is_the_inputs_moved_by_hand(trimmed, between):
    t = np.arange(0.0, 3.0, 0.02)
    inputs = wobble(t, trimmed)
    shifted = {name: np.concatenate([np.full(7, values[0]), values[:-7]]) for name, values in inputs.items()}
    shifted["t"] = t
    delayed = prepare(DEMO, demo_aircraft(), inputs, start=trimmed, between=between)
    moved = prepare(DEMO, demo_aircraft(), shifted, start=trimmed, between=between)
    got = delayed.simulate(("alpha", "q", "p", "r", "az"), ["delay"], np.array([[7 * 0.02]])).outputs
    assert_allclose(got, moved.simulate(("alpha", "q", "p", "r", "az")).outputs, atol=1e-11)


def test_a_delay_between_samples_is_interpolated(trimmed):
    t = np.arange(0.0, 3.0, 0.02)
    ready = prepare(DEMO, demo_aircraft(), trimmed.inputs(t, de=0.05 * np.minimum(t, 1.0)), start=trimmed)
    without, delayed = (ready.simulate(("q",), ["delay"], np.array([[d]])).outputs[0, :, 0] for d in (0.0, 0.033))
    assert_allclose(delayed[60], CubicSpline(t, without)(t[60] - 0.033), atol=2e-6)


def test_held_inputs_change_at_their_sample_and_linear_ones_between(trimmed):
    t = np.arange(0.0, 1.01, 0.1)
    step = np.where(t >= 0.5 - 1e-9, 0.02, 0.0)
    for between, first in (("hold", 6), ("linear", 5)):
        ready = prepare(DEMO, demo_aircraft(), trimmed.inputs(t, de=step), start=trimmed, between=between)
        q = ready.simulate(("q",)).outputs[0, :, 0]
        assert np.flatnonzero(np.abs(q) > 1e-9)[0] == first


def test_a_set_that_blows_up_is_flagged_with_its_sample_and_leaves_the_others_alone(trimmed):
    t = np.arange(0.0, 20.0, 0.02)
    ready = prepare(DEMO, demo_aircraft(), trimmed.inputs(t, de=np.where(t > 0.1, 0.01, 0.0)), start=trimmed)
    names = ["Cm:alpha", "Cm:q_hat", "CX:1"]
    good = [TRUTH["Cm"]["alpha"], TRUTH["Cm"]["q_hat"], TRUTH["CX"]["1"]]
    theta = np.array([good, [40.0, 500.0, 0.0], good, [good[0], good[1], 1e6]])
    batch = ready.simulate(("alpha", "q"), names, theta)
    assert batch.samples[0] == batch.samples[2] == len(t)
    assert_array_equal(batch.outputs[0], batch.outputs[2])
    for j in (1, 3):
        k = batch.samples[j]
        assert 0 < k < len(t)
        assert batch.reason[j] > 0
        assert np.isfinite(batch.outputs[j, :k]).all()
        assert np.isnan(batch.outputs[j, k:]).all()


@pytest.mark.parametrize(
    ("start", "model", "said"),
    [
        ({"V": 40.0, "alpha": 0.0, "theta": 0.3, "q": 1.0, "h": 500.0}, {}, "pitch attitude reached 90"),
        ({"V": 0.4, "alpha": 0.0, "theta": 0.0, "h": 500.0}, {"CX": {"1": -2e4}}, "airspeed fell to zero"),
        ({"V": 300.0, "alpha": 0.0, "theta": -1.4, "h": -4500.0}, {}, "left the standard atmosphere"),
        ({"V": 40.0, "alpha": 0.0, "theta": 0.3, "h": 500.0}, {"CX": {"log(0.1 - theta)": 1.0}}, "no longer finite"),
    ],
)
def test_every_reason_to_stop_is_reported(start, model, said):
    body = Aircraft(name="stone", mass=5.0, S=0.1, b=1.0, cbar=1.0, inertia={"Ix": 1.0, "Iy": 1.0, "Iz": 1.0})
    gravity = 0.0 if "airspeed" in said else rb.G0
    ready = prepare(
        model_of(model) if model else NOTHING, body, {"t": np.arange(0.0, 5.0, 0.01)}, start=start,
        air=Atmosphere(gravity=gravity),
    )  # fmt: skip
    batch = ready.simulate(("h",))
    assert said in REASONS[batch.reason[0]]
    assert batch.samples[0] < 500


def test_names_and_sizes_that_do_not_fit_are_refused(trimmed):
    ready = prepare(DEMO, demo_aircraft(), trimmed.inputs(np.array([0.0, 0.1, 0.2])), start=trimmed)
    with pytest.raises(ModelError, match="no parameter 'Cm:gamma'"):
        ready.simulate(("V",), ["Cm:gamma"], np.zeros((1, 1)))
    with pytest.raises(ChannelError, match="no output 'banana'"):
        outputs_index(["banana"])
    with pytest.raises(DataError, match="2 columns for 1 parameters"):
        ready.simulate(("V",), ["delay"], np.zeros((1, 2)))
    with pytest.raises(DomainError, match="at least 1 step"):
        simulate_batch(
            ready.compiled, ready.manoeuvre, np.zeros((1, 0)), np.array([], dtype=int), np.array([0]), substeps=0
        )
    assert ready.compiled.parameter_names[-6:] == ("delay", "Cup", "Calpha0", "Csi", "Cbeta0", "KV")
    assert STATES == STATE_COLUMNS


# --- actuators -------------------------------------------------------------------------------------------------

CLOCK = np.arange(0.0, 4.0, 0.02)


def test_a_lag_answers_a_held_step_with_the_exponential():
    step = np.where(CLOCK >= 1.0 - 1e-9, 0.2, 0.0)
    got = actuate(CLOCK, step, lag=0.15, hold=True)
    after = np.maximum(CLOCK - 1.0, 0.0)
    assert_allclose(got, 0.2 * (1.0 - np.exp(-after / 0.15)), atol=1e-12)


def test_a_lag_follows_a_ramp_delayed_by_its_time_constant():
    got = actuate(CLOCK, 0.1 * CLOCK, lag=0.1)
    assert_allclose(got, 0.1 * (CLOCK - 0.1 * (1.0 - np.exp(-CLOCK / 0.1))), atol=1e-5)


def test_a_rate_limit_bounds_the_slope_and_stops_bound_the_travel():
    step = np.where(CLOCK >= 0.5, 1.0, 0.0)
    got = actuate(CLOCK, step, lag=0.05, rate=0.5, high=0.6, hold=True)
    assert np.diff(got).max() <= 0.5 * 0.02 + 1e-12
    assert_allclose(got[50] - got[40], 0.5 * 0.2, rtol=1e-9)
    assert got.max() == 0.6


def test_backlash_lets_the_command_turn_before_the_surface_does():
    command = 0.1 * np.sin(2.0 * np.pi * 0.5 * CLOCK)
    got = actuate(CLOCK, command, backlash=0.04)
    assert_allclose(np.abs(got - command).max(), 0.02, atol=1e-9)
    top = int(np.argmax(command[:100]))
    turned = np.flatnonzero(np.diff(got[top:]) < -1e-12)[0]
    assert command[top + turned + 1] < command[top] - 0.04 + 1e-3 < command[top + turned - 1] + 2e-3
    assert_allclose(got[top : top + turned], got[top], atol=2e-5)


def test_backlash_begins_on_the_side_that_is_given():
    still = np.full(len(CLOCK), 0.3)
    assert [actuate(CLOCK, still, backlash=0.04, start=x)[-1] for x in (-1.0, 0.0, 0.5)] == pytest.approx(
        [0.28, 0.3, 0.31]
    )


def test_an_actuator_that_cannot_be_is_refused():
    with pytest.raises(DomainError, match="limits ascend"):
        actuate(CLOCK, CLOCK, low=0.1, high=-0.1)
