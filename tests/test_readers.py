"""Text files, clocks and folders, through channel maps good and bad."""

from __future__ import annotations

import gzip
import os

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from structsel.errors import ChannelError, DataError, MapError
from structsel.readers.channel_map import load_channel_map
from structsel.recording import read_recording, read_recordings
from tests.table_files import ALPHA, MAP, TABLE, T, V, lines, write

# --- text ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "   ", ", "])
@pytest.mark.parametrize("header", [True, False])
def test_any_separator_with_or_without_a_header(tmp_path, separator, header):
    names = separator.join(("t", "alpha", "V")) + "\n" if header else ""
    path = write(tmp_path / "m01.txt", names + lines(separator))
    recording = read_recording(path, None if header else MAP)
    assert recording.name == "m01"
    assert_array_equal(recording.t, T)
    assert_allclose(recording["alpha"], ALPHA, rtol=1e-15)  # shortest repr; pandas may round the last bit
    assert_array_equal(recording["V"], V)


def test_units_in_a_header_are_honoured(tmp_path):
    path = write(tmp_path / "m.csv", "t [ms],alpha [deg],V (kt),n1 [%]\n" + lines(",", np.c_[TABLE, 90.0 + T]))
    recording = read_recording(path)
    assert_allclose(recording.t, T / 1000.0, rtol=1e-15)
    assert_allclose(recording["alpha"], ALPHA * np.pi / 180.0, rtol=1e-15)
    assert_allclose(recording["V"], V * 1852.0 / 3600.0, rtol=1e-15)
    assert_allclose(recording["n1"], 0.9 + T / 100.0, rtol=1e-14)
    assert recording.unit("n1") == "-"
    assert any(note == "alpha: column 'alpha [deg]', [deg] to [rad]" for note in recording.provenance)


def test_units_in_a_line_below_the_header_and_comments_above_are_read(tmp_path):
    text = "# flight 7\n# made by hand\nt,alpha,V\ns,deg,m/s\n" + lines()
    assert_allclose(read_recording(write(tmp_path / "m.csv", text))["alpha"], np.radians(ALPHA), rtol=1e-15)


def test_a_commented_header_with_units_separated_by_blanks_is_read(tmp_path):
    path = write(tmp_path / "m.txt", "# t [s]  alpha [deg]  V [m/s]\n" + lines("  "))
    assert_allclose(read_recording(path)["alpha"], np.radians(ALPHA), rtol=1e-15)


def test_decimal_commas_are_seen(tmp_path):
    path = write(tmp_path / "m.csv", "t;alpha;V\n" + lines(";").replace(".", ","))
    assert_allclose(read_recording(path)["alpha"], ALPHA, rtol=1e-12)


def test_byte_order_mark_windows_line_ends_and_gzip_do_no_harm(tmp_path):
    content = ("\ufefft,alpha,V\r\n" + lines().replace("\n", "\r\n")).encode()
    (tmp_path / "m.csv").write_bytes(content)
    (tmp_path / "z.csv.gz").write_bytes(gzip.compress(content))
    for name in ("m.csv", "z.csv.gz"):
        recording = read_recording(tmp_path / name)
        assert recording.name in ("m", "z")
        assert_array_equal(recording["V"], V)


def test_titles_longer_than_the_data_and_a_single_channel_do_no_harm(tmp_path):
    title = "Flight 12, test card 7\npilot: A, B, C\n\nweather fair; wind calm\n" * 3
    recording = read_recording(write(tmp_path / "m.txt", title + "t;V\n0.0;100.0\n0.5;101.0\n"))
    assert_array_equal(recording["V"], [100.0, 101.0])
    one = read_recording(write(tmp_path / "one.txt", "V\n100\n101\n102\n"), {"channels": {"V": "V"}, "file": {"dt": 1}})
    assert_array_equal(one["V"], [100.0, 101.0, 102.0])


def test_skip_rows_and_separator_can_be_stated(tmp_path):
    path = write(tmp_path / "m.dat", "1,2,3\n4,5,6\nt|alpha|V\n" + lines("|"))
    options = {"file": {"skip_rows": 2, "separator": "|", "others": "keep"}}
    assert_array_equal(read_recording(path, options)["V"], V)


