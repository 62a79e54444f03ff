"""Faults planted in simulated flights: each is named, with channel, sample and remedy, and survived where it can be."""

import numpy as np
import pytest

from structsel.aircraft import Aircraft
from structsel.demo import demo_flight, demo_instruments
from structsel.demo.aircraft import demo_aircraft
from structsel.errors import DataError
from structsel.numerics import kinematics as fp
from structsel.reconstruction import reconstruct
from structsel.recording import Recording

GPS = ("x", "y", "vn", "ve", "vd")


@pytest.fixture(scope="module")
def flight():
    return demo_instruments("all-axes", 3)


def change(flight, aircraft=None, **channels):
    return reconstruct(flight.measured.with_channels(**channels), aircraft or flight.aircraft)


def edited(flight, name, edit):
    values = flight.measured[name].copy()
    made = edit(values, flight.measured.t)
    return {name: values if made is None else made}


def stuck_from_8_to_11_s(values, t):
    there = (t >= 8.0) & (t < 11.0)
    values[there] = values[np.argmax(there)]


def missing(first, last):
    def edit(values, t):
        values[(t >= first) & (t < last)] = np.nan

    return edit


def limited(fraction):
    def edit(values, t):
        middle = np.median(values)
        reach = fraction * np.abs(values - middle).max()
        return np.clip(values, middle - reach, middle + reach)

    return edit


def assert_as_good_as_without_fault(found, flight):
    # Three times the errors of the same flight without fault: V 0.005 m/s, angles 1e-4 rad.
    assert found.trusted, str(found)
    for channel, limit in (("V", 0.02), ("alpha", 5e-4), ("beta", 5e-4), ("theta", 5e-4)):
        left = found.recording[channel] - flight.truth[channel]
        assert np.sqrt(np.mean(left**2)) < limit, channel


def kinds(found, channel):
    return {f.kind for f in found.findings if f.channel == channel}


@pytest.mark.default_cases("alpha")
@pytest.mark.parametrize("name", ["alpha", "V", "theta", "psi"])
def test_a_measurement_missing_for_six_seconds_is_named_and_done_without(flight, name):
    found = change(flight, **edited(flight, name, missing(8.0, 14.0)))
    assert_as_good_as_without_fault(found, flight)
    (finding,) = (f for f in found.findings if f.channel == name)
    assert (finding.kind, finding.sample, finding.time, finding.count) == ("missing", 400, 8.0, 300)


@pytest.mark.default_cases("V")
@pytest.mark.parametrize("name", ["alpha", "V", "theta", "beta"])
def test_a_measurement_stuck_for_three_seconds_is_named_and_done_without(flight, name):
    found = change(flight, **edited(flight, name, stuck_from_8_to_11_s))
    assert_as_good_as_without_fault(found, flight)
    (finding,) = (f for f in found.findings if f.channel == name)
    assert (finding.kind, finding.sample, finding.count) == ("stuck", 400, 150)


@pytest.mark.parametrize("name", ["ax", "az", "p", "q"])
def test_an_inertial_channel_stuck_for_three_seconds_is_refused_with_the_part_to_take(flight, name):
    message = rf"without '{name}'.* from sample 400 \(t = 8 s\) to 549 \(stuck\)[^$]*between\(11, 30\) is the longest"
    with pytest.raises(DataError, match=message):
        change(flight, **edited(flight, name, stuck_from_8_to_11_s))


@pytest.mark.default_cases("ax")
@pytest.mark.parametrize("name", ["ax", "az", "q"])
def test_a_short_hole_in_an_inertial_channel_is_bridged_and_said_a_long_one_refused(flight, name):
    found = change(flight, **edited(flight, name, missing(8.0, 8.3)))
    assert_as_good_as_without_fault(found, flight)
    assert kinds(found, name) == {"missing", "bridged"}
    assert any(f"{name}: 15 samples in 1 gap interpolated" in warning for warning in found.doubts)
    with pytest.raises(DataError, match=f"'{name}'.* lacks it for 4.98 s, from sample 400"):
        change(flight, **edited(flight, name, missing(8.0, 13.0)))


