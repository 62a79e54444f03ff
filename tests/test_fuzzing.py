"""Rubbish in every file that is read: it is refused in words, quickly, or it is used."""

import contextlib
import gzip
import io
import json
import os
import re
import time

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from typer.main import get_command

from proof.keys import Key
from structsel import AeroModel, Aircraft, read_recording, write_recording
from structsel.candidates import Term
from structsel.cli import app
from structsel.cli.defaults import load_defaults
from structsel.errors import AircraftError, DataError, MapError, ModelError, StructselError
from structsel.readers import isolated
from structsel.readers.channel_map import load_channel_map
from structsel.recording import Recording
from structsel.selection.checkpoint import Checkpoint

T = np.arange(30) * 0.02
CHANNELS = {"alpha": 0.1 + 0.01 * np.sin(T), "q": np.cos(T), "V": 50.0 + T}
MODEL = json.dumps(
    {
        "schema": "structsel.model/1",
        "name": "testbed",
        "recordings": ["m01"],
        "states": {"late": {"kind": "lag", "input": "de", "parameters": {"tau": {"value": 0.1, "unit": "s"}}}},
        "responses": {
            "CZ": {
                "terms": ["1", "alpha", "alpha^2*q_hat", "(alpha - 0.2)+"],
                "values": [0.1, -4.0, 1.0, 2.0],
                "standard_errors": [1.0, 1.0, None, 1.1],
                "covariance": np.eye(4).tolist(),
                "region": {"alpha": [0.0, 0.3]},
                "n": 30,
                "s2": 0.1,
                "r2": 0.9,
            }
        },
    }
)
AIRCRAFT = """
schema = "structsel.aircraft/1"
name = "testbed"
mass = 2288.2
S = 23.2
b = 14.6
cbar = 1.59
[inertia]
Ix = 5368.4
Iy = 6928.9
Iz = 11158.8
Ixz = 117.6
[thrust]
offset = [1.8, 0.0, -0.15]
[sensors.vane]
position = [5.0, 0.0, 0.0]
[tolerances]
main = 0.05
mass = "exact"
"""
MAP = """
schema = "structsel.map/1"
[channels]
t = "time"
alpha = { column = "AoA", unit = "deg", sign = -1, scale = 2.0 }
ay    = { column = 12 }
da    = { columns = { 28 = -0.5, 29 = 0.5 }, unit = "deg" }
de    = { column = "servo.out", unit = "deg", hold = true }
[file]
time_offset = 0.04
rows = [1, 100]
separator = "tab"
"""
KEY = json.dumps(
    {
        "verdicts": ["mismatch"],
        "form": "forced",
        "severity": "easy",
        "attainable": {"CZ": 0.5},
        "effects": [{"effect": "x", "accept": ["x"], "kinds": ["static"], "axes": ["CZ"], "region": {"alpha": [0, 1]}}],
    }
)
DEFAULTS = """
quiet = true
[select]
responses = "CZ,Cm"
f-in = "auto"
degree = 3
[diagnose]
overwrite = true
"""
TEXTS = {
    "model.json": (MODEL, AeroModel.from_json, ModelError),
    "aircraft.toml": (AIRCRAFT, Aircraft.from_toml, AircraftError),
    "map.toml": (MAP, load_channel_map, MapError),
    "key.json": (KEY, Key.read, DataError),
    "structsel.toml": (DEFAULTS, lambda path: load_defaults(path, get_command(app).all_commands()), DataError),
}
RUBBISH = [
    *(b'NaN nan Infinity inf -1 1e999 1e308 0 2 null true [] {} "" \'\' a.b.c , ; = [ { } ] " \x00 \xff\xfe'.split()),
    *(
        b"1979-05-27T07:32:00Z",
        b"-9223372036854775809",
        b'"structsel.model/2"',
        b"alpha^1e9",
        b"\n",
        b"\t",
        b"\xc2\xb2",
    ),
    *(b"9" * 5000, b"0x" + b"f" * 6000, b"[" * 3000, b'{"a":' * 3000, b"{a=" * 3000, b"a." * 3000, b"(" * 500),
]
TOKEN = re.compile(rb'"[^"]*"|[-+\w.]+|[\[\]{}=:,]')
LONGEST = 4000  # characters of a message
QUICK = 5.0  # s, for one small file on a busy machine; a hang is far longer
TIMES = int(os.environ.get("STRUCTSEL_FUZZ", "1"))  # as many examples; `make fuzz` asks for more


