"""Recording: what it holds, what it refuses, what it finds."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from structsel.errors import ChannelError, DataError, StructselWarning
from structsel.recording import Finding, Recording, read_recording, read_recordings

EXAMPLES = Path(__file__).parents[1] / "examples"
DATA = Path(__file__).parents[2] / "shared" / "data"


def flight(n=201, dt=0.05, name="flight_07", **more):
    t = np.arange(n) * dt
    channels = {
        "V": 100.0 + np.sin(t),
        "alpha": 0.1 + 0.02 * np.sin(2.0 * t),
        "q": 0.05 * np.cos(2.0 * t),
        "az": -9.8 + np.sin(2.0 * t),
    }
    return Recording(name, t, {**channels, **more})


def kinds(recording):
    return {(f.kind, f.channel) for f in recording.check().findings}


# --- what it holds -------------------------------------------------------------------------------


def test_channels_are_read_by_name_and_t_is_one_of_them():
    recording = flight()
    assert_array_equal(recording["t"], np.arange(201) * 0.05)
    assert "t" in recording
    assert "alpha" in recording
    assert "beta" not in recording
    assert recording.names == ("V", "alpha", "q", "az")
    assert len(recording) == 201
    assert recording.dt == pytest.approx(0.05)
    assert recording.duration == pytest.approx(10.0)
    assert recording.unit("alpha") == "rad"


def test_nothing_in_a_recording_can_be_changed():
    source = np.zeros(201)
    recording = flight(de=source)
    source[:] = 1.0
    assert_array_equal(recording["de"], 0.0)
    with pytest.raises(ValueError, match="read-only"):
        recording["alpha"][0] = 0.0
    with pytest.raises(TypeError):
        recording.channels["beta"] = source
    with pytest.raises(AttributeError):
        recording.name = "other"


def test_iterating_is_refused_because_len_counts_samples():
    with pytest.raises(TypeError):
        iter(flight())


def test_a_recording_survives_pickling_read_only():
    recording = flight().check()
    again = pickle.loads(pickle.dumps(recording))
    assert again.names == recording.names
    assert_array_equal(again["alpha"], recording["alpha"])
    assert not again["alpha"].flags.writeable
    assert again.findings == recording.findings


def test_channels_of_another_length_and_a_channel_called_dt_are_refused():
    with pytest.raises(DataError, match=r"'flight_07': channel 'de' has shape \(7,\), the time axis \(201,\)"):
        flight(de=np.zeros(7))
    with pytest.raises(DataError, match="'dt' is the name of the time axis"):
        Recording("x", np.arange(3.0), {"dt": np.zeros(3)})


@pytest.mark.parametrize(
    ("t", "words"),
    [
        ([0.0], r"'x' has 1 sample; a recording needs at least 2"),
        ([], r"'x' has 0 samples"),
        ([0.0, 1.0, 1.0], r"repeats 1 s at sample 2 \(1 such samples\)"),
        ([0.0, 1.0, 0.5], r"runs backward from 1 to 0\.5 s at sample 2"),
        ([0.0, np.inf, 2.0], r"channel 't' is inf at sample 1"),
    ],
)
def test_a_clock_that_cannot_be_used_is_refused(t, words):
    with pytest.raises(DataError, match=words):
        Recording("x", np.array(t), {"V": np.zeros(len(t))})


# --- what it refuses -----------------------------------------------------------------------------


def compute_coefficients(recording):
    recording.require("alpha", "q_dot")


def test_a_missing_channel_says_who_needs_it_what_there_is_and_what_to_do():
    with pytest.raises(ChannelError) as caught:
        compute_coefficients(flight())
    assert str(caught.value) == (
        "compute_coefficients needs channel 'q_dot' [rad/s^2]; 'flight_07' has none.\n"
        "It has: t, V, alpha, q, az.\n"
        'Run reconstruct() first, which adds it, or recording.differentiate("q").'
    )


def test_several_missing_channels_are_stated_at_once():
    with pytest.raises(ChannelError, match=r"select needs channels 'CZ' \[-\], 'q_hat' \[-\]") as caught:
        flight().require("CZ", "q_hat", "alpha", by="select")
    assert "Run compute_coefficients() first, which adds it." in str(caught.value)


def test_a_misspelt_channel_is_answered_with_the_nearest():
    recording = flight(AoA_boom=np.zeros(201))
    with pytest.raises(ChannelError, match=r"Did you mean 'alpha' for 'alhpa'\?"):
        recording["alhpa"]
    with pytest.raises(ChannelError, match=r"Did you mean 'AoA_boom'"):
        recording.require("AoA_bom", by="select")


def test_a_channel_nobody_makes_points_to_the_channel_map():
    with pytest.raises(ChannelError, match="map it in a channel map"):
        flight().require("de", by="select")


def test_required_finite_names_the_channel_and_the_first_bad_sample():
    alpha = np.full(201, 0.1)
    alpha[[40, 41]] = np.nan
    recording = flight(alpha=alpha)
    recording.require("alpha", by="select")  # the recording stays readable
    words = r"select needs finite samples of channel 'alpha' \[rad\]; .* is nan at sample 40 \(t = 2 s\), 2"
    with pytest.raises(DataError, match=words):
        recording.require("V", "alpha", finite=True, by="select")


# --- cutting and adding --------------------------------------------------------------------------


def test_between_takes_both_ends_and_refuses_an_empty_segment():
    part = flight().between(1.0, 2.0)
    assert_allclose([part.t[0], part.t[-1], len(part)], [1.0, 2.0, 21])
    assert part.provenance[-1] == "samples 20 to 40 of 'flight_07'"
    with pytest.raises(DataError, match=r"has 0 samples between 20 and 30 s; it runs from 0 to 10 s"):
        flight().between(20.0, 30.0)


def test_split_cuts_at_gaps_and_keeps_every_sample():
    t = np.concatenate([np.arange(50), 80 + np.arange(30), 200 + np.arange(20)]) * 0.1
    recording = Recording("run", t, {"V": t**2}).check()
    (gap,) = [f for f in recording.findings if f.kind == "gap"]
    assert (gap.sample, gap.count, gap.severity) == (50, 2, "warning")
    parts = recording.split()
    assert [(p.name, len(p)) for p in parts] == [("run_1", 50), ("run_2", 30), ("run_3", 20)]
    assert_array_equal(np.concatenate([p["V"] for p in parts]), recording["V"])
    assert not any(f.kind == "gap" for p in parts for f in p.findings)


def test_a_sample_alone_between_gaps_is_left_out_with_a_warning():
    t = np.concatenate([np.arange(20), [40], 80 + np.arange(20)]) * 0.1
    with pytest.warns(StructselWarning, match=r"1 sample of 'run' between two gaps left out.* sample 20 \(t = 4 s\)"):
        assert [len(p) for p in Recording("run", t, {"V": t}).split()] == [20, 20]


def test_without_a_gap_split_gives_the_recording_itself():
    recording = flight()
    assert recording.split() == [recording]


def test_added_channels_are_noted_checked_and_leave_the_first_recording_alone():
    recording = flight()
    more = recording.with_channels(
        note="made up", units={"n1": "-"}, n1=recording.t, mass=7000.0, beta=np.ones(201) * 3
    )
    assert "n1" not in recording
    assert more.unit("n1") == "-"
    assert_array_equal(more["mass"], 7000.0)
    assert more.provenance[-1] == "made up"
    assert {("implausible", "beta"), ("constant", "mass")} <= {(f.kind, f.channel) for f in more.findings}
    assert more["V"] is recording["V"]  # shared, not copied


def test_replacing_a_channel_drops_what_was_found_in_it():
    recording = flight(alpha=np.full(201, 5.0)).check()
    assert any(f.channel == "alpha" for f in recording.findings)
    mended = recording.with_channels(alpha=np.sin(recording.t) / 10)
    assert not any(f.channel == "alpha" for f in mended.findings)


def test_what_was_not_found_in_the_samples_outlives_a_new_check():
    said = Finding("header", "V", "the unit is [kt] in the file and [m/s] in the map; that of the map is used")
    recording = Recording("x", np.arange(50.0), {"V": np.arange(50.0), "beta": np.full(50, 0.1)}, findings=(said,))
    part = recording.check().between(10.0, 30.0)
    assert [f.kind for f in part.findings] == ["header", "constant"]
    assert part.check().findings == part.findings


def test_to_frame_has_the_clock_first():
    frame = flight().to_frame()
    assert list(frame.columns) == ["t", "V", "alpha", "q", "az"]
    assert_array_equal(frame["alpha"], flight()["alpha"])
    assert "alpha" in flight()._repr_html_()


# --- differentiation -----------------------------------------------------------------------------


def test_the_derivative_of_a_sine_is_its_cosine():
    recording = flight(n=1001, dt=0.01).differentiate("alpha", "q")
    t = recording.t
    # Fourth order: h^4/30 times the fifth derivative, 0.02 * 2^5 / 30 * 1e-8; ends are less exact.
    assert_allclose(recording["alpha_dot"], 0.04 * np.cos(2.0 * t), atol=1e-5)
    assert_allclose(recording["q_dot"][5:-5], -0.1 * np.sin(2.0 * t)[5:-5], atol=2e-7)
    assert "alpha_dot, q_dot: differentiated" in recording.provenance[-1]


def test_an_uneven_clock_is_allowed_for():
    even = np.arange(2001) * 0.005
    t = even + 0.0004 * np.sin(6.5 * even)
    recording = Recording("x", t, {"h": t**2}).differentiate("h")
    assert recording.unit("h_dot") == "m/s"
    assert "non-uniform sampling" in recording.provenance[-1]
    # Taking the steps for even would err by up to 2 t * 0.0004 * 6.5 = 0.05.
    assert_allclose(recording["h_dot"], 2.0 * t, rtol=0.0, atol=1e-6)


def test_differentiating_over_a_gap_or_a_nan_is_refused():
    t = np.concatenate([np.arange(20), 40 + np.arange(20)]) * 0.1
    with pytest.raises(DataError, match=r"without gaps; 'x' .* between 1\.9 and 4 s\.\nUse recording\.split\(\)"):
        Recording("x", t, {"q": t}).differentiate("q")
    q = np.zeros(201)
    q[7] = np.inf
    with pytest.raises(DataError, match=r"differentiate needs finite samples of channel 'q'.*sample 7"):
        flight(q=q).differentiate("q")
    with pytest.raises(ChannelError, match=r"differentiate needs channel 'r'"):
        flight().differentiate("r")


# --- what it finds -------------------------------------------------------------------------------


def test_a_clean_flight_has_no_findings():
    assert flight().check().findings == ()


def test_missing_samples_and_jitter_are_notes():
    t = np.arange(100) * 0.1
    t[50:] += 0.1
    t[20] += 0.02
    found = {f.kind: f for f in Recording("x", t, {"V": 100 + t}).check().findings}
    assert found["dropped"].sample == 50
    assert {found["dropped"].severity, found["jitter"].severity} == {"note"}
    assert "gap" not in found


def test_nan_and_infinity_are_errors_that_are_kept():
    h = np.linspace(0.0, 100.0, 201)
    h[[3, 8]] = np.nan, np.inf
    (finding,) = flight(h=h).check().findings
    assert (finding.kind, finding.severity, finding.sample, finding.count) == ("not-finite", "error", 3, 2)
    assert finding.time == pytest.approx(0.15)
    assert "2 of 201 samples" in str(finding)


def test_a_constant_instrument_is_a_warning_and_a_constant_setting_a_note():
    severities = {f.channel: f.severity for f in flight(beta=np.full(201, 0.1), df=np.zeros(201)).check().findings}
    assert severities == {"beta": "warning", "df": "note"}


def test_an_instrument_that_hangs_is_found_where_it_hangs():
    q = flight()["q"].copy()
    q[60:100] = q[60]
    (finding,) = flight(q=q).check().findings
    assert (finding.kind, finding.channel, finding.sample, finding.count) == ("stuck", "q", 60, 40)


def test_coarse_resolution_is_not_taken_for_a_hung_instrument():
    t = np.arange(400) * 0.05
    theta = np.round(0.05 * np.sin(0.4 * t) + 0.02 * np.sin(3.0 * t) * (t > 10), 3)
    assert ("stuck", "theta") not in kinds(Recording("x", t, {"theta": theta}))


@given(
    name=st.sampled_from(["alpha", "beta", "theta", "de"]),
    peak=st.floats(2.5, 60.0),
)
def test_degrees_fed_as_radians_are_found(name, peak):
    recording = flight(**{name: peak * np.sin(np.arange(201) * 0.1)})
    (finding,) = [f for f in recording.check().findings if f.kind == "implausible"]
    assert finding.channel == name
    assert "degrees fed as radians" in finding.remedy


@given(peak=st.floats(1e-3, 1.5), name=st.sampled_from(["alpha", "beta", "phi", "de", "da", "dr"]))
def test_plausible_angles_are_left_in_peace(peak, name):
    assert not kinds(flight(**{name: peak * np.sin(np.arange(201) * 0.1)}))


def test_rates_in_degrees_are_found_from_the_attitude():
    t = np.arange(400) * 0.05
    noise = np.random.default_rng(1).normal(0.0, 1.0, (2, 400))
    theta = 0.05 * np.sin(1.5 * t) + 0.0005 * noise[0]
    q = 0.075 * np.cos(1.5 * t) + 0.001 * noise[1]
    right = Recording("x", t, {"theta": theta, "q": q})
    assert not kinds(right)
    assert ("unit", "q") in kinds(right.with_channels(q=np.degrees(q)))  # 4.3: not implausible alone
    assert ("unit", "theta") in kinds(right.with_channels(theta=np.degrees(theta)))


def test_g_fed_as_metres_per_second_squared_and_a_turned_z_axis_are_found():
    az = flight()["az"]
    assert ("unit", "az") in kinds(flight(az=az / 9.80665))
    assert ("sign", "az") in kinds(flight(az=-az))


def test_knots_feet_per_second_and_feet_are_found_from_the_air_data():
    n = 201
    rho, V, h = (
        np.full(n, 0.9093),
        100.0 + np.sin(np.arange(n)),
        3000.0 + np.arange(n),
    )  # standard day, 3000 m
    qbar, mach = 0.5 * rho * V**2, V / 328.6

    def found(**wrong):
        return kinds(flight(**{"rho": rho, "qbar": qbar, "V": V, "h": h, "mach": mach, **wrong})) - {
            ("constant", "rho")
        }

    assert found() == set()
    assert found(V=V * 1.94384) == {("unit", "V")}
    assert found(V=V / 0.3048) == {("unit", "V")}
    assert found(h=h / 0.3048) == {("unit", "h")}


def test_the_report_is_a_table_with_the_findings_below():
    recording = flight(beta=np.full(201, 0.1), n1=np.linspace(0.0, 1.0, 201)).check()
    lines = str(recording).splitlines()
    assert lines[0] == "flight_07: 201 samples, t = 0 to 10 s, every 0.05 s, 6 channels"
    assert lines[1].split() == ["channel", "unit", "min", "mean", "max", "found"]
    (beta,) = [line for line in lines if line.startswith("  beta ")]
    assert beta.split() == ["beta", "rad", "0.1", "0.1", "0.1", "constant"]
    (n1,) = [line for line in lines if line.startswith("  n1 ")]
    assert n1.split() == ["n1", "?", "0", "0.5", "1"]
    assert lines[-1].startswith("  ! warning: beta: is constant at 0.1 in all samples.")
    assert recording.to_dict()["channels"]["n1"] == {"unit": "?", "min": 0.0, "mean": 0.5, "max": 1.0}


# --- real recordings -----------------------------------------------------------------------------

needs_data = pytest.mark.skipif(not (DATA / "hfb320").exists(), reason="shared data are not here")


@needs_data
def test_the_hfb_recording_has_the_density_gravity_and_kinematics_its_source_states():
    recording = read_recording(DATA / "hfb320" / "hfb320_1_10.asc", EXAMPLES / "hfb320_map.toml")
    assert (len(recording), recording.dt) == (601, pytest.approx(0.1))
    density = 2.0 * recording["qbar"] / recording["V"] ** 2
    assert density.mean() == pytest.approx(0.7925, abs=0.001)
    assert recording["az"].mean() == pytest.approx(-9.88, abs=0.005)
    assert 11515 < recording["thrust"].min() < recording["thrust"].max() < 11764
    # The recorded pitch acceleration is the derivative of the recorded pitch rate: slope 1.00.
    q_dot = recording.differentiate("q")["q_dot"]
    slope = np.polyfit(q_dot - q_dot.mean(), recording["q_dot"], 1)[0]
    assert slope == pytest.approx(1.0, abs=0.05)
    assert recording.findings == ()


@needs_data
def test_the_attas_recordings_come_out_in_si_with_the_signs_stated():
    recordings = {r.name: r for r in read_recordings(DATA / "attas-manoeuvres", EXAMPLES / "attas_map.toml")}
    assert {n: len(r) for n, r in recordings.items()} == {
        "fAttasAil1": 751, "fAttasAilRud2": 1502, "fAttasElv1": 626, "fAttasElv2": 626, "fAttasRud1": 751,
    }  # fmt: skip
    for recording in recordings.values():
        assert recording.dt == pytest.approx(0.04)
        assert recording["az"].mean() == pytest.approx(-9.8, abs=0.15)
        # Ideal gas: rho = p / (R T), so pressure is in Pa, temperature in K.
        assert_allclose(recording["pressure"] / (287.05 * recording["temperature"]), recording["rho"], rtol=0.01)
        # Speed of sound: V / mach = sqrt(1.4 R T); the recorded Mach number lags at times.
        sound = np.sqrt(1.4 * 287.05 * recording["temperature"])
        assert np.median(recording["V"] / recording["mach"] / sound) == pytest.approx(1.0, abs=0.015)
        assert not [f for f in recording.findings if f.severity == "error" or f.kind in ("unit", "implausible")]

    def slope(name, response, rate):
        """Of an angular acceleration on the controls and the rate, least squares."""
        recording = recordings[name]
        X = np.column_stack([recording[response], recording[rate], recording["beta"], np.ones(len(recording))])
        return np.linalg.lstsq(X, recording[f"{rate}_dot"], rcond=None)[0][0]

    assert slope("fAttasElv1", "de", "q") < 0.0
    assert slope("fAttasAil1", "da", "p") < 0.0
    assert slope("fAttasRud1", "dr", "r") < 0.0


@needs_data
def test_the_attas_file_of_two_manoeuvres_is_cut_at_its_gap():
    path = DATA / "attas-manoeuvres" / "fAttasAilRud2.mat"
    recording = read_recording(path, EXAMPLES / "attas_map.toml")
    (gap,) = [f for f in recording.findings if f.kind == "gap"]
    assert gap.sample == 751
    assert [len(part) for part in recording.split()] == [751, 751]


@needs_data
def test_every_recording_of_the_diagnosis_examples_reads_without_a_map_or_a_warning():
    folders = sorted((DATA / "diagnose-examples").glob("*/recordings"))
    assert len(folders) == 4
    for folder in folders:
        for recording in read_recordings(folder):
            assert not [f for f in recording.findings if f.severity != "note"], str(recording)
            assert all(recording.unit(name) != "?" for name in recording.names)
