"""Verdict of a reconstruction where its methods contradict each other, or where its noise was only estimated."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy

import structsel as ss
from structsel.aircraft import Aircraft
from structsel.demo import demo_instruments
from structsel.numerics.kinematics import STATES
from structsel.reconstruction import CONSTANTS, Constant, ReconstructOptions, reconstruct
from structsel.reconstruction.innovations import Consistency
from structsel.reconstruction.method_comparison import compare_methods
from structsel.reconstruction.noise_levels import _within_limits, largest_inertial_noise
from structsel.reconstruction.observability import reconstructibility
from structsel.reconstruction.problem import build_problem
from structsel.reconstruction.quality_checks import noise_above_limit, unconfirmed
from structsel.reconstruction.result import ESTIMATED_ONLY
from structsel.reconstruction.ukf import ukf_smoother

DATA = Path(__file__).parents[2] / "shared" / "data"


def silent(aircraft):
    content = aircraft.to_dict()
    for sensor in content["sensors"].values():
        sensor.pop("noise", None)
    return Aircraft.from_dict(content)


@pytest.mark.parametrize("count", [2, pytest.param(24, marks=pytest.mark.slow)])
def test_flights_without_faults_are_trusted_whether_their_noise_is_stated_or_not(count):
    for seed in range(count):
        flight = demo_instruments(seed % 6, seed, duration=6.0)
        for aircraft in (flight.aircraft, silent(flight.aircraft)):
            found = reconstruct(flight.measured, aircraft)
            assert found.verdict == "trusted", found.distrust


def test_an_estimated_noise_widens_the_lower_limit_of_nis_a_stated_one_does_not():
    flight = demo_instruments(1, 1, duration=6.0)
    stated, estimated = (
        reconstruct(flight.measured, a).consistency for a in (flight.aircraft, silent(flight.aircraft))
    )
    # 301 samples of every channel: 2 x 1.3 / sqrt(301) = 0.15.
    assert not stated.noise_estimated
    assert estimated.nis_band[0] == pytest.approx(0.85 * stated.nis_band[0], rel=0.01)
    assert estimated.nis_band[1] == pytest.approx(stated.nis_band[1], rel=0.01)


@pytest.mark.parametrize(
    ("nis", "estimated", "reasons"), [(0.8, True, 1), (0.8, False, 0), (1.0, True, 0), (1.2, True, 1)]
)
def test_nis_outside_its_band_is_a_reason_only_with_estimated_noise(nis, estimated, reasons):
    found = unconfirmed(Consistency((), nis, (0.9, 1.1), estimated))
    assert len(found) == reasons
    assert all(f"NIS is {nis:.3f}, and its 95 % band is 0.900 to 1.100" in text for text in found)


@pytest.mark.parametrize(
    ("name", "unit", "noise"), [("az", "m/s^2", 0.02), pytest.param("q", "rad/s", 5e-4, marks=pytest.mark.slow)]
)
def test_a_scale_error_that_is_taken_for_noise_is_named_with_what_the_high_frequencies_allow(name, unit, noise):
    # A scale error of 50 %. Below 8 times the noise that was set: the motion itself has power in the third octave.
    flight = demo_instruments("all-axes", 3, duration=15.0)
    values = flight.measured[name]
    scaled = values.mean() + 1.5 * (values - values.mean())
    found = reconstruct(flight.measured.with_channels(**{name: scaled}), silent(flight.aircraft))
    level = {n.channel: n.std for n in found.noise}[name]
    (text,) = (reason for reason in found.distrust if "more noise was estimated" in reason)
    assert text.startswith(ESTIMATED_ONLY)
    estimated, largest = re.search(rf"{name} ([\d.e-]+) {re.escape(unit)} \(at most ([\d.e-]+)\)", text).groups()
    assert float(estimated) == pytest.approx(level, rel=0.01)
    assert noise < float(largest) < min(8.0 * 1.5 * noise, level)


def test_a_noise_level_above_its_limit_is_reduced_to_it_unless_it_is_more_likely():
    flight = demo_instruments("all-axes", 3, duration=6.0)
    setup = build_problem(flight.measured, silent(flight.aircraft), ReconstructOptions())
    limits = [largest_inertial_noise(setup.problem, j) / setup.noise[name] for j, name in enumerate(("ax", "ay", "az"))]
    # Twenty times the noise that was set is much less likely than the limit.
    noisy = replace(setup.problem, input_std=setup.problem.input_std * np.r_[20.0, 20.0, 20.0, 1.0, 1.0, 1.0])
    assert _within_limits(setup, noisy, [0, 1, 2], np.full(3, 20.0)) == pytest.approx(limits)
    assert _within_limits(setup, setup.problem, [0, 1, 2], np.ones(3)) == pytest.approx(np.ones(3))
    # Readings that need the noise keep it: a scale error of 50 % of az.
    scaled = 1.5 * flight.measured["az"] + 4.9
    wrong = build_problem(flight.measured.with_channels(az=scaled), silent(flight.aircraft), ReconstructOptions())
    noisy = replace(wrong.problem, input_std=wrong.problem.input_std * np.r_[20.0, 20.0, 20.0, 1.0, 1.0, 1.0])
    assert _within_limits(wrong, noisy, [0, 1, 2], np.full(3, 20.0)) == pytest.approx(np.full(3, 20.0))


def test_noise_that_is_stated_or_in_the_readings_is_no_reason():
    flight = demo_instruments("all-axes", 3, duration=6.0)
    rng = np.random.default_rng(4)
    noisy = flight.measured.with_channels(az=flight.measured["az"] + 0.5 * rng.standard_normal(len(flight.measured)))
    found = reconstruct(noisy, silent(flight.aircraft))
    level = {n.channel: n.std for n in found.noise}["az"]
    assert level == pytest.approx(0.5, rel=0.3)
    assert not any("more noise was estimated" in reason for reason in found.distrust)
    stated = build_problem(flight.measured, flight.aircraft, ReconstructOptions(noise={"az": 5.0}))
    assert noise_above_limit(stated) == ()


def test_the_verdict_names_the_estimated_noise_only_if_there_is_no_other_reason():
    flight = demo_instruments(0, 1, duration=4.0)
    found = reconstruct(flight.measured, flight.aircraft)
    one = replace(found, distrust=(f"{ESTIMATED_ONLY}: NIS is 0.8",))
    assert not one.trusted
    assert one.verdict == "consistent with estimated noise only"
    assert "unscented, consistent with estimated noise only" in str(one)
    assert one.to_dict()["verdict"] == one.verdict
    assert replace(one, distrust=("it does not fit", *one.distrust)).verdict == "NOT TRUSTED"


@pytest.fixture(scope="module")
def filtered():
    """Problem, filter run and constants of a flight without faults."""
    flight = demo_instruments("all-axes", 3, duration=8.0)
    setup = build_problem(flight.measured, flight.aircraft, ReconstructOptions())
    setup = setup.with_verdict(reconstructibility(setup.problem))
    run, smooth = ukf_smoother(setup.problem)
    constants = {
        name: Constant(name, smooth.x[-1, j], smooth.std[-1, j], smooth.std[-1, j], CONSTANTS[name][1])
        for j, name in enumerate(setup.names)
        if name in CONSTANTS
    }
    return setup.problem, run, constants


def test_a_constant_that_other_methods_estimate_otherwise_is_named_with_both_values(filtered):
    problem, run, constants = filtered
    assert compare_methods(problem, "unscented", run, constants.values()) == ((), ())
    right = constants["Cup"]
    wrong = constants | {"Cup": replace(right, value=right.value + 10.0 * right.std)}
    _, found = compare_methods(problem, "unscented", run, wrong.values())
    assert [text.split(":")[0] for text in found] == [
        "extended contradicts unscented",
        "output error contradicts unscented",
    ]
    assert all(text.count(" +- ") == 2 and f"({wrong['Cup'].value:+.3g} +- {right.std:.2g})" in text for text in found)


def test_a_constant_that_drifts_is_not_compared_and_output_error_compares_nothing(filtered):
    problem, run, constants = filtered
    wrong = replace(constants["bq"], value=1.0)
    drift = np.where(np.arange(len(STATES)) == STATES.index("bq"), 1e-3, 0.0)
    assert compare_methods(replace(problem, drift=drift), "unscented", run, [wrong]) == ((), ())
    assert compare_methods(problem, "output-error", run, [wrong]) == ((), ())


@pytest.mark.parametrize(("name", "which"), [("theta", 0), pytest.param("phi", 5, marks=pytest.mark.slow)])
def test_a_scale_error_of_an_attitude_angle_is_named_with_its_size(name, which):
    flight = demo_instruments(which, which, duration=12.0)
    angle = flight.measured[name]
    scaled = flight.measured.with_channels(**{name: angle[0] + 1.12 * (angle - angle[0])})
    found = reconstruct(scaled, flight.aircraft, scales="none")
    (text,) = (reason for reason in found.distrust if reason.startswith(f"{name} has a scale error of "))
    size, error = (float(number) for number in re.findall(r"([\d.]+)%", text))
    assert abs(size - 12.0) < 3.0 * error


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings (../shared/data) are not here")
@pytest.mark.parametrize(
    ("file", "channels", "scales"),
    [("compat_lon_example", "map_lon", {"theta": 3.9}), ("compat_lat_example", "map_lat", {"phi": 7.1})],
)
def test_the_attitude_scale_errors_of_harv_are_those_of_sidpac_and_cost_trust(file, channels, scales):
    folder = DATA / "f18-harv"
    recording = ss.read_recording(folder / f"{file}.mat", folder / f"{channels}.toml")
    found = reconstruct(recording, Aircraft.from_toml(folder / "aircraft.toml"), scales="none")
    assert not found.trusted
    for name, scale in scales.items():
        (text,) = (reason for reason in found.distrust if reason.startswith(f"{name} has a scale error of +"))
        size, error = (float(number) for number in re.findall(r"([\d.]+)%", text))
        assert abs(size - scale) < 2.0 * error


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings (../shared/data) are not here")
@pytest.mark.parametrize(("file", "channels"), [("compat_lon_example", "map_lon"), ("dcmp_lon_example", "map_153b")])
def test_harv_upwash_has_the_sign_and_size_of_sidpac_s_or_is_not_trusted(file, channels):
    # SIDPAC's stored value of 250h is +0.0762; 153b has no stored value, an independent fit gives +0.066 +- 0.079.
    folder = DATA / "f18-harv"
    recording = ss.read_recording(folder / f"{file}.mat", folder / f"{channels}.toml")
    found = reconstruct(recording, Aircraft.from_toml(folder / "aircraft.toml"))
    upwash = found["Cup"]
    assert not found.trusted or abs(upwash.value - 0.0762) < 2.0 * np.hypot(upwash.std, 0.0176)
    # The estimated noise exceeds the signals themselves; the verdict must state it.
    assert any("more noise was estimated" in reason and "az " in reason for reason in found.distrust)


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings (../shared/data) are not here")
@pytest.mark.parametrize(
    ("file", "channels", "sidpac"),
    [
        # Values of SIDPAC with this package's signs, and standard deviations for coloured residuals; those of 153b are
        # of the same model, fitted independently.
        (
            "compat_lon_example",
            "map_lon",
            {"Cup": (0.0762, 0.0176), "bq": (-0.00178, 1e-4), "bax": (0.0508, 0.0125), "baz": (0.0408, 0.0088),
             "Ktheta": (0.0387, 0.0072)},
        ),
        (
            "dcmp_lon_example",
            "map_153b",
            {"Cup": (0.066, 0.079), "bq": (-0.0002, 1e-4), "baz": (0.269, 0.057), "Ktheta": (0.0524, 0.0085)},
        ),
        ("compat_lat_example", "map_lat", {"bp": (2.9e-4, 1e-4), "br": (1.02e-3, 1e-4), "bay": (-0.001, 0.018),
                                           "Csi": (0.0949, 0.048), "Kphi": (0.0706, 0.0046)}),
    ],
)  # fmt: skip
def test_harv_with_scale_errors_has_the_constants_of_sidpac(file, channels, sidpac):
    folder = DATA / "f18-harv"
    recording = ss.read_recording(folder / f"{file}.mat", folder / f"{channels}.toml")
    found = reconstruct(recording, Aircraft.from_toml(folder / "aircraft.toml"), scales="auto")
    off = {n: (found[n].value - v) / np.hypot(found[n].std, std) for n, (v, std) in sidpac.items()}
    assert max(map(abs, off.values())) < 4.1, off
    assert np.sqrt(np.mean(np.square(list(off.values())))) < 2.0, off
    assert abs(off.get("Cup", 0.0)) < 1.0
    assert not any("Cup = " in reason for reason in found.distrust)


@pytest.mark.parametrize("seed", [3, pytest.param(1, marks=pytest.mark.slow), pytest.param(6, marks=pytest.mark.slow)])
def test_a_delayed_vane_changes_neither_the_angle_of_attack_nor_the_upwash(seed):
    # Without ground velocity only the vane and the altitude contradict the accelerometers. Noise of the accelerometers
    # that the readings do not have would make the path follow the vane: 1.6 to 2.4e-3 rad, and an upwash of +0.2.
    flight = demo_instruments(seed % 6, seed, duration=15.0)
    measured, truth = flight.measured, flight.truth["alpha"]
    channels = {n: measured[n] for n in measured.names if n not in ("x", "y", "vn", "ve", "vd")}
    channels["alpha"] = np.interp(measured.t - 0.06, measured.t, channels["alpha"])
    found = reconstruct(ss.Recording(measured.name, measured.t, channels), silent(flight.aircraft))
    assert np.sqrt(np.mean((found.recording["alpha"] - truth) ** 2)) < 0.7e-3
    assert abs(found["Cup"].value - flight.errors["Cup"]) < 2.0 * found["Cup"].std
    (delay,) = (d for d in found.delays if d.channel == "alpha")
    assert delay.delay == pytest.approx(0.06, abs=0.02)


@pytest.mark.parametrize("seed", [5, pytest.param(3, marks=pytest.mark.slow)])
def test_an_altitude_that_is_wrong_for_seconds_is_not_followed(seed):
    # 3 m with a correlation time of 1.5 s. With the weights of white noise the angle of attack is wrong by 5e-3 rad.
    flight = demo_instruments(seed % 6, seed, duration=15.0)
    measured, rng = flight.measured, np.random.default_rng(seed)
    channels = {n: measured[n] for n in measured.names if n not in ("x", "y", "vn", "ve", "vd")}
    a = np.exp(-measured.dt / 1.5)
    slow = scipy.signal.lfilter([3.0 * np.sqrt(1.0 - a * a)], [1.0, -a], rng.standard_normal(len(measured)))
    channels["h"] = channels["h"] + slow
    found = reconstruct(ss.Recording(measured.name, measured.t, channels), silent(flight.aircraft))
    assert np.sqrt(np.mean((found.recording["alpha"] - flight.truth["alpha"]) ** 2)) < 2.5e-3
    assert abs(found["Cup"].value - flight.errors["Cup"]) < 2.0 * found["Cup"].std