@st.composite
def damaged(draw, intact):
    """A file's bytes after a few faults: cut, lost, doubled, flipped, or rubbish in place of a token."""
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(intact)))
        to = min(len(intact), at + draw(st.sampled_from([1, 1, 2, 4, 8, 40])))
        piece = intact[at:to]
        match draw(st.sampled_from(["token", "token", "flip", "cut", "lose", "double", "rubbish", "fill"])):
            case "token" if token := TOKEN.search(intact, at):
                intact = intact[: token.start()] + draw(st.sampled_from(RUBBISH)) + intact[token.end() :]
            case "flip":
                bit = 1 << draw(st.integers(0, 7))
                intact = intact[:at] + bytes(b ^ bit for b in piece[:1]) + intact[at + 1 :]
            case "cut":
                intact = intact[:at]
            case "lose":
                intact = intact[:at] + intact[to:]
            case "double":
                intact = intact[:to] + piece + intact[to:]
            case "fill":
                intact = intact[:at] + draw(st.sampled_from([b"\x00", b"\xff"])) * len(piece) + intact[to:]
            case _:
                intact = intact[:at] + draw(st.sampled_from(RUBBISH)) + intact[to:]
    return intact


def fuzz(path, intact, read, examples):
    """Read damaged files one after another; anything but a StructselError or a result fails."""
    took, refused = [], []
    phases = list(Phase) if TIMES == 1 else [Phase.reuse, Phase.generate]  # making a find small takes minutes

    @settings(max_examples=examples * TIMES, deadline=None, phases=phases, suppress_health_check=list(HealthCheck))
    @given(damaged(intact))
    def damage(content):
        path.write_bytes(content)
        start = time.process_time()
        try:
            read(path)
        except StructselError as error:
            refused.append(len(str(error)))
            assert refused[-1] < LONGEST
        took.append(time.process_time() - start)
        assert took[-1] < QUICK

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            damage()
    finally:
        print(f"{path.name}: {len(took)} files, {len(refused)} refused, slowest {max(took, default=0.0):.2f} s")


@pytest.mark.parametrize("name", TEXTS)
def test_a_damaged_text_of_ours_is_refused_or_read(name, tmp_path):
    text, read, _ = TEXTS[name]
    read(_written(tmp_path / name, text.encode()))  # intact, it is read
    fuzz(tmp_path / name, text.encode(), read, 25)


@pytest.mark.parametrize("formula", ["alpha^2*q_hat", "(alpha - 0.2)+*sin(2*beta)", "de(t - 0.1)", "-1.5e-3*abs(p)"])
def test_a_damaged_formula_is_refused_or_read(formula, tmp_path):
    fuzz(tmp_path / "formula.txt", formula.encode(), lambda path: Term(path.read_text("utf-8", "replace")), 25)


def _resume(path):
    checkpoint = Checkpoint(path, "these data")
    try:
        for size in (12, 6, 3):
            checkpoint.load(size)
    finally:
        checkpoint.release()