@pytest.mark.default_cases("0.5-alpha")
@pytest.mark.parametrize("name", ["alpha", "beta"])
@pytest.mark.parametrize("fraction", [0.5, 0.75])
def test_a_vane_at_its_stop_is_named_and_done_without_there(flight, name, fraction):
    found = change(flight, **edited(flight, name, limited(fraction)))
    assert_as_good_as_without_fault(found, flight)
    assert kinds(found, name) & {"saturated", "stuck"}
    # The rest of the channel is not biased by where it was cut: its corrections are still found.
    for constant in ("Calpha0", "Cup", "Csi"):
        assert abs(found[constant].value - flight.errors[constant]) < 4.0 * found[constant].std


@pytest.mark.default_cases("q")
@pytest.mark.parametrize("name", ["p", "q", "az"])
def test_a_saturated_inertial_channel_is_named_and_the_path_stays_within_its_uncertainty(flight, name):
    found = change(flight, **edited(flight, name, limited(0.6)))
    assert kinds(found, name) & {"saturated", "stuck"}
    if found.trusted:
        for channel in ("alpha", "theta"):
            left = np.sqrt(np.mean((found.recording[channel] - flight.truth[channel]) ** 2))
            assert left < 3.0 * np.sqrt(np.mean(found.std[channel] ** 2)), channel
    else:
        assert found.distrust[0].startswith(f"{name}: ")


@pytest.mark.parametrize("name", ["ax", "ay", "az", "p", "q", "r", "alpha", "beta", "theta", "phi", "psi"])
def test_a_channel_of_the_wrong_sign_is_refused_by_its_own_name(flight, name):
    with pytest.raises(DataError, match=f"^reconstruct: '{name}' seems to have the wrong sign .sign = -1"):
        change(flight, **{name: -flight.measured[name]})


@pytest.mark.parametrize("names", [("alpha",), ("beta",), ("theta",), ("phi",), ("psi",), ("q",), ("p", "q", "r"),
                                   ("phi", "theta", "psi", "alpha", "beta")])  # fmt: skip
def test_degrees_fed_as_radians_are_refused_by_name(flight, names):
    listed = "'" + "', '".join(names) + "'" if len(names) == 1 else f"'{names[0]}'.* and '{names[-1]}'"
    with pytest.raises(DataError, match=f"^reconstruct: {listed} seems? to be in degrees, fed as radians"):
        change(flight, **{name: np.degrees(flight.measured[name]) for name in names})


@pytest.mark.parametrize(
    ("names", "factor", "unit"),
    [(("ax", "ay", "az"), 1.0 / 9.80665, 'unit = "g"'), (("az",), 1.0 / 9.80665, 'unit = "g"'),
     (("V",), 1.94384, 'unit = "kt"'), (("h",), 3.28084, 'unit = "ft"')],
)  # fmt: skip
def test_other_units_fed_wrongly_are_refused_with_the_unit(flight, names, factor, unit):
    with pytest.raises(DataError, match=f"'{names[0]}'.*{unit}"):
        change(flight, **{name: factor * flight.measured[name] for name in names})


@pytest.mark.parametrize(("sensor", "word"), [("vane", "vanes"), ("accelerometer", "accelerometers")])
def test_an_instrument_on_the_wrong_side_of_the_centre_of_gravity_is_distrusted_first(flight, sensor, word):
    content = flight.aircraft.to_dict()
    content["sensors"][sensor]["position"][0] *= -1.0
    found = reconstruct(flight.measured, Aircraft.from_dict(content))
    assert not found.trusted
    assert f"position of the {word} in the aircraft file probably has the wrong sign: x (forward)" in found.distrust[0]


def test_spikes_in_a_gyro_are_taken_out_and_named_those_of_a_vane_not_used(flight):
    at = np.array([100, 333, 700, 1100, 1400])
    spiked = {name: flight.measured[name].copy() for name in ("q", "alpha")}
    spiked["q"][at] += 0.5
    spiked["alpha"][at + 20] -= 0.2
    found = change(flight, **spiked)
    assert_as_good_as_without_fault(found, flight)
    (spikes,) = (f for f in found.findings if f.kind == "spike")
    assert (spikes.channel, spikes.sample, spikes.count) == ("q", 100, 5)
    assert found.consistency["alpha"].rejected == 5


@pytest.mark.slow
def test_gps_that_drops_out_or_hangs_is_done_without(flight):
    measured, t = flight.measured, flight.measured.t
    there = (t >= 8.0) & (t < 13.0)
    lost = {name: np.where(there, np.nan, measured[name]) for name in GPS}
    held = {name: np.where(there, measured[name][400], measured[name]) for name in GPS}
    for channels, kind in ((lost, "missing"), (held, "stuck")):
        found = change(flight, **channels)
        assert_as_good_as_without_fault(found, flight)
        assert all(kinds(found, name) & {kind, "saturated"} for name in GPS)