def test_a_text_column_is_left_out_and_said_so(tmp_path):
    rows = lines().splitlines()
    path = write(tmp_path / "m.csv", "t,alpha,V,mode\n" + "\n".join(f"{row},AUTO" for row in rows) + "\n")
    recording = read_recording(path)
    assert recording.names == ("alpha", "V")
    assert any("'mode' left out: text, such as 'AUTO'" in note for note in recording.provenance)


def test_a_cell_that_is_no_number_is_a_finding_with_its_line(tmp_path):
    rows = lines().splitlines()
    rows[3] = rows[3].rsplit(",", 1)[0] + ",ERR"
    recording = read_recording(write(tmp_path / "m.csv", "t,alpha,V\n" + "\n".join(rows) + "\n"))
    assert "V" not in recording
    (finding,) = [f for f in recording.findings if f.kind == "text"]
    assert "sample 3 (line 5) reads 'ERR'" in finding.message
    with pytest.raises(MapError, match=r"channel 'V' column 'V' of .*holds no numbers: sample 3 \(line 5\)"):
        read_recording(tmp_path / "m.csv", {"channels": {"t": "t", "V": "V"}})


def test_an_empty_cell_is_nan_and_a_finding(tmp_path):
    rows = lines().splitlines()
    rows[2] = f"{T[2]},,{V[2]}"
    recording = read_recording(write(tmp_path / "m.csv", "t,alpha,V\n" + "\n".join(rows) + "\n"))
    assert np.isnan(recording["alpha"][2])
    (finding,) = recording.findings
    assert (finding.kind, finding.channel, finding.sample, finding.severity) == (
        "not-finite",
        "alpha",
        2,
        "error",
    )


def test_a_line_of_too_many_fields_is_named(tmp_path):
    path = write(tmp_path / "m.csv", "t,alpha,V\n" + lines() + "2.0,1.0,2.0,3.0\n")
    with pytest.raises(DataError, match=r"m\.csv' cannot be read as text in 3 columns: Expected 3 fields in line 10"):
        read_recording(path)


def test_repeated_headers_are_numbered(tmp_path):
    path = write(tmp_path / "m.csv", "t,alpha,alpha\n" + lines())
    recording = read_recording(path)
    assert_allclose(recording["alpha"], ALPHA, rtol=1e-15)
    assert_array_equal(recording["alpha (column 3)"], V)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.csv", b"", r"empty\.csv' is empty \(0 bytes\)"),
        ("blank.csv", b"\n\n  \n", r"blank\.csv' is empty"),
        ("header.csv", b"t,alpha,V\n", r"header\.csv' has no samples"),
        ("prose.txt", b"this is not\na table of\nnumbers at all\n", r"prose\.txt' has no samples"),
        ("one.csv", b"t,alpha\n0.0,0.1\n", r"one\.csv' has 1 sample; a recording needs at least 2"),
        ("binary.csv", b"\x00\x01\x02\x03" * 50, r"binary\.csv' is not text"),
        ("bad.mat", b"not a mat file, but long enough to have a header" * 10, r"bad\.mat' is no MATLAB file"),
        ("bad.npz", b"nothing", r"bad\.npz' is no NumPy file"),
        ("bad.npy", b"nothing", r"bad\.npy' is no NumPy file"),
        ("bad.parquet", b"nothing", r"bad\.parquet' is no Parquet file"),
        ("bad.h5", b"nothing", r"bad\.h5' is no HDF5 file"),
        ("flight.xlsx", b"PK", r"flight\.xlsx' has suffix '\.xlsx', which no reader knows"),
    ],
)
def test_files_that_cannot_be_read_are_named_with_the_reason(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError, match=words):
        read_recording(tmp_path / name)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    with pytest.raises(DataError, match=r"there is no file '.*nowhere\.csv'"):
        read_recording(tmp_path / "nowhere.csv")
    with pytest.raises(DataError, match=r"is a folder; read_recordings\(\) reads one"):
        read_recording(tmp_path)


# --- the clock -----------------------------------------------------------------------------------


def test_repeated_and_backward_time_name_file_sample_and_remedy(tmp_path):
    for name, t, words in (
        ("twice", [0.0, 0.25, 0.25, 0.5], r"twice\.csv': channel 't' repeats 0\.25 s at sample 2"),
        (
            "back",
            [0.0, 0.5, 0.25, 0.75],
            r"back\.csv': channel 't' runs backward from 0\.5 to 0\.25 s at sample 2",
        ),
        ("lost", [0.0, np.nan, 0.5, 0.75], r"lost\.csv': channel 't' is nan at sample 1"),
    ):
        path = write(tmp_path / f"{name}.csv", "t,V\n" + lines(",", np.c_[t, V[:4]]))
        with pytest.raises(DataError, match=words) as caught:
            read_recording(path)
        assert "[file] dt" in str(caught.value)