def test_a_damaged_checkpoint_is_refused_or_gone_on_with(tmp_path):
    intact = tmp_path / "intact.checkpoint"
    checkpoint = Checkpoint(intact, "these data")
    for size in (12, 6):
        assert checkpoint.load(size) is None
        checkpoint.save(np.arange(float(size)))
    checkpoint.release()
    _resume(intact)
    fuzz(tmp_path / "damaged.checkpoint", intact.read_bytes(), _resume, 25)


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize(
    "content",
    [b"", b"\xff\xfe\x00", b"[" * 100_000, b'{"a":' * 100_000, b"a = " + b"[" * 100_000, b"a." * 50_000 + b"a = 1"],
    ids=["empty", "no text", "deep list", "deep object", "deep TOML list", "deep TOML key"],
)
def test_rubbish_is_refused_under_the_files_name(name, content, tmp_path):
    _, read, error = TEXTS[name]
    if name == "structsel.toml" and not content:
        assert not any(read(_written(tmp_path / name, content)).values())  # no defaults is no fault
        return
    with pytest.raises(error, match=re.escape(name)):
        read(_written(tmp_path / name, content))


@pytest.mark.parametrize(
    ("name", "old", "new", "says"),
    [
        ("model.json", "structsel.model/1", "structsel.model/2", '"structsel.model/1"; it has "structsel.model/2"'),
        (
            "model.json",
            "structsel.model/1",
            "structsel.diagnosis/1",
            "A file of another kind or version cannot be read",
        ),
        ("model.json", "-4.0", "NaN", "NaN is not a JSON number"),
        ("model.json", "-4.0", "1e999", "responses.CZ.values"),
        ("model.json", "-4.0", '"-4.0"', "responses.CZ.values"),
        ("model.json", "-4.0", "9" * 5000, "is not JSON"),
        ("aircraft.toml", "structsel.aircraft/1", "structsel.aircraft/2", "schema"),
        ("aircraft.toml", "23.2", "nan", "S: "),
        ("aircraft.toml", "23.2", "0x" + "f" * 6000, "S: a whole number of more than 64 bits"),
        ("aircraft.toml", "23.2", "9" * 5000, "is not TOML"),
        ("map.toml", "structsel.map/1", "structsel.map/2", "schema"),
        ("map.toml", "column = 12", "column = [12]", "ay"),
        ("map.toml", "scale = 2.0", "scale = inf", "alpha.scale"),
        ("key.json", '"easy"', "5", "severity"),
    ],
)
def test_a_wrong_version_or_value_is_named(name, old, new, says, tmp_path):
    text, read, error = TEXTS[name]
    assert old in text
    with pytest.raises(error) as caught:
        read(_written(tmp_path / name, text.replace(old, new, 1).encode()))
    assert says in str(caught.value)
    assert name in str(caught.value)
    assert len(str(caught.value)) < 2000


@pytest.mark.parametrize("number", ["2", "9" * 6000, "\N{SUPERSCRIPT TWO}"])
def test_a_recording_of_a_newer_schema_is_refused(number, tmp_path):
    path = write_recording(Recording("r", T, CHANNELS), tmp_path / "r.csv")
    path.write_text(
        path.read_text().replace("structsel.recording/1", f"structsel.recording/{number}"), encoding="utf-8"
    )
    with pytest.raises(DataError, match=r"newer structsel|the only such files read"):
        read_recording(path)


def _written(path, content):
    path.write_bytes(content)
    return path


# --- recordings ------------------------------------------------------------------------------------


def _csv(path):
    write_recording(Recording("r", T, CHANNELS, provenance=("a note",)), path)


def _gz(path):
    table = np.column_stack([T, *CHANNELS.values()])
    lines = [",".join(["t", *CHANNELS]), *(",".join(map(repr, row)) for row in table.tolist())]
    path.write_bytes(gzip.compress("\n".join(lines).encode()))


def _npz(path):
    np.savez(path, t=T, **CHANNELS)


def _npy(path):
    rows = np.zeros(len(T), dtype=[("t", float), *((name, float) for name in CHANNELS)])
    rows["t"] = T
    np.save(path, rows)


