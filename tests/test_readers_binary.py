"""Parquet, MATLAB, NumPy and HDF5 files."""

from __future__ import annotations

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import savemat

from structsel.errors import DataError, MapError
from structsel.recording import read_recording
from tests.table_files import ALPHA, MAP, TABLE, T, V

# --- binary formats ------------------------------------------------------------------------------


def test_parquet_keeps_names_units_and_gaps(tmp_path):
    fields = [pa.field("t", pa.float64()), pa.field("alpha", pa.float32(), metadata={"unit": "deg"}),
              pa.field("V [kt]", pa.int64()), pa.field("note", pa.string())]  # fmt: skip
    columns = [T, ALPHA.astype(np.float32), [100, None, *range(6)], ["x"] * 8]
    pq.write_table(pa.table([pa.array(c) for c in columns], schema=pa.schema(fields)), tmp_path / "m.parquet")
    recording = read_recording(tmp_path / "m.parquet")
    assert_allclose(recording["alpha"], np.radians(ALPHA.astype(np.float32)), rtol=1e-6)
    assert recording["V"][0] == pytest.approx(100 * 1852 / 3600)
    assert np.isnan(recording["V"][1])
    assert any(f.kind == "not-finite" and f.sample == 1 for f in recording.findings)
    assert_array_equal(read_recording(tmp_path / "m.parquet", {"channels": {"V": {"column": 3}}})["V"], recording["V"])


def test_parquet_time_stamps_become_seconds(tmp_path):
    stamps = pa.array(np.datetime64("2024-05-01T12:00:00", "us") + (T * 1e6).astype("timedelta64[us]"))
    pq.write_table(pa.table({"t": stamps, "V": V}), tmp_path / "m.parquet")
    assert_allclose(read_recording(tmp_path / "m.parquet").t, T, atol=1e-9)


@pytest.mark.parametrize("form", ["4", "5"])
def test_a_mat_file_of_one_matrix_has_numbered_columns(tmp_path, form):
    savemat(tmp_path / "m.mat", {"flight": TABLE}, format=form)
    recording = read_recording(tmp_path / "m.mat", MAP)
    assert_array_equal(recording["V"], V)
    with pytest.raises(DataError, match=r"It has: columns 1 to 3"):
        read_recording(tmp_path / "m.mat")


def test_a_matrix_with_signals_along_its_rows_is_turned_when_the_map_says_so(tmp_path):
    savemat(tmp_path / "m.mat", {"flight": TABLE.T})
    assert_array_equal(read_recording(tmp_path / "m.mat", {**MAP, "file": {"transpose": True}})["V"], V)


def test_a_mat_file_of_named_vectors_leaves_out_what_is_no_signal(tmp_path):
    savemat(
        tmp_path / "m.mat",
        {"t": T[:, None], "alpha": ALPHA, "S": 24.0, "who": "text", "acc": TABLE, "short": T[:3]},
    )
    recording = read_recording(tmp_path / "m.mat")
    assert set(recording.names) == {"alpha", "acc[1]", "acc[2]", "acc[3]"}
    assert_array_equal(recording["acc[3]"], V)
    assert any("short left out: 3 values, the time axis has 8" in note for note in recording.provenance)


def test_structs_are_reached_by_path_or_by_variable(tmp_path):
    savemat(tmp_path / "m.mat", {"el_1": {"time": T, "AoA": ALPHA}, "el_2": {"time": T[:5], "AoA": V[:5]}})
    by_path = read_recording(tmp_path / "m.mat", {"channels": {"t": "el_1.time", "alpha": "el_1.AoA"}})
    assert_array_equal(by_path["alpha"], ALPHA)
    inside = {"channels": {"t": "time", "alpha": "AoA"}, "file": {"variable": "el_2"}}
    assert_array_equal(read_recording(tmp_path / "m.mat", inside)["alpha"], V[:5])
    with pytest.raises(DataError, match=r"channel 'alpha' of .* has 8 samples, the time axis 5"):
        read_recording(tmp_path / "m.mat", {"channels": {"t": "el_2.time", "alpha": "el_1.AoA"}})
    with pytest.raises(DataError, match=r"variable = 'el_3'.*\nIt has: el_1, el_2\. Did you mean"):
        read_recording(tmp_path / "m.mat", {**inside, "file": {"variable": "el_3"}})
    with pytest.raises(DataError, match=r"\[file\] variable = 'el_1'"):
        read_recording(tmp_path / "m.mat")


