"""Logs of many rates, each written by its format's own tool or published layout; and the one clock they come to."""

from __future__ import annotations

import re
import struct

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from structsel.errors import DataError, MapError
from structsel.recording import read_recording, read_recordings
from structsel.recording.resampling import Topic, resample

asammdf = pytest.importorskip("asammdf")
pyulog = pytest.importorskip("pyulog")
pytest.importorskip("pymavlink")

G = 9.80665


def kinds(recording, kind):
    return [f for f in recording.findings if f.kind == kind]


# --- one clock -----------------------------------------------------------------------------------


def test_a_straight_line_is_met_exactly_and_a_command_is_held():
    clock = np.arange(0.0, 10.0, 0.013)
    topic = Topic.from_times("x", np.arange(0.0, 10.2, 0.1))
    assert_allclose(resample(topic, 3.0 * topic.times - 1.0, clock), 3.0 * clock - 1.0, atol=1e-12)
    steps = np.floor(topic.times)
    held = resample(topic, steps, clock, hold=True)
    assert set(held) == set(range(10))
    assert_array_equal(held, steps[np.floor(clock / 0.1 + 1e-9).astype(int)])


def test_nothing_is_interpolated_across_a_gap_nor_beyond_a_topics_ends():
    times = np.concatenate([np.arange(1.0, 3.0, 0.1), np.arange(5.0, 8.0, 0.1)])
    topic, clock = Topic.from_times("x", times), np.arange(0.0, 10.0, 0.01)
    drawn, held = resample(topic, times, clock), resample(topic, times, clock, hold=True)
    assert_array_equal(
        np.isfinite(drawn), ((clock >= 1.0) & (clock <= times[19])) | ((clock >= 5.0) & (clock <= times[-1]))
    )
    assert not np.isfinite(held[(clock > times[19] + 0.301) & (clock < 5.0)]).any()
    assert topic.dropouts(0.0, 10.0) == [(0.0, 1.0), (times[19], 5.0), (times[-1], 10.0)]


def test_a_single_lost_sample_is_bridged_and_a_delayed_one_left_out():
    topic = Topic.from_times("x", np.array([0.0, 0.1, 0.2, 0.4, 0.3, 0.5]))
    assert_array_equal(topic.kept, [True, True, True, True, False, True])
    assert_allclose(resample(topic, np.array([0.0, 1.0, 2.0, 4.0, 99.0, 5.0]), np.array([0.3])), [3.0])


def test_a_heading_runs_on_through_north():
    topic = Topic.from_times("yaw", np.arange(0.0, 4.0, 0.1))
    heading = np.mod(6.0 + 0.5 * topic.times, 2.0 * np.pi)
    clock = np.arange(0.0, 3.9, 0.01)
    assert_allclose(resample(topic, heading, clock, turn=2.0 * np.pi), 6.0 + 0.5 * clock, atol=1e-12)


# --- ULog ----------------------------------------------------------------------------------------


class Flight:
    """Motion whose channels are known at any time."""

    def __init__(self):
        self.phi = lambda t: 0.5 * np.sin(0.8 * t)
        self.theta = lambda t: 0.05 + 0.1 * np.sin(0.5 * t)
        self.psi = lambda t: 2.6 + 0.2 * t  # turns through south, where the angle jumps
        self.V = lambda t: 22.0 + np.sin(0.3 * t)
        self.servo = lambda t: 0.4 * np.sign(np.sin(1.3 * t))

    def quaternion(self, t):
        angles = np.column_stack([self.psi(t), self.theta(t), self.phi(t)])
        return Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True)


FLIGHT = Flight()


def make_ulog(path, topics):
    """ULog of (name, format, rows), the first field of each row the time in us; written by pyulog."""
    log = pyulog.ULog(None)
    log._start_timestamp = 1_000_000
    for number, (name, fields, rows) in enumerate(topics):
        definition = f"{name}:{fields}".encode()
        made = pyulog.ULog.MessageFormat(definition, None)
        log._message_formats[made.name] = made
        added = pyulog.ULog._MessageAddLogged(struct.pack("<BH", 0, number) + name.encode(), None, log._message_formats)
        added.buffer = bytearray(np.array([tuple(row) for row in rows], dtype=added.dtype).tobytes())
        log._data_list.append(pyulog.ULog.Data(added))
    log.write_ulog(str(path))
    return path


