"""Files that would crash a reader, keep it busy without end or fill the memory are refused with a message, in time."""

import gzip
import os
import sys
import zipfile

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io

from structsel import read_recording
from structsel.errors import DataError
from structsel.readers import compressed, isolated

T = np.arange(30) * 0.02


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(isolated, "SECONDS", 1.0)


def matlab(path):
    scipy.io.savemat(path, {"t": T, "alpha": 0.1 + T})
    return path


def hdf5(path):
    with h5py.File(path, "w") as stream:
        stream["t"] = T
        stream.create_dataset("alpha", data=0.1 + T).attrs["unit"] = "rad"
    return path


def damage(path, old, new, at=0):
    """Replace bytes that follow a mark by others of the same number."""
    intact = path.read_bytes()
    place = intact.index(old) + at
    path.write_bytes(intact[:place] + new + intact[place + len(new) :])


# --- compiled readers ------------------------------------------------------------------------------


def test_a_matlab_file_with_a_type_there_is_not_is_refused_and_the_next_one_read(tmp_path):
    broken, intact = matlab(tmp_path / "broken.mat"), matlab(tmp_path / "intact.mat")
    # The samples of alpha: doubles (9). A type of 0x4009 makes SciPy read where it must not.
    damage(broken, b"alpha", b"\x09\x40\x00\x00", at=8)
    with pytest.raises(DataError, match=r"broken\.mat' (makes its reader crash|is no MATLAB file)"):
        read_recording(broken)
    assert np.array_equal(read_recording(intact)["alpha"], 0.1 + T)


def test_an_hdf5_file_whose_heap_goes_round_in_circles_is_refused(tmp_path):
    path = hdf5(tmp_path / "r.h5")
    assert read_recording(path).unit("alpha") == "rad"
    # The size of the free space behind the texts: HDF5 1.14 looks for its end for ever.
    heap = path.read_bytes().index(b"GCOL")
    at = next(k for k in range(heap + 16, heap + 400, 8) if not any(path.read_bytes()[k : k + 8]) and k > heap + 16)
    damage(path, b"GCOL", b"\x00" * 8, at=at + 8 - heap)
    with pytest.raises(DataError, match=r"r\.h5' keeps its reader busy for more than 1 s: it is damaged"):
        read_recording(path)


@pytest.mark.skipif(sys.platform == "win32", reason="no limits on memory there")
def test_a_dataset_of_more_samples_than_any_memory_holds_is_refused(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as stream:
        stream["t"] = T
        stream.create_dataset("alpha", shape=(10**12,), dtype="f8", chunks=(1000,))
    assert (tmp_path / "r.h5").stat().st_size < 100_000
    with pytest.raises(DataError, match=r"r\.h5' would take more than 3\.0 GiB of memory, for a file of \d+ bytes"):
        read_recording(tmp_path / "r.h5")


def test_one_process_serves_for_many_files_and_none_is_no_hindrance(tmp_path, monkeypatch):
    read_recording(matlab(tmp_path / "a.mat"))
    first = isolated._running
    read_recording(hdf5(tmp_path / "b.h5"))
    assert isolated._running is first
    assert first[0] == os.getpid()
    monkeypatch.setattr(isolated, "_running", None)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "nothing"))
    assert len(read_recording(tmp_path / "a.mat")) == len(T)


# --- readers in Python -----------------------------------------------------------------------------

_WORKER = f"""
import sys
sys.path.insert(0, {str(isolated.WORKER.parent)!r})
import isolated_worker as worker

def spin(path):
    while True:
        try:
            while True:
                pass
        except Exception:
            pass

def grow(path):
    held = []
    while True:
        held.append(bytes(1 << 20))

worker.READERS |= {{"spin": ("json", spin), "grow": ("json", grow), "unknown": ("no_such_package", spin)}}
worker.main()
"""


@pytest.fixture
def worker(tmp_path, monkeypatch):
    """A file, and a process with readers that never end."""
    (tmp_path / "worker.py").write_text(_WORKER)
    (tmp_path / "r.log").write_bytes(b"x")
    monkeypatch.setattr(isolated, "WORKER", tmp_path / "worker.py")
    monkeypatch.setattr(isolated, "_running", None)
    for kind in ("spin", "grow", "unknown"):
        monkeypatch.setitem(isolated.FORMATS, kind, ("log", "Write it again."))
    yield tmp_path / "r.log"
    isolated._stop()