def test_without_a_clock_the_likely_column_is_offered(tmp_path):
    path = write(tmp_path / "m.csv", "Time,alpha,V\n" + lines())
    with pytest.raises(DataError, match=r"has no channel 't' \[s\]\.\nIt has: Time, alpha, V\.") as caught:
        read_recording(path)
    assert 't = { column = "Time" }' in str(caught.value)


def test_a_clock_that_is_no_number_throughout_is_named_with_its_line(tmp_path):
    path = write(tmp_path / "m.csv", "t,V\n0,1\n1,2\n# end\n")
    with pytest.raises(
        DataError, match=r"column 't' contains something other than numbers: sample 2 \(line 4\) reads '# end'"
    ):
        read_recording(path)
    path = write(tmp_path / "m.csv", "t,V\nnoon,1\nafternoon,2\n")
    with pytest.raises(DataError, match=r"column 't' .*: text, such as 'noon'"):
        read_recording(path)


def test_dt_makes_a_clock_and_time_offset_moves_it(tmp_path):
    path = write(tmp_path / "m.csv", "alpha,V\n" + lines(",", TABLE[:, 1:]))
    recording = read_recording(path, {"file": {"dt": 0.04, "time_offset": 10.0, "others": "keep"}})
    assert_allclose(recording.t, 10.0 + 0.04 * np.arange(8), rtol=1e-15)
    assert recording.dt == pytest.approx(0.04)


def test_dt_with_a_time_column_is_refused(tmp_path):
    with pytest.raises(MapError, match=r"both a time column \(channels\.t\) and file\.dt"):
        load_channel_map({"channels": {"t": "time"}, "file": {"dt": 0.1}})
    path = write(tmp_path / "m.csv", "t,alpha,V\n" + lines())
    with pytest.raises(MapError, match=r"has a time column 't', and the map a dt"):
        read_recording(path, {"file": {"dt": 0.1, "others": "keep"}})


# --- channel maps --------------------------------------------------------------------------------


def test_a_map_renames_converts_and_turns_signs(tmp_path):
    path = write(tmp_path / "m.csv", "time,AoA,TAS\n" + lines())
    toml = write(
        tmp_path / "map.toml",
        '[channels]\nt = "time"\n'
        'alpha = { column = "AoA", unit = "deg", sign = -1, scale = 2.0, offset = 0.5 }\n'
        'V = { column = 3, unit = "kt" }\n',
    )
    recording = read_recording(path, toml, name="run 7")
    assert recording.name == "run 7"
    assert_allclose(recording["alpha"], -np.radians(2.0 * ALPHA + 0.5), rtol=1e-14)
    assert_allclose(recording["V"], V * 1852.0 / 3600.0, rtol=1e-14)
    assert "map.toml" in recording.provenance[0]
    assert "alpha: column 'AoA', times 2, plus 0.5, sign reversed, [deg] to [rad]" in recording.provenance


def test_weighted_columns_are_added_by_number_or_name(tmp_path):
    path = write(tmp_path / "m.csv", "t,left,right\n" + lines())
    for columns in ({"2": -0.5, "3": 0.5}, {"left": -0.5, "right": 0.5}):
        recording = read_recording(path, {"channels": {"da": {"columns": columns, "unit": "deg"}}})
        assert_allclose(recording["da"], np.radians(0.5 * (V - ALPHA)), rtol=1e-14)


def test_others_are_left_out_or_kept_as_the_map_says(tmp_path):
    path = write(tmp_path / "m.csv", "t,alpha,V\n" + lines())
    channels = {"alpha": {"column": "alpha", "sign": -1}}
    left = read_recording(path, {"channels": channels})
    assert left.names == ("alpha",)
    assert "left out, not in the map: V" in left.provenance
    kept = read_recording(path, {"channels": channels, "file": {"others": "keep"}})
    assert kept.names == ("alpha", "V")
    assert_allclose(kept["alpha"], -ALPHA, rtol=1e-15)


def test_rows_keep_one_manoeuvre_of_two(tmp_path):
    path = write(tmp_path / "m.csv", lines())
    recording = read_recording(path, {**MAP, "file": {"rows": [3, 6]}})
    assert_array_equal(recording.t, T[2:6])
    with pytest.raises(MapError, match=r"rows 3 to 60 of .*which has 8 samples"):
        read_recording(path, {**MAP, "file": {"rows": [3, 60]}})