@pytest.mark.slow
def test_gps_that_jumps_is_distrusted_by_name(flight):
    found = change(flight, x=flight.measured["x"] + 50.0 * (flight.measured.t > 12.0))
    assert found.distrust[0].startswith("x contradicts the other channels")


@pytest.mark.slow
def test_a_heading_that_wraps_is_no_fault(flight):
    # The earth turned by half a turn about the vertical: heading near pi, wrapping at -pi.
    measured = flight.measured
    turned = {name: -measured[name] for name in ("x", "y", "vn", "ve")}
    plain = reconstruct(measured, flight.aircraft)
    found = change(flight, psi=np.mod(measured["psi"], 2.0 * np.pi) - np.pi, **turned)
    assert found.trusted
    np.testing.assert_allclose(found.recording["V"], plain.recording["V"], atol=2e-3)
    assert found["wn"].value == pytest.approx(-plain["wn"].value, abs=0.02)


def test_a_delayed_vane_is_named_with_its_delay(flight):
    delayed = np.interp(flight.measured.t - 0.15, flight.measured.t, flight.measured["alpha"])
    found = change(flight, alpha=delayed)
    assert not found.trusted
    assert found.distrust[0].startswith("alpha is delayed by 0.1")
    delay = next(d for d in found.delays if d.channel == "alpha")
    assert delay.delay == pytest.approx(0.15, abs=0.03)


@pytest.mark.slow
def test_a_drifting_bias_is_distrusted_and_survived_with_drift(flight):
    drifting = flight.measured["q"] + 5e-4 * flight.measured.t
    assert not change(flight, q=drifting).trusted
    allowed = reconstruct(flight.measured.with_channels(q=drifting), flight.aircraft, drift={"bq": 1e-3})
    assert allowed.trusted
    assert np.sqrt(np.mean((allowed.recording["theta"] - flight.truth["theta"]) ** 2)) < 1e-3


@pytest.mark.default_cases("10.0-doubts-far smaller than the stated noise")
@pytest.mark.parametrize(("factor", "where", "says"), [
    (0.1, "distrust", "stated noise"),
    (10.0, "doubts", "far smaller than the stated noise"),
])  # fmt: skip
def test_noise_stated_ten_times_wrong_is_said(flight, factor, where, says):
    content = flight.aircraft.to_dict()
    for sensor in content["sensors"].values():
        sensor["noise"] = {name: factor * std for name, std in sensor["noise"].items()}
    found = reconstruct(flight.measured, Aircraft.from_dict(content))
    assert any(says in text for text in getattr(found, where))


def test_a_gap_is_refused_with_its_place_dropped_samples_are_not(flight):
    measured = flight.measured

    def without(rows):
        kept = np.ones(len(measured), dtype=bool)
        kept[rows] = False
        return Recording("cut", measured.t[kept], {name: measured[name][kept] for name in measured.names})

    with pytest.raises(DataError, match=r"no samples between 9.98 s \(sample 499\) and 12 s"):
        reconstruct(without(slice(500, 600)), flight.aircraft)
    dropped = np.random.default_rng(1).choice(np.arange(20, 1480), 300, replace=False)
    assert reconstruct(without(dropped), flight.aircraft).trusted


def test_too_short_dead_or_standing_recordings_are_refused(flight):
    with pytest.raises(DataError, match="at least 20 samples; 'all-axes' has 16"):
        reconstruct(flight.measured.between(5.0, 5.3), flight.aircraft)
    with pytest.raises(DataError, match=r"'q'.* constant at .* in all samples"):
        change(flight, q=np.full(len(flight.measured), 0.01))
    with pytest.raises(DataError, match=r"'V'.* constant at 40 in all samples"):
        change(flight, V=np.full(len(flight.measured), 40.0))
    airspeed = np.where(flight.measured.t < 4.0, 0.0, flight.measured["V"])
    with pytest.raises(DataError, match=r"V of 'all-axes' is 0 m/s at sample 0[^$]*between\(4, 30\)"):
        change(flight, V=airspeed)


def test_a_dead_vane_is_named_and_done_without(flight):
    found = change(flight, alpha=np.full(len(flight.measured), 0.1))
    assert found.trusted
    assert "alpha: is constant at 0.1 in all samples" in found.doubts[0]