def stamp_v73(path):
    """MATLAB's own header, in the 512 bytes HDF5 leaves free."""
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64 HDF5 schema 1.00 .".ljust(116) + bytes(8) + b"\x00\x02IM")


def test_matlab_v73_files_are_read(tmp_path):
    # As MATLAB writes them: HDF5, arrays transposed, the class in an attribute.
    with h5py.File(tmp_path / "m.mat", "w", userblock_size=512) as stream:
        for name, values in (("t", T[None]), ("alpha", ALPHA[None])):
            stream.create_dataset(name, data=values).attrs["MATLAB_class"] = np.bytes_("double")
        group = stream.create_group("run")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        group.create_dataset("V", data=V[None]).attrs["MATLAB_class"] = np.bytes_("double")
    stamp_v73(tmp_path / "m.mat")
    recording = read_recording(tmp_path / "m.mat")
    assert_array_equal(recording["alpha"], ALPHA)
    assert_array_equal(recording["run.V"], V)


def test_a_matlab_v73_matrix_keeps_its_columns(tmp_path):
    with h5py.File(tmp_path / "m.mat", "w", userblock_size=512) as stream:
        stream.create_dataset("flight", data=TABLE.T).attrs["MATLAB_class"] = np.bytes_("double")
    stamp_v73(tmp_path / "m.mat")
    assert_array_equal(read_recording(tmp_path / "m.mat", MAP)["V"], V)


def test_numpy_files_by_name_by_number_and_structured(tmp_path):
    np.savez(tmp_path / "a.npz", t=T, alpha=ALPHA, gyro=TABLE)
    recording = read_recording(tmp_path / "a.npz")
    assert_array_equal(recording["alpha"], ALPHA)
    assert_array_equal(recording["gyro[3]"], V)
    np.save(tmp_path / "b.npy", TABLE)
    assert_array_equal(read_recording(tmp_path / "b.npy", MAP)["V"], V)
    named = np.array(list(zip(T, V)), dtype=[("t", float), ("V", np.float32)])
    np.save(tmp_path / "c.npy", named)
    assert_array_equal(read_recording(tmp_path / "c.npy")["V"], V.astype(np.float32))


def test_pickled_numpy_files_are_refused(tmp_path):
    np.save(tmp_path / "p.npy", np.array([{"t": T}], dtype=object), allow_pickle=True)
    with pytest.raises(DataError, match=r"p\.npy' is no NumPy file that can be read"):
        read_recording(tmp_path / "p.npy")


def test_numbers_are_refused_where_columns_have_no_order(tmp_path):
    np.savez(tmp_path / "a.npz", t=T, alpha=ALPHA)
    with pytest.raises(MapError, match=r"column 2 of .*its columns have no order"):
        read_recording(tmp_path / "a.npz", {"channels": {"alpha": 2}})


def test_hdf5_groups_are_dotted_and_units_are_honoured(tmp_path):
    with h5py.File(tmp_path / "m.h5", "w") as stream:
        stream["t"] = T
        stream.create_dataset("air/alpha", data=ALPHA).attrs["unit"] = "deg"
    recording = read_recording(tmp_path / "m.h5", {"channels": {"alpha": "air.alpha"}})
    assert_allclose(recording["alpha"], np.radians(ALPHA), rtol=1e-15)