def test_a_map_that_names_a_missing_column_says_what_the_file_has(tmp_path):
    path = write(tmp_path / "m.csv", "t,AoA,TAS\n" + lines())
    with pytest.raises(MapError, match=r"channel 'alpha' column 'AoAA', which '.*m\.csv' does not have") as caught:
        read_recording(path, {"channels": {"alpha": "AoAA"}})
    assert "It has: t, AoA, TAS." in str(caught.value)
    assert "Did you mean 'AoA'?" in str(caught.value)
    with pytest.raises(MapError, match=r"channel 'alpha' column 12 of '.*m\.csv', which has 3"):
        read_recording(path, {"channels": {"alpha": 12}})


def test_a_unit_of_something_else_names_channel_and_both_units(tmp_path):
    words = r"gives channel 'V' the unit 'deg', but true airspeed is measured in \[m/s\]"
    with pytest.raises(MapError, match=words):
        load_channel_map({"channels": {"V": {"column": 3, "unit": "deg"}}})
    with pytest.raises(ChannelError, match=words):
        read_recording(write(tmp_path / "m.csv", "t,alpha,V [deg]\n" + lines()))
    with pytest.raises(MapError, match=words):
        read_recording(tmp_path / "m.csv", {"channels": {"V": "V"}})


def test_a_map_that_contradicts_the_header_is_followed_and_said_so(tmp_path):
    path = write(tmp_path / "m.csv", "t,alpha [rad],V\n" + lines())
    recording = read_recording(path, {"channels": {"alpha": {"column": "alpha", "unit": "deg"}}})
    assert_allclose(recording["alpha"], np.radians(ALPHA), rtol=1e-15)
    (finding,) = [f for f in recording.findings if f.kind == "header"]
    assert "the unit is [rad] in the file and [deg] in the map" in finding.message


def test_a_misspelt_unit_in_a_header_is_reported_and_its_column_gets_no_channel(tmp_path):
    recording = read_recording(write(tmp_path / "m.csv", "t,alpha [degg],V\n" + lines()))
    assert "alpha" not in recording
    (finding,) = recording.findings
    assert "'degg' is not a known unit" in finding.message
    with pytest.raises(ChannelError, match=r"Did you mean 'alpha \[degg\]' for 'alpha'"):
        recording.require("alpha")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            {"channels": {"alpha": {"colum": "AoA"}}},
            r"channels\.alpha\.colum: no such key\. Did you mean 'column'",
        ),
        ({"channels": {"alpha": {"unit": "deg"}}}, r"channels\.alpha: needs either 'column' or 'columns'"),
        ({"channels": {"alpha": {"column": 0}}}, r"channels\.alpha\.column: .*greater than or equal to 1"),
        (
            {"channels": {"alpha": {"column": 1, "sign": 2}}},
            r"channels\.alpha\.sign: input should be 1 or -1",
        ),
        ({"channels": {"alpha": {"column": 1, "scale": 0}}}, r"channels\.alpha: 'scale' is 0"),
        ({"channels": {"alpha": {"column": 1, "unit": "degg"}}}, r"channels\.alpha: unit 'degg' is not one"),
        ({"channels": {"dt": 3}}, r"makes a channel 'dt', which is kept for the sampling interval"),
        ({"channel": {"alpha": 1}}, r"channel: no such key\. Did you mean 'channels'"),
        ({"channels": {"alpha": 1}, "file": {"dtt": 1}}, r"file\.dtt: no such key\. Did you mean 'dt'"),
        ({"channels": {"alpha": 1}, "file": {"dt": 0}}, r"file\.dt: input should be greater than 0"),
        ({"channels": {"alpha": 1}, "file": {"rows": [9, 2]}}, r"file: rows = \[9, 2\] must run from"),
        (
            {"channels": {"alpha": 1}, "schema": "structsel.map/7"},
            r"schema: input should be 'structsel\.map/1'",
        ),
        ({}, r"lists no channels"),
    ],
)
def test_a_wrong_map_is_stated_by_its_key(content, words):
    with pytest.raises(MapError, match=words):
        load_channel_map(content)


