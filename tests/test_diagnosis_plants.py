"""Mechanisms and processes that are no aircraft: what their simulations lack is named, with its size."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from structsel.comparison.plant import find_plant
from structsel.comparison.preparing import prepare
from structsel.comparison.tolerances import tolerances_of
from structsel.diagnosis import diagnose
from structsel.effects.operators import oscillate
from structsel.numerics.dynamic_elements import actuate, delayed, first_order_lag
from structsel.recording import Recording

COUNT = 4


def smooth(rng, n, width, size):
    """Random motion."""
    x = gaussian_filter1d(rng.standard_normal(n + 8 * int(width)), width)[4 * int(width) :][:n]
    return size * x / x.std()


def case(make, seed=0):
    """Simulated and recorded runs: `make` gives the clock, the channels and the simulated channels of one."""
    rng = np.random.default_rng(seed)
    recordings, simulated = [], {}
    for k in range(COUNT):
        t, channels, stated = make(rng, k)
        recordings.append(Recording(f"run {k}", t, channels))
        simulated[f"run {k}"] = Recording(f"run {k}", t, stated)
    return simulated, recordings


def joint(friction, simulated):
    """A joint with its current, and the current that its acceleration needs or the acceleration that it causes."""

    def make(rng, k):
        t = 0.01 * np.arange(800)
        place = smooth(rng, len(t), 13.0, 0.5)
        speed = np.gradient(place, 0.01)
        acceleration = np.gradient(speed, 0.01)
        current = 0.02 * acceleration + 0.03 * speed + friction * np.tanh(speed / 0.02)
        read = {
            "place": place + 1e-4 * rng.standard_normal(len(t)),
            "speed": speed + 0.01 * rng.standard_normal(len(t)),
            "acceleration": acceleration + 0.2 * rng.standard_normal(len(t)),
            "current": current + 0.005 * rng.standard_normal(len(t)),
        }
        stated = {
            "current": 0.02 * read["acceleration"] + 0.03 * read["speed"],
            "acceleration": (read["current"] - 0.03 * read["speed"]) / 0.02,
        }
        return t, read, {simulated: stated[simulated]}

    return make


def servo(operator):
    """A servo with a lag of 0.06 s, behind an operator on its command."""

    def make(rng, k):
        t = 0.01 * np.arange(1500)
        command = 0.3 * np.sin(2.0 * np.pi * (0.2 + 0.15 * k) * t + k) + smooth(rng, len(t), 20.0, 0.08)
        place = first_order_lag(operator(t, command), 0.01, 0.06) + 0.001 * rng.standard_normal(len(t))
        return t, {"command": command, "place": place}, {"place": first_order_lag(command, 0.01, 0.06)}

    return make


def heater(rng, k):
    """A process of 80 s, sampled each second, whose input comes 8 s late."""
    t = np.arange(1200.0)
    power = np.repeat(rng.uniform(0.0, 1.0, 20), 60)
    read, stated = (40.0 * first_order_lag(u, 1.0, 80.0) for u in (delayed(power, 1.0, 8.0), power))
    return t, {"power": power, "warmth": read + 0.05 * rng.standard_normal(len(t))}, {"warmth": stated}


def pedal(rng, k):
    """A turn rate by a pedal with a dead zone of 0.1."""
    t = 0.02 * np.arange(1500)
    moved = smooth(rng, len(t), 25.0, 0.2 + 0.1 * k)
    read, stated = (first_order_lag(x, 0.02, 0.67) for x in (moved - np.clip(moved, -0.1, 0.1), moved))
    return t, {"pedal": moved, "turn": read + 0.003 * rng.standard_normal(len(t))}, {"turn": stated}


def slide(rng, k):
    """The speed of a mass of 95 kg on a guide with a damping of 200 N s/m and a dry friction of 20 N."""
    t = 0.005 * np.arange(3000)
    force = smooth(rng, len(t), 60.0, 60.0 + 10.0 * k)
    true, stated = np.zeros(len(t)), np.zeros(len(t))
    for speed, dry in ((true, 20.0), (stated, 0.0)):
        for i in range(len(t) - 1):
            push = force[i] - 200.0 * speed[i] - dry * np.tanh(speed[i] / 0.002)
            speed[i + 1] = speed[i] + 0.005 * push / 95.0
    return t, {"force": force, "speed": true + 0.002 * rng.standard_normal(len(t))}, {"speed": stated}


def hover(rng, k):
    """Velocities over the ground that drag takes along with a wind within 2.9 s, simulated in still air."""
    t = 0.05 * np.arange(600)
    read = {"phi": smooth(rng, len(t), 15.0, 0.1), "theta": smooth(rng, len(t), 15.0, 0.1), "psi": np.zeros(len(t))}
    pulled = {"vn": -9.81 * np.tan(read["theta"]), "ve": 9.81 * np.tan(read["phi"])}
    stated = {c: 2.9 * (first_order_lag(x, 0.05, 2.9) - x[0] * np.exp(-t / 2.9)) for c, x in pulled.items()}
    taken = 1.0 - np.exp(-t / 2.9)
    true = {"vn": stated["vn"] + 3.0 * taken, "ve": stated["ve"] - 2.0 * taken, "vd": np.zeros(len(t))}
    return t, read | {c: x + 0.03 * rng.standard_normal(len(t)) for c, x in true.items()}, stated


@pytest.mark.parametrize(("simulated", "size"), [("current", 0.06), ("acceleration", 3.0)])
def test_friction_is_found_in_the_force_that_a_motion_needs_and_in_what_accelerates_it(simulated, size):
    found = diagnose(*case(joint(0.06, simulated)))
    (finding,) = found.findings
    (physics,) = [p for p in finding.physics if p.effect == "friction"]
    assert physics.probability > 0.9
    assert physics.parameters["force"].value == pytest.approx(size, rel=0.05)
    assert finding.bars[simulated].physics.rrmse < 0.2 * finding.bars[simulated].refitted.rrmse


@pytest.mark.parametrize("simulated", ["current", "acceleration"])
def test_noise_of_the_readings_that_a_simulation_is_computed_from_is_no_mismatch(simulated):
    runs = case(joint(0.0, simulated))
    assert diagnose(*runs).verdict == "consistent"
    assert {f"{simulated}: noise", f"{simulated}: late"} < {n.name for n in tolerances_of(prepare(*runs, None).flights)}


def test_what_is_quick_in_a_simulation_without_noise_is_not_taken_for_noise():
    runs = case(servo(lambda t, x: x))
    assert not [n.name for n in tolerances_of(prepare(*runs, None).flights) if n.name.endswith("noise")]
    assert diagnose(*runs).verdict == "consistent"


def test_a_quick_torque_beside_a_mode_that_opposes_it_is_not_taken_for_noise():
    def motor(rng, k):
        t = 0.004 * np.arange(3000)
        torque = smooth(rng, len(t), 2.5, 1.0)
        acceleration = 20.0 * torque + 8.0 * oscillate(torque, 0.004, 7.0, 0.04) + rng.standard_normal(len(t))
        return t, {"torque": torque, "acceleration": acceleration}, {"acceleration": 20.0 * torque}

    runs = case(motor)
    assert not [n.name for n in tolerances_of(prepare(*runs, None).flights) if n.name.endswith("noise")]
    found = diagnose(*runs)
    assert found.verdict == "mismatch"
    assert found.findings[0].effect == "structural-mode"


def test_the_force_that_a_motion_needs_rises_with_friction():
    senses = [
        find_plant(prepare(*case(joint(0.06, simulated)), None).flights, simulated).sense
        for simulated in ("current", "acceleration")
    ]
    assert senses == [1.0, -1.0]


@pytest.mark.parametrize(
    ("effect", "operator", "name", "value"),
    [
        ("backlash", {"backlash": 0.03}, "width", 0.03),
        ("actuator-rate-limit", {"rate": 0.4}, "rate", 0.4),
    ],
)
def test_play_and_a_rate_limit_before_a_servo_are_found(effect, operator, name, value):
    found = diagnose(*case(servo(lambda t, x: actuate(t, x, **operator))))
    physics = found.findings[0].physics[0]
    assert (physics.effect, found.verdict) == (effect, "mismatch")
    assert physics.parameters[name].value == pytest.approx(value, rel=0.15)


def test_a_delay_is_found_in_the_time_of_the_process():
    physics = diagnose(*case(heater)).findings[0].physics[0]
    assert physics.effect == "actuator-lag"
    delays = [x.value for name, x in physics.parameters.items() if name.startswith("delay")]
    assert sum(delays) == pytest.approx(8.0, rel=0.1)


def test_a_repeatable_mismatch_of_a_process_is_predicted_from_its_past():
    runs = case(servo(lambda t, x: actuate(t, x, rate=0.4)))
    found = diagnose(*runs, without_effects=["actuator-rate-limit", "actuator-lag", "backlash", "saturation"])
    assert "unknown" in {p.effect for f in found.findings for p in f.physics}


def test_a_dead_zone_of_an_input_is_found_with_its_width():
    physics = diagnose(*case(pedal)).findings[0].physics[0]
    assert physics.effect == "control-nonlinearity"
    assert physics.parameters["within"].value == pytest.approx(0.1, abs=0.03)


def test_dry_friction_of_a_speed_is_found_along_the_simulated_speed():
    physics = diagnose(*case(slide)).findings[0].physics[0]
    assert physics.effect == "friction"
    assert physics.parameters["force"].value == pytest.approx(20.0, rel=0.1)


def test_a_wind_takes_velocities_along_that_a_simulation_integrates():
    physics = diagnose(*case(hover)).findings[0].physics[0]
    assert physics.effect == "steady-wind"
    assert [physics.parameters[a].value for a in ("north", "east")] == pytest.approx([3.0, -2.0], abs=0.1)
    assert physics.parameters["time constant"].value == pytest.approx(2.9, rel=0.2)
