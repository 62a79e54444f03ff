"""Files that keep the processing steps of a recording."""

import json
import pickle

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from structsel import Aircraft, compute_coefficients, read_recording, stream_recordings, write_recording
from structsel.demo import demo_aircraft, demo_flight
from structsel.errors import DataError
from structsel.recording import Recording

FORMATS = ("csv", "parquet")
NOTES = (
    "read from 'C:\\new\\flight 7.csv'",
    "carried to the centre of gravity: V, alpha, beta; vanes at (1, -4.5, 0.1) m",
    'said "twice",\nover two lines; with μ, a tab\t and # 1',
    "",
)


@pytest.fixture
def small():
    t = np.arange(50) * 0.02
    channels = {"alpha": 0.1 + 0.01 * np.sin(t), "tank_level": np.cos(t) / 3.0, "count": np.where(t < 0.5, np.nan, t)}
    return Recording("small", t, channels, {"tank_level": "kg"}, provenance=NOTES)


@pytest.mark.parametrize("suffix", FORMATS)
def test_what_is_written_is_read_again_with_its_history(small, tmp_path, suffix):
    path = write_recording(small, tmp_path / f"small.{suffix}")
    again = read_recording(path)
    assert again.provenance[: len(NOTES)] == NOTES
    assert again.provenance[len(NOTES)] == f"read from '{path}'"
    assert again.names == small.names
    assert again.unit("tank_level") == "kg"
    for name in ("t", *small.names):
        # A CSV holds the shortest text that is the number; pandas may round the last bit of it.
        assert_allclose(again[name], small[name], rtol=1e-15 if suffix == "csv" else 0.0, atol=0)


def test_a_history_longer_than_the_search_for_a_header_is_read(small, tmp_path):
    long = Recording("long", small.t, small.channels, provenance=tuple(f"step {k}" for k in range(500)))
    again = read_recording(write_recording(long, tmp_path / "long.csv"))
    assert again.provenance[:500] == long.provenance
    assert len(again) == len(long)


@pytest.mark.parametrize("suffix", FORMATS)
def test_vanes_carried_before_the_file_are_not_carried_again_after_it(tmp_path, suffix):
    flight, aircraft = demo_flight("all-axes", duration=8.0), demo_aircraft()
    once = compute_coefficients(flight, aircraft)
    in_memory = compute_coefficients(once, aircraft)
    through_file = compute_coefficients(read_recording(write_recording(once, tmp_path / f"f.{suffix}")), aircraft)
    for name in in_memory.names:
        assert_allclose(through_file[name], in_memory[name], rtol=1e-12, atol=1e-14, err_msg=name)
        assert_allclose(through_file[name], once[name], rtol=1e-12, atol=1e-14, err_msg=name)
    # The vanes are 4.5 m out on the wing: without the note it would be plain to see.
    forgetful = Recording("forgetful", once.t, once.channels)
    assert np.abs(compute_coefficients(forgetful, aircraft)["alpha"] - once["alpha"]).max() > 1e-3