def _hdf5(path):
    with h5py.File(path, "w") as stream:
        stream["t"] = T
        group = stream.create_group("signals")
        for name, values in CHANNELS.items():
            group.create_dataset(name, data=values).attrs["unit"] = "rad"


def _ulog(path):
    pytest.importorskip("pyulog")
    logs = pytest.importorskip("tests.test_readers_logs")
    logs.make_ulog(path, logs.px4_topics(seconds=2.0, quiet=(0.5, 1.0)))


def _dataflash(path):
    pytest.importorskip("pymavlink")
    path.write_bytes(pytest.importorskip("tests.test_readers_logs").dataflash_bytes(seconds=1.0))


def _mdf(version):
    def write(path):
        pytest.importorskip("asammdf")
        logs = pytest.importorskip("tests.test_readers_logs")
        logs.make_mdf(path, logs.GROUPS, version)

    return write


def _jsbsim(path):
    names = ["Time", *(f"/fdm/jsbsim/{n}" for n in ("aero/alpha-rad", "velocities/vt-fps", "velocities/q-rad_sec"))]
    rows = np.column_stack([T, *CHANNELS.values()])
    path.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]))


def _xplane(path):
    rows = np.column_stack([T, *CHANNELS.values()])
    heads = ("_real,_time", "alpha,__deg", "____Q,rad/s", "Vtrue,_ktas")
    lines = ["", "".join(f"{n:>14} |" for n in heads), *("".join(f"{x:14.5f} |" for x in row) for row in rows)]
    path.write_text("\n".join(lines))


def _matlab(version):
    def write(path):
        nested = {"more": {"x": T, "name": "abc"}} if version == "5" else {}
        scipy.io.savemat(path, {"t": T, **CHANNELS, **nested}, format=version)

    return write


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(isolated, "SECONDS", 1.0)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("suffix", "make", "examples"),
    [
        (".csv", _csv, 12),
        (".csv.gz", _gz, 12),
        (".parquet", _csv, 12),
        (".npz", _npz, 12),
        (".npy", _npy, 12),
        (".h5", _hdf5, 12),
        (".mat", _matlab("5"), 24),
        (".mat", _matlab("4"), 12),
        (".ulg", _ulog, 3),
        (".bin", _dataflash, 3),
        (".mf4", _mdf("4.10"), 3),
        (".mdf", _mdf("3.30"), 3),
        (".jsbsim.csv", _jsbsim, 12),
        (".xplane.txt", _xplane, 12),
    ],
)
def test_a_damaged_recording_is_refused_or_read(suffix, make, examples, tmp_path):
    path = tmp_path / f"intact{suffix}"
    make(path)
    read_recording(path)  # intact, it is read
    fuzz(tmp_path / f"damaged{suffix}", path.read_bytes(), read_recording, examples)


def test_a_nan_that_signals_is_nan_without_a_warning(tmp_path):
    values = np.full(len(T), 20.0, dtype=np.float32)
    values.view(np.uint32)[1] = 0x7FA00000  # any warning is an error in these tests
    np.savez(tmp_path / "r.npz", t=T, alpha=values)
    assert np.flatnonzero(np.isnan(read_recording(tmp_path / "r.npz")["alpha"])).tolist() == [1]


@pytest.mark.parametrize("cut", [20, 100, -20])
def test_a_compressed_text_cut_off_is_refused(cut, tmp_path):
    _gz(tmp_path / "r.csv.gz")
    (tmp_path / "r.csv.gz").write_bytes((tmp_path / "r.csv.gz").read_bytes()[:cut])
    with pytest.raises(DataError, match=r"r\.csv\.gz' cannot be read"):
        read_recording(tmp_path / "r.csv.gz")


def test_groups_that_hold_themselves_are_refused(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as stream:
        stream["t"] = T
        stream["again"] = h5py.SoftLink("/")
    with pytest.raises(DataError, match=r"r\.h5' is no HDF5 file that can be read"):
        read_recording(tmp_path / "r.h5")