@pytest.mark.parametrize("name", ["h", "psi"])
def test_a_channel_of_one_reading_per_second_is_used_at_its_own_rate_and_named(name):
    flight = demo_instruments("all-axes", 3, duration=12.0)
    values, rate = flight.measured[name], 50
    held = np.repeat(values[::rate], rate)[: len(values)]
    silent = flight.aircraft.to_dict()
    for sensor in silent["sensors"].values():
        sensor.pop("noise", None)
    found = reconstruct(flight.measured.with_channels(**{name: held}), Aircraft.from_dict(silent))
    assert found.consistency[name].n == 13
    assert any(text.startswith(f"{name}: 13 readings in 12 s, too few for a spectrum") for text in found.doubts)
    for constant in found.constants:
        assert abs(constant.value - flight.errors[constant.name]) < 4.0 * constant.std, constant


def test_a_channel_of_three_readings_is_excluded_and_named_unless_its_noise_is_stated(flight):
    rare = np.full(len(flight.measured), np.nan)
    rare[[10, 500, 1400]] = flight.measured["h"][[10, 500, 1400]]
    content = flight.aircraft.to_dict()
    del content["sensors"]["static"]["noise"]
    found = change(flight, Aircraft.from_dict(content), h=rare)
    assert "h" not in found.residuals
    assert any(
        text.startswith("h: 3 readings in 30 s, too few to estimate its noise; not used") for text in found.doubts
    )
    assert change(flight, h=rare).consistency["h"].n == 3


@pytest.mark.slow
def test_too_few_instruments_to_determine_the_attitude_are_distrusted(flight):
    only = {name: flight.measured[name] for name in ("V", "ax", "ay", "az", "p", "q", "r")}
    found = reconstruct(Recording("blind", flight.measured.t, only), flight.aircraft)
    assert any("these instruments do not determine it" in reason for reason in found.distrust)


@pytest.mark.slow
def test_missing_first_and_last_samples_are_bridged(flight):
    for i in (0, -1):
        lost = {name: flight.measured[name].copy() for name in (*fp.MEASUREMENTS, *fp.INPUTS[:6])}
        for values in lost.values():
            values[i] = np.nan
        assert_as_good_as_without_fault(change(flight, **lost), flight)


@pytest.mark.default_cases("0-1.0-10.0")
@pytest.mark.parametrize(
    ("which", "turbulence", "duration"), [(0, 1.0, 10.0), *((i, size, 30.0) for size in (1.0, 4.0) for i in (0, 1, 3))]
)
def test_turbulence_is_not_taken_for_a_fault(which, turbulence, duration):
    # Gusts of 0.8 and 3.2 m/s that the vanes see and the inertial instruments do not, as one air.
    # Where they drown what the accelerometers say, the vane corrections come out absurd, and that is said.
    found = reconstruct(demo_flight(which, 2, turbulence=turbulence, duration=duration), demo_aircraft())
    assert all(reason.split(",")[0] in ("Cup", "Calpha0", "Csi") for reason in found.distrust), str(found)
    assert not found.findings


@pytest.mark.default_cases("0.05-0.2")
@pytest.mark.parametrize(("speed", "seconds"), [(0.05, 0.2), (5.0, 1.0)])
def test_a_drone_and_an_airliner_are_reconstructed_alike(speed, seconds):
    # The same motion in other units of length: lengths and speeds scale by k, times not, gravity with them.
    flight = demo_instruments("all-axes", 4)
    content = flight.aircraft.to_dict()
    lengths = {*GPS, "V", "h", "ax", "ay", "az"}
    for sensor in content["sensors"].values():
        sensor["position"] = [speed * x for x in sensor.get("position", (0.0, 0.0, 0.0))]
        sensor["noise"] = {n: (speed if n in lengths else 1.0) * std for n, std in sensor.get("noise", {}).items()}
    scaled = {name: (speed if name in lengths else 1.0) * flight.measured[name] for name in flight.measured.names}
    recording = Recording("scaled", flight.measured.t, scaled)
    found = reconstruct(recording, Aircraft.from_dict(content), g=9.80665 * speed)
    assert found.trusted, str(found)
    left = found.recording["alpha"] - flight.truth["alpha"]
    assert np.sqrt(np.mean(left**2)) < 5e-4