@pytest.mark.parametrize("suffix", FORMATS)
def test_readings_of_all_instruments_carried_before_the_file_stay_as_they_are(tmp_path, suffix):
    flight = demo_flight("all-axes", duration=4.0)
    carried = Recording("done", flight.t, flight.channels, at_cg=frozenset(("V", "alpha", "beta", "ax", "ay", "az")))
    content = demo_aircraft().to_dict()
    at_centre = compute_coefficients(flight, Aircraft.from_dict({k: v for k, v in content.items() if k != "sensors"}))
    through_file = compute_coefficients(
        read_recording(write_recording(carried, tmp_path / f"f.{suffix}")), demo_aircraft()
    )
    for name in ("alpha", "V", "CX", "CZ", "Cm"):
        assert_allclose(through_file[name], at_centre[name], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("suffix", FORMATS)
def test_channels_at_the_centre_of_gravity_stay_so_through_slices_and_files(tmp_path, suffix):
    flight = compute_coefficients(demo_flight("all-axes", duration=8.0), demo_aircraft())
    assert flight.at_cg == {"V", "alpha", "beta"}
    assert flight.between(1.0, 3.0).with_channels(alpha=0.1).check().at_cg == flight.at_cg
    assert pickle.loads(pickle.dumps(flight)).at_cg == flight.at_cg
    path = write_recording(flight, tmp_path / f"f.{suffix}")
    assert read_recording(path).at_cg == flight.at_cg
    assert next(iter(stream_recordings(path))).read().at_cg == flight.at_cg


def test_a_file_of_version_0_1_0_says_in_its_notes_which_channels_are_at_the_centre_of_gravity(small, tmp_path):
    path = write_recording(small.with_channels(V=50.0), tmp_path / "f.csv")
    assert "at_cg" not in path.read_text(encoding="utf-8")  # as that version wrote it
    assert read_recording(path).at_cg == {"V", "alpha"}  # beta is not in the file
    table = pq.read_table(write_recording(small.with_channels(V=50.0), tmp_path / "f.parquet"))
    about = json.loads(table.schema.metadata[b"structsel"])
    assert about.pop("at_cg") == []
    pq.write_table(table.replace_schema_metadata({b"structsel": json.dumps(about).encode()}), tmp_path / "old.parquet")
    assert read_recording(tmp_path / "old.parquet").at_cg == {"V", "alpha"}
    assert read_recording(tmp_path / "f.parquet").at_cg == set()


def test_other_programs_read_the_table_past_the_notes(small, tmp_path):
    frame = pd.read_csv(write_recording(small, tmp_path / "small.csv"), comment="#")
    assert list(frame.columns) == ["t", "alpha", "tank_level [kg]", "count"]
    assert_allclose(frame["alpha"], small["alpha"], rtol=1e-15)
    head = (tmp_path / "small.csv").read_text(encoding="utf-8").splitlines()
    assert head[0] == "# structsel.recording/1"
    assert [json.loads(line.removeprefix("# provenance: ")) for line in head[1:5]] == list(NOTES)
    frame = pd.read_parquet(write_recording(small, tmp_path / "small.parquet"))
    assert_allclose(frame["tank_level [kg]"], small["tank_level"], rtol=0)


def test_a_file_is_replaced_only_when_requested_and_no_other_file_is_left(small, tmp_path):
    path = write_recording(small, tmp_path / "one.csv")
    other = small.with_channels(alpha=0.2)
    with pytest.raises(DataError, match=r"one\.csv' exists already\.\nChoose another name, or pass overwrite=True"):
        write_recording(other, path)
    assert read_recording(path)["alpha"][0] == small["alpha"][0]
    write_recording(other, path, overwrite=True)
    assert read_recording(path)["alpha"][0] == 0.2
    assert [p.name for p in tmp_path.iterdir()] == ["one.csv"]


def test_a_write_that_fails_leaves_the_old_file_and_no_other(small, tmp_path, monkeypatch):
    path = write_recording(small, tmp_path / "one.csv")
    before = path.read_bytes()

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    with pytest.raises(DataError, match=r"one\.csv' cannot be written: No space left"):
        write_recording(small, path, overwrite=True)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["one.csv"]
    with pytest.raises(DataError, match=r"it writes \.csv and \.parquet"):
        write_recording(small, tmp_path / "one.xlsx")
    with pytest.raises(DataError, match="cannot be written: No such file"):
        write_recording(small, tmp_path / "nowhere" / "one.parquet")


def with_schema(small, tmp_path, suffix, schema):
    path = write_recording(small, tmp_path / f"new.{suffix}")
    if suffix == "csv":
        path.write_text(path.read_text(encoding="utf-8").replace("structsel.recording/1", schema), encoding="utf-8")
    else:
        table = pq.read_table(path)
        said = json.dumps({"schema": schema, "provenance": []}).encode()
        pq.write_table(table.replace_schema_metadata({b"structsel": said}), path)
    return path


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_newer_schema_is_refused_in_words(small, tmp_path, suffix):
    path = with_schema(small, tmp_path, suffix, "structsel.recording/2")
    message = r"new\.\w+' was written by a newer structsel, as structsel\.recording/2; this one reads structsel\.recor"
    with pytest.raises(DataError, match=message):
        read_recording(path)
    path.unlink()
    with pytest.raises(DataError, match=r"has the schema 'structsel\.model/1'; the only such files read are"):
        read_recording(with_schema(small, tmp_path, suffix, "structsel.model/1"))


def test_a_history_that_cannot_be_read_is_not_passed_over(small, tmp_path):
    path = write_recording(small, tmp_path / "cut.csv")
    path.write_text(path.read_text(encoding="utf-8").replace('beta; vanes at (1, -4.5, 0.1) m"', "beta"), "utf-8")
    with pytest.raises(DataError, match="a line above the table cannot be read: '# provenance: \"carried to the"):
        read_recording(path)
    table = pa.table({"t": [0.0, 1.0], "V": [1.0, 2.0]}).replace_schema_metadata({b"structsel": b"[]"})
    pq.write_table(table, tmp_path / "odd.parquet")
    with pytest.raises(DataError, match="its metadata 'structsel' cannot be read"):
        read_recording(tmp_path / "odd.parquet")


def test_remarks_of_other_programs_above_a_table_are_no_history(tmp_path):
    path = tmp_path / "plain.csv"
    path.write_text('# provenance: "made by hand"\nt,V\n0,1\n1,2\n')
    notes = read_recording(path).provenance
    assert notes[0] == f"read from '{path}'"
    assert not any("made by hand" in note for note in notes)


def test_a_channel_whose_name_is_a_number_is_read_again(tmp_path):
    recording = Recording("r", 0.02 * np.arange(3), {"1e5": np.array([1.0, 2.0, 3.0])})
    write_recording(recording, tmp_path / "r.csv")
    assert_array_equal(read_recording(tmp_path / "r.csv")["1e5"], recording["1e5"])