def test_maps_that_are_missing_or_no_toml_are_named(tmp_path):
    with pytest.raises(MapError, match=r"nowhere\.toml' cannot be read"):
        load_channel_map(tmp_path / "nowhere.toml")
    with pytest.raises(MapError, match=r"broken\.toml' is not TOML"):
        load_channel_map(write(tmp_path / "broken.toml", "[channels\n"))


# --- many files ----------------------------------------------------------------------------------


def test_a_folder_is_read_in_the_order_of_names(tmp_path):
    for name in ("m02", "m10", "m01"):
        write(tmp_path / f"{name}.csv", "t,alpha,V\n" + lines())
    write(tmp_path / "README.md", "not a recording")
    assert [r.name for r in read_recordings(tmp_path)] == ["m01", "m02", "m10"]
    paths = [tmp_path / "m10.csv", tmp_path / "m01.csv"]
    assert [r.name for r in read_recordings(paths)] == ["m01", "m10"]
    assert [r.name for r in read_recordings(tmp_path / "m02.csv")] == ["m02"]


def test_empty_folders_empty_lists_and_equal_names_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"contains no recordings\.\nFormats read: \.csv"):
        read_recordings(tmp_path)
    with pytest.raises(DataError, match=r"was given no files"):
        read_recordings([])
    write(tmp_path / "m.csv", "t,alpha,V\n" + lines())
    write(tmp_path / "m.txt", "t,alpha,V\n" + lines())
    with pytest.raises(DataError, match=r"would both be called 'm'"):
        read_recordings(tmp_path)


# --- time stamps as text -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stamps", "expected"),
    [
        (["2024-05-01T23:59:59.5Z", "2024-05-02T00:00:00Z", "2024-05-02T00:00:00.25Z"], [0.0, 0.5, 0.75]),
        (["2024-05-01 12:00:00", "2024-05-01 12:00:01", "2024-05-01 12:00:02"], [0.0, 1.0, 2.0]),
        (["23:59:59.5", "00:00:00.0", "00:00:00.5"], [86399.5, 86400.0, 86400.5]),
        (["9:00:00", "9:00:01", "9:00:02"], [32400.0, 32401.0, 32402.0]),
    ],
    ids=["ISO 8601, over midnight", "date and time", "time of day, over midnight", "no leading zero"],
)
def test_time_stamps_as_text_are_read_as_seconds(tmp_path, stamps, expected):
    path = tmp_path / "m.csv"
    path.write_text("t,alpha\n" + "".join(f"{stamp},{0.1 * i}\n" for i, stamp in enumerate(stamps)), encoding="utf-8")
    recording = read_recording(path)
    assert_allclose(recording.t, expected, atol=1e-9)
    assert any("column 't'" in note for note in recording.provenance)
    # Under another name a map places it.
    path.write_text(path.read_text(encoding="utf-8").replace("t,", "stamp,"), encoding="utf-8")
    assert_allclose(read_recording(path, {"channels": {"t": "stamp", "alpha": "alpha"}}).t, expected, atol=1e-9)


def test_a_time_stamp_that_is_none_is_named_with_its_line(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("t,alpha\n12:00:00,0.1\n12:00:61,0.2\n12:00:02,0.3\n", encoding="utf-8")
    with pytest.raises(DataError, match="'12:00"):
        read_recording(path)


# --- files that are no files, many columns ---------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
def test_a_pipe_is_refused_at_once_as_a_recording_and_as_a_map(tmp_path):
    os.mkfifo(tmp_path / "m.csv")
    with pytest.raises(DataError, match="is a pipe or a device"):
        read_recording(tmp_path / "m.csv")
    os.mkfifo(tmp_path / "map.toml")
    (tmp_path / "n.csv").write_text("t,alpha\n0,1\n1,2\n", encoding="utf-8")
    with pytest.raises(MapError, match="is a pipe or a device"):
        read_recording(tmp_path / "n.csv", tmp_path / "map.toml")


@pytest.mark.slow
def test_a_text_file_of_100_000_columns_is_read(tmp_path):
    path = tmp_path / "wide.csv"
    names = ",".join(["t", *(f"x{j}" for j in range(1, 100_000))])
    rows = [",".join([f"{0.1 * i}", *[str(i % 3)] * 99_999]) for i in range(3)]
    path.write_text("\n".join([names, *rows]) + "\n", encoding="utf-8")
    recording = read_recording(path)
    assert len(recording.names) == 99_999
    assert_allclose(recording["x99999"], [0.0, 1.0, 2.0])