def px4_topics(seconds=12.0, quiet=(5.0, 7.0)):
    def us(t):
        return np.round(t * 1e6).astype(np.int64)

    fast, slow, air = (np.arange(2.0, 2.0 + seconds, 1.0 / rate) for rate in (200.0, 50.0, 10.0))
    air = air[(air < 2.0 + quiet[0]) | (air > 2.0 + quiet[1])]
    rates = np.column_stack([np.sin(fast), np.cos(fast), 0.1 * fast])
    loads = np.column_stack([0.1 * fast, 0.0 * fast, -G + 0.1 * np.sin(fast)])
    delayed = 4000  # us from sampling to publishing
    return [
        ("vehicle_angular_velocity", "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;",
         zip(us(fast) + delayed, us(fast), *rates.T)),
        ("vehicle_acceleration", "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;",
         zip(us(fast) + delayed, us(fast), *loads.T)),
        ("vehicle_attitude", "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;",
         zip(us(slow) + delayed, us(slow), *FLIGHT.quaternion(slow).T)),
        ("airspeed_validated", "uint64_t timestamp;float true_airspeed_m_s;", zip(us(air), FLIGHT.V(air))),
        ("vehicle_local_position",
         "uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float vx;float vy;float vz;",
         zip(us(slow) + delayed, us(slow), 20 * slow, 0 * slow, 20 + 0 * slow, 0 * slow + 1, 0 * slow - 2)),
        ("actuator_servos", "uint64_t timestamp;uint64_t timestamp_sample;float[3] control;",
         zip(us(slow), us(slow) - delayed, FLIGHT.servo(slow), -FLIGHT.servo(slow), np.full(len(slow), np.nan))),
        ("actuator_motors", "uint64_t timestamp;uint64_t timestamp_sample;float[2] control;",
         zip(us(slow), us(slow) - delayed, 0.6 + 0 * slow, np.full(len(slow), np.nan))),
        ("distance_sensor", "uint64_t timestamp;float current_distance;", zip(us(slow), np.full(len(slow), np.nan))),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def ulog(tmp_path_factory):
    return make_ulog(tmp_path_factory.mktemp("px4") / "log.ulg", px4_topics())


def test_a_ulog_needs_no_map(ulog):
    recording = read_recording(ulog)
    t = recording.t
    assert recording.dt == pytest.approx(0.005, abs=1e-6)
    assert (t[0], t[-1]) == (pytest.approx(2.0), pytest.approx(13.9))  # the last of the airspeed
    assert_allclose(recording["p"], np.sin(t), atol=1e-6)
    assert_allclose(recording["az"], -G + 0.1 * np.sin(t), atol=1e-5)
    for name in ("phi", "theta", "psi"):  # linear interpolation errs by step^2/8 times the second derivative
        error = np.unwrap(recording[name]) - getattr(FLIGHT, name)(t)
        assert_allclose(error - 2 * np.pi * np.round(error / (2 * np.pi)), 0.0, atol=0.02**2 / 8 * 0.4 + 1e-6)
    assert_allclose(recording["vd"], -2.0)
    assert_allclose(recording["throttle"], 0.6, rtol=1e-6)
    assert_array_equal(np.unique(recording["servo1"]), np.float32([-0.4, 0.4]))
    assert "servo3" not in recording  # NaN: not connected
    assert "h_agl" not in recording  # no number in the whole topic


def test_a_gap_of_the_airspeed_is_not_bridged_and_reported(ulog):
    recording = read_recording(ulog)
    inside = (recording.t > 7.0) & (recording.t < 9.0)
    assert not np.isfinite(recording["V"][inside]).any()
    ok = np.isfinite(recording["V"])
    assert_allclose(recording["V"][ok], FLIGHT.V(recording.t[ok]), atol=2e-4)
    (silent,) = kinds(recording, "silent")
    assert silent.channel == "V"
    assert (
        "has no samples for 2.1 s in all, first from 6.9 to 9 s; these dropouts are not interpolated: V"
        in silent.message
    )
    (clock,) = kinds(recording, "clock")
    assert "'vehicle_angular_velocity.timestamp_sample', 200 Hz" in clock.message
    assert "zero-order hold: throttle (50 Hz), servo1 (50 Hz)" in clock.message
    assert re.search("linear interpolation: [^;]*phi \\(50 Hz\\).*V \\(10 Hz\\)", clock.message)


def test_assumptions_of_the_built_in_map_are_reported(ulog):
    stated = {f.channel: f.message for f in kinds(read_recording(ulog), "assumed")}
    assert stated["phi"] == "PX4's estimate, not a reading of an instrument; also for theta, psi, vn, ve, vd, x, y"
    assert "not a deflection" in stated["servo1"]


def test_a_map_for_a_log_makes_deflections_of_commands_and_needs_no_clock(ulog):
    own = {"channels": {
        "p": "vehicle_angular_velocity.xyz[0]",
        "de": {"column": "actuator_servos.control[1]", "scale": 25.0, "unit": "deg", "sign": -1, "hold": True},
    }}  # fmt: skip
    recording = read_recording(ulog, own)
    assert recording.names == ("p", "de")
    assert_allclose(np.unique(recording["de"]), np.radians([-10.0, 10.0]), rtol=1e-6)
    assert (recording["de"][np.sin(1.3 * recording.t) > 0.1] > 0.0).all()  # sign turned, of a servo that is turned


def test_another_clock_thins_and_says_so(ulog):
    own = {"channels": {"t": "vehicle_attitude.timestamp_sample", "p": "vehicle_angular_velocity.xyz[0]",
                        "phi": "vehicle_attitude.phi"}}  # fmt: skip
    recording = read_recording(ulog, own)
    assert recording.dt == pytest.approx(0.02)
    assert_allclose(recording["p"], np.sin(recording.t), atol=1e-5)
    assert "without an anti-alias filter" in kinds(recording, "clock")[0].message


def test_columns_of_two_clocks_do_not_add(ulog):
    columns = {"vehicle_attitude.phi": 1.0, "vehicle_local_position.vx": 1.0}
    with pytest.raises(DataError, match=r"adds columns of .*log\.ulg' that were not sampled together"):
        read_recording(ulog, {"channels": {"phi": {"columns": columns}}})


def test_a_map_that_names_an_empty_instrument_is_refused(ulog):
    with pytest.raises(DataError, match=r"'h_agl' .*contains no numbers.*\nRemove 'h_agl' from the map"):
        read_recording(ulog, {"channels": {"h_agl": "distance_sensor.current_distance"}})
    with pytest.raises(MapError, match=r"'vehicle_atitude\.phi'.*does not have"):
        read_recording(ulog, {"channels": {"phi": "vehicle_atitude.phi"}})


def test_a_ulog_cut_off_is_read_to_its_end_and_said_so(ulog, tmp_path):
    content = ulog.read_bytes()
    cut = tmp_path / "cut.ulg"
    cut.write_bytes(content[: int(0.6 * len(content)) + 1])
    recording = read_recording(cut)
    assert recording.t[-1] < 10.0
    assert "ends within a message" in kinds(recording, "file")[0].message


def test_ulogs_that_hold_nothing_are_named(tmp_path, ulog):
    for name, content, words in (
        ("other.ulg", b"PK\x03\x04" * 20, r"other\.ulg' is no ULog: it does not begin as one"),
        ("short.ulg", ulog.read_bytes()[:10], r"short\.ulg' is no ULog that can be read: Invalid file format"),
        ("head.ulg", ulog.read_bytes()[:60], r"head\.ulg' is a ULog without samples"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(DataError, match=words):
            read_recording(tmp_path / name)


# --- DataFlash -----------------------------------------------------------------------------------

_C = {"Q": "Q", "B": "B", "f": "f", "c": "h", "C": "H", "H": "H", "b": "b", "d": "d", "e": "i", "L": "i",
      "N": "16s", "Z": "64s", "n": "4s"}  # fmt: skip
FORMATS = {  # as ArduPilot's log structures have them: number, format, fields, units, multipliers
    "FMT": (0x80, "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
    "UNIT": (177, "QbZ", "TimeUS,Id,Label", "s--", "F--"),
    "MULT": (178, "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    "FMTU": (179, "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
    "ATT": (65, "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF",
            "sddddhhdh-", "FBBBBBBBB-"),
    "IMU": (66, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "s#EEEooo", "F-000000"),
    "ARSP": (67, "QBff", "TimeUS,I,Airspeed,DiffPress", "s#nP", "F-00"),
    "BARO": (68, "QBffc", "TimeUS,I,Alt,Press,Temp", "s#mPO", "F-00B"),
    "RCOU": (69, "QHHHH", "TimeUS,C1,C2,C3,C4", "sYYYY", "F----"),
    "XKF1": (70, "QBfff", "TimeUS,C,VN,VE,VD", "s#nnn", "F-000"),
}  # fmt: skip
UNITS = {"s": "s", "d": "deg", "h": "degheading", "E": "rad/s", "o": "m/s/s", "n": "m/s", "P": "Pa", "m": "m",
         "O": "degC", "Y": "us", "#": "instance", "-": ""}  # fmt: skip
MULTS = {"F": 1e-6, "0": 1.0, "B": 1e-2, "-": 0.0}


def message(name, *values):
    number, kinds, *_ = FORMATS[name]
    return struct.pack("<BBB" + "".join(_C[k] for k in kinds), 0xA3, 0x95, number, *values)


def head():
    made = b""
    for name, (number, kinds, fields, *_) in FORMATS.items():
        size = 3 + struct.calcsize("<" + "".join(_C[k] for k in kinds))
        made += message("FMT", number, size, name.encode(), kinds.encode(), fields.encode())
    made += b"".join(message("UNIT", 1, ord(key), label.encode()) for key, label in UNITS.items())
    made += b"".join(message("MULT", 1, ord(key), value) for key, value in MULTS.items())
    for number, _, _, units, mults in FORMATS.values():
        made += message("FMTU", 1, number, units.encode(), mults.encode())
    for output, function, low, trim, high, turned in (
        (1, 4, 1000, 1500, 2000, 0), (2, 19, 1000, 1600, 2000, 1),
        (3, 70, 1100, 1100, 1900, 0), (4, 21, 1000, 1500, 2000, 0),
    ):  # fmt: skip
        parts = {"FUNCTION": function, "MIN": low, "TRIM": trim, "MAX": high, "REVERSED": turned}
        made += b"".join(
            message("PARM", 2, f"SERVO{output}_{part}".encode(), value, value) for part, value in parts.items()
        )
    return made


def dataflash_bytes(seconds=10.0):
    rows = []
    for t in np.arange(3.0, 3.0 + seconds, 0.01):
        us = round(t * 1e6)
        rows.append((us, message("IMU", us, 0, 0.1 * np.sin(t), 0.2, 0.3, 0.5, 0.0, -G)))
        rows.append((us, message("IMU", us, 1, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0)))
    for t in np.arange(3.0, 3.0 + seconds, 0.04):
        us = round(t * 1e6)
        yaw = np.mod(np.degrees(FLIGHT.psi(t)) + 180.0, 360.0)  # through north
        deg = [round(100.0 * float(np.degrees(x))) for x in (FLIGHT.phi(t), FLIGHT.theta(t))]
        rows.append((us, message("ATT", us, 0, deg[0], 0, deg[1], 0, round(100.0 * yaw) % 36000, 0, 0, 3)))
        rows.append((us, message("RCOU", us, 1750, 1800, 1500, 0 if t < 4.0 else 1250)))
        rows.append((us, message("XKF1", us, 0, 20.0, 1.0, -2.0)))
    for t in np.arange(3.0, 3.0 + seconds, 0.1):
        us = round(t * 1e6)
        rows.append((us, message("ARSP", us, 0, 20.0, 245.0)))
        rows.append((us, message("BARO", us, 0, 0.0, 89874.6, 3500)))  # 1000 m in the standard atmosphere
    return head() + b"".join(row for _, row in sorted(rows, key=lambda row: row[0]))


@pytest.fixture(scope="module")
def dataflash(tmp_path_factory):
    path = tmp_path_factory.mktemp("ardupilot") / "00000007.BIN"
    path.write_bytes(dataflash_bytes())
    return path


def test_the_dataflash_file_is_one_to_pymavlinks_own_reader(dataflash):
    from pymavlink.DFReader import DFReader_binary

    with DFReader_binary(str(dataflash)) as log:
        first = log.recv_match(type="ATT")
        assert first.Roll == pytest.approx(np.degrees(FLIGHT.phi(3.0)), abs=0.006)
        assert first.fmt.get_unit("Yaw") == "degheading"


def test_a_dataflash_log_needs_no_map(dataflash):
    recording = read_recording(dataflash)
    t = recording.t
    assert recording.name == "00000007"
    assert recording.dt == pytest.approx(0.01, abs=1e-6)
    assert_allclose(recording["p"], 0.1 * np.sin(t), atol=1e-7)  # the first IMU, not the second
    assert_allclose(recording["az"], -G, rtol=1e-7)
    half, bend = np.radians(0.005), 0.04**2 / 8 * 0.4
    assert_allclose(recording["phi"], FLIGHT.phi(t), atol=half + bend)
    assert_allclose(recording["theta"], FLIGHT.theta(t), atol=half + bend)
    assert_allclose(np.ptp(recording["psi"] - FLIGHT.psi(t)), 0.0, atol=2 * half)  # no jump at north
    assert_allclose(recording["vd"], -2.0)
    assert_allclose(recording["pressure"], 89874.6, rtol=1e-6)


def test_true_airspeed_is_that_of_the_standard_atmosphere(dataflash):
    # ISO 2533: density 1.2250 kg/m^3 at sea level, 1.1117 at 1000 m.
    assert_allclose(read_recording(dataflash)["V"], 20.0 * np.sqrt(1.2250 / 1.1117), rtol=1e-4)


def test_outputs_become_fractions_of_their_travel_by_the_logs_own_parameters(dataflash):
    recording = read_recording(dataflash)
    assert_allclose(recording["aileron_command"], 0.5)
    assert_allclose(recording["elevator_command"], -0.5)  # 1800 of 1600 to 2000, reversed
    assert_allclose(recording["throttle"], 0.5)
    rudder = recording["rudder_command"]
    assert not np.isfinite(rudder[recording.t < 3.99]).any()  # no pulse
    assert_allclose(rudder[recording.t > 4.01], -0.5)
    assert "de" not in recording  # nobody said how far the surface goes


def test_every_message_is_there_for_a_map_with_the_logs_units(dataflash):
    recording = read_recording(dataflash, {"channels": {"second_p": "IMU[1].GyrX", "temperature": "BARO[0].Temp"}})
    assert_allclose(recording["second_p"], 9.0)
    assert recording.unit("second_p") == "rad/s"
    assert_allclose(recording["temperature"], 273.15 + 35.0)


def test_a_dataflash_log_cut_off_is_read_to_its_end_and_said_so(dataflash, tmp_path):
    content = dataflash.read_bytes()
    cut = tmp_path / "cut.bin"
    cut.write_bytes(content[: len(content) - 20])
    (fault,) = kinds(read_recording(cut), "file")
    assert "ends within a message" in fault.message
    broken = tmp_path / "broken.bin"
    broken.write_bytes(content[:60_000] + bytes(range(200)) + content[60_000:])
    (fault,) = kinds(read_recording(broken), "file")
    assert "damaged" in fault.message


def test_dataflash_logs_that_hold_nothing_are_named(tmp_path):
    for name, content, words in (
        ("other.bin", b"\x7fELF" * 100, r"other\.bin' is no binary DataFlash log: it does not begin as one"),
        ("head.bin", head()[: 89 * len(FORMATS)], r"head\.bin' is a DataFlash log without samples"),
        ("magic.bin", b"\xa3\x95\x80", r"magic\.bin' is (no|a) DataFlash log (that can be read|without)"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(DataError, match=words):
            read_recording(tmp_path / name)


# --- MDF -----------------------------------------------------------------------------------------


def make_mdf(path, groups, version="4.10"):
    with asammdf.MDF(version=version) as log:
        for signals in groups:
            log.append([
                asammdf.Signal(samples=values, timestamps=t, name=name, unit=unit) for name, unit, t, values in signals
            ])  # fmt: skip
        return log.save(path, overwrite=True)


FAST, SLOW = np.arange(0.0, 5.0, 0.01), np.arange(0.0, 5.0, 0.1)
GROUPS = [
    [("p", "deg/s", FAST, np.degrees(np.sin(FAST))), ("alpha_deg", "", FAST, 3.0 + 0.0 * FAST)],
    [("V", "km/h", SLOW, 90.0 + 36.0 * SLOW), ("oil", "degC", SLOW, 80.0 + 0.0 * SLOW)],
]


@pytest.mark.parametrize(("suffix", "version"), [(".mf4", "4.10"), (".mdf", "3.30")])
def test_an_mdf_file_comes_to_the_clock_of_its_fastest_group(tmp_path, suffix, version):
    recording = read_recording(make_mdf(tmp_path / f"log{suffix}", GROUPS, version))
    t = recording.t
    assert recording.dt == pytest.approx(0.01)
    assert_allclose(recording["p"], np.sin(t), atol=1e-12)
    assert_allclose(recording["alpha"], np.radians(3.0))
    assert_allclose(recording["V"], 25.0 + 10.0 * t, rtol=1e-12)
    assert t[-1] == pytest.approx(4.9)  # the slow group ends there
    assert_allclose(recording["oil"], 353.15)
    assert recording.unit("oil") == "K"
    assert "V (10 Hz)" in kinds(recording, "clock")[0].message


def test_an_mdf_file_of_one_group_and_foreign_names_is_read_by_them(tmp_path):
    path = make_mdf(tmp_path / "log.mf4", [[("speed", "m/s", FAST, 1.0 + FAST), ("flow", "deg", FAST, FAST)]])
    recording = read_recording(path)
    assert_array_equal(recording["speed"], 1.0 + FAST)
    mapped = read_recording(path, {"channels": {"alpha": "flow", "V": {"column": "speed"}}})
    assert_allclose(mapped["alpha"], np.radians(FAST), rtol=1e-15)


def test_equal_mdf_names_of_two_groups_get_the_groups_name_and_invalid_samples_are_nan(tmp_path):
    with asammdf.MDF(version="4.10") as log:
        bad = np.arange(len(FAST)) == 7
        log.append([asammdf.Signal(samples=FAST, timestamps=FAST, name="p", unit="rad/s", invalidation_bits=bad)])
        log.append([asammdf.Signal(samples=-SLOW, timestamps=SLOW, name="p", unit="rad/s")])
        path = log.save(tmp_path / "log.mf4")
    recording = read_recording(path)
    assert np.flatnonzero(np.isnan(recording["p"])).tolist() == [7]
    assert_allclose(recording["p (group 2)"], -recording.t, atol=1e-12)


def test_mdf_files_that_hold_nothing_are_named(tmp_path):
    (tmp_path / "other.mf4").write_bytes(b"not measurement data" * 9)
    with pytest.raises(DataError, match=r"other\.mf4' is no MDF file: it does not begin as one"):
        read_recording(tmp_path / "other.mf4")
    content = make_mdf(tmp_path / "log.mf4", GROUPS).read_bytes()
    (tmp_path / "cut.mf4").write_bytes(content[:150])
    with pytest.raises(DataError, match=r"cut\.mf4' is no MDF file that can be read"):
        read_recording(tmp_path / "cut.mf4")
    with asammdf.MDF(version="4.10") as log:
        empty = log.save(tmp_path / "empty.mf4")
    with pytest.raises(DataError, match=r"empty\.mf4' is an MDF file without a channel of numbers"):
        read_recording(empty)


# --- all of them ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("package", "extra", "name"),
    [("pyulog", "ulog", "ulog"), ("pymavlink", "dataflash", "dataflash"), ("asammdf", "mdf", "mdf")],
)
def test_a_package_that_is_not_installed_is_named_with_its_extra(package, extra, name, request, tmp_path, monkeypatch):
    path = make_mdf(tmp_path / "log.mf4", GROUPS) if name == "mdf" else request.getfixturevalue(name)
    monkeypatch.setattr("structsel.readers.standard_maps.find_spec", lambda name: None if name == package else name)
    with pytest.raises(DataError, match=rf'package {package}, which is not installed\.\n.*"structsel\[{extra}\]"'):
        read_recording(path)


def test_a_folder_of_logs_of_several_kinds_is_read(ulog, dataflash, tmp_path):
    (tmp_path / "a.ulg").write_bytes(ulog.read_bytes())
    (tmp_path / "b.bin").write_bytes(dataflash.read_bytes())
    make_mdf(tmp_path / "c.mf4", GROUPS)
    assert [recording.name for recording in read_recordings(tmp_path)] == ["a", "b", "c"]