def test_a_reader_that_never_ends_is_stopped_whatever_it_catches(worker):
    with pytest.raises(DataError, match=r"r\.log' keeps its reader busy for more than 1 s: it is damaged"):
        isolated.read_isolated(worker, "spin")


def test_without_limits_of_the_system_the_wall_clock_stops_a_reader(worker, monkeypatch):
    monkeypatch.setattr(isolated, "_WALL", 0.3)
    with pytest.raises(DataError, match=r"r\.log' keeps its reader busy"):
        isolated.read_isolated(worker, "spin")


@pytest.mark.skipif(sys.platform == "win32", reason="no limits on memory there")
def test_a_reader_that_fills_the_memory_is_stopped(worker, monkeypatch):
    monkeypatch.setattr(isolated, "SECONDS", 60.0)
    monkeypatch.setattr(isolated, "MEMORY", 1 << 30)
    with pytest.raises(DataError, match=r"r\.log' would take more than 1\.0 GiB of memory, for a file of 1 bytes"):
        isolated.read_isolated(worker, "grow")


def test_a_reader_whose_package_fails_is_an_error_of_the_file(worker):
    with pytest.raises(DataError, match=r"r\.log' is no log that can be read: No module named 'no_such_package'"):
        isolated.read_isolated(worker, "unknown")


# --- readers in this process -----------------------------------------------------------------------


def test_a_text_of_more_columns_than_recordings_have_is_refused(tmp_path):
    (tmp_path / "wide.csv").write_text("\n".join([",".join(["1"] * 250_000)] * 3))
    with pytest.raises(DataError, match=r"wide\.csv' has 250000 columns; at most 200000 are read"):
        read_recording(tmp_path / "wide.csv")


def test_a_parquet_table_that_expands_a_thousandfold_is_refused(small, tmp_path):
    pd.DataFrame({"t": np.zeros(1_000_000), "alpha": np.zeros(1_000_000)}).to_parquet(tmp_path / "r.parquet")
    with pytest.raises(DataError, match=r"r\.parquet' is no Parquet file: the table has \d+ bytes and would expand"):
        read_recording(tmp_path / "r.parquet")


# --- compressed ------------------------------------------------------------------------------------


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(compressed, "MAX_BYTES", 1 << 20)


def test_a_text_that_grows_a_thousandfold_is_refused(small, tmp_path):
    text = b"t,alpha\n" + b"\n".join(b"%d,0" % k for k in range(100)) + b"\n" * 8_000_000
    (tmp_path / "bomb.csv.gz").write_bytes(gzip.compress(text))
    with pytest.raises(
        DataError, match=r"bomb\.csv\.gz' cannot be read.*would expand to \d+, more than 100 times as many"
    ):
        read_recording(tmp_path / "bomb.csv.gz")


def test_arrays_that_grow_a_thousandfold_are_refused(small, tmp_path):
    np.savez_compressed(tmp_path / "bomb.npz", t=np.arange(10.0), alpha=np.zeros(1_000_000))
    with pytest.raises(DataError, match=r"bomb\.npz' is no NumPy file that can be read: alpha\.npy has"):
        read_recording(tmp_path / "bomb.npz")
    with zipfile.ZipFile(tmp_path / "bomb.npz") as archive:
        assert archive.getinfo("alpha.npy").file_size > 100 * archive.getinfo("alpha.npy").compress_size


def test_what_is_large_but_no_more_than_recordings_are_is_read(small, tmp_path):
    t = np.arange(50_000) * 0.01
    rows = "\n".join(f"{a:.2f},{b:.17g}" for a, b in zip(t, np.sin(t)))
    (tmp_path / "r.csv.gz").write_bytes(gzip.compress(f"t,alpha\n{rows}\n".encode()))
    assert len(rows) > compressed.MAX_BYTES
    assert np.array_equal(read_recording(tmp_path / "r.csv.gz")["alpha"], np.sin(t))
