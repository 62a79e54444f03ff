"""Recordings left in their files: the answer is that of recordings in memory, broken off or not, on a cluster too."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
import tracemalloc
from functools import partial
from zipfile import ZIP_STORED, ZipFile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from structsel import (
    Candidates,
    Selection,
    compute_coefficients,
    read_recordings,
    select,
    stream_recordings,
    write_recording,
)
from structsel.demo import demo_flights
from structsel.errors import ChannelError, DataError, SelectionError
from structsel.numerics import blocks
from structsel.numerics.blocks import JobRunner
from structsel.recording import Recording
from tests.commands import run

from .flights import fly

POOL = Candidates.polynomial(["alpha", "q_hat", "de"], 2)
TRUTH = {"1": -0.3, "alpha": -4.0, "de": -0.6, "alpha^2": 3.0}
ASKED = {"F_in": 12.0, "bootstrap": 20}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Six flights in Parquet files."""
    made = tmp_path_factory.mktemp("flights")
    for one in fly(TRUTH, 0.03, "ar1_0.92", (900, 1500, 700, 1100, 800, 1000)):
        more = {"CY": one["CZ"] + 0.3 * np.sin(one.t)}
        write_recording(one.with_channels(**more), made / f"{one.name}.parquet")
    return made


def assert_same(found, expected, rtol=1e-10):
    """Every response: the same terms, values and errors to rtol, the same words."""
    if isinstance(found, Selection):
        found, expected = ({one.response: one} for one in (found, expected))
    assert list(found) == list(expected)
    for name, one in found.items():
        other = expected[name]
        assert one.terms == other.terms
        for what in ("values", "covariance", "standard_errors", "partial_F", "vif"):
            left, right = getattr(one, what), getattr(other, what)
            assert_allclose(left, right, rtol=rtol, atol=rtol * np.abs(right).max(initial=0.0))
        assert_allclose([one.r2, one.rms, one.held_out_r2], [other.r2, other.rms, other.held_out_r2], rtol=rtol)
        assert (one.doubts, one.recordings, one.region) == (other.doubts, other.recordings, other.region)


# --- the same answer -------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", ["ar", "cluster", "white"])
def test_streamed_recordings_give_the_answer_of_recordings_in_memory(folder, noise):
    held = select(read_recordings(folder), ["CZ", "CY"], POOL, noise=noise, **ASKED)
    streamed = select(stream_recordings(folder), ["CZ", "CY"], POOL, noise=noise, workers=2, **ASKED)
    assert_same(streamed, held)


def test_files_are_cut_at_gaps_and_coefficients_computed_at_every_reading(tmp_path):
    flights, aircraft, _ = demo_flights(4, duration=10.0)
    for k, (a, b) in enumerate(zip(flights[::2], flights[1::2])):
        t = np.concatenate([a.t, a.t[-1] + 10.0 + b.t])
        both = {name: np.concatenate([a[name], b[name]]) for name in a.names if name in b}
        write_recording(Recording(f"pair{k}", t, both, a.units), tmp_path / f"pair{k}.parquet")
    prepare = partial(compute_coefficients, aircraft=aircraft, V0=45.0)
    held = [prepare(part) for complete in read_recordings(tmp_path) for part in complete.split()]
    streamed = stream_recordings(tmp_path, prepare=prepare, split=True)
    for stored, complete in zip(streamed, held, strict=True):
        assert (stored.name, len(stored), stored.dt) == (complete.name, len(complete), complete.dt)
        assert (stored.findings, stored.provenance) == (complete.findings, complete.provenance)
    assert_same(select(streamed, "Cm", POOL, **ASKED), select(held, "Cm", POOL, **ASKED))


def test_a_stored_recording_answers_like_the_one_it_stores(folder):
    (complete, *_), (stored, *_) = read_recordings(folder), stream_recordings(folder)
    assert (stored.name, len(stored), stored.names, stored.unit("alpha")) == (complete.name, 900, complete.names, "rad")
    assert "CZ" in stored
    assert "mach" not in stored
    assert_array_equal(stored["CZ"], complete["CZ"])
    again = stored.read()
    assert (again.name, again.findings, again.provenance) == (complete.name, complete.findings, complete.provenance)
    with pytest.raises(ChannelError, match=r"select needs channel 'mach' \[-\]; 'flight_1' has none"):
        stored.require("mach", by="select")


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_files(tmp_path):
    n = 6000
    (one,) = fly(TRUTH, 0.03, "white", (n,))
    peaks = []
    for count in (24, 44):
        some = tmp_path / str(count)
        some.mkdir()
        for k in range(count):
            write_recording(one, some / f"f{k:02d}.parquet")
        select(stream_recordings(some), "CZ", POOL, noise="white", bootstrap=0)
        tracemalloc.start()
        select(stream_recordings(some), "CZ", POOL, noise="white", bootstrap=0)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    held = n * len(one.names) * 8
    assert peaks[1] < peaks[0] + 4 * held  # of twenty more files


def test_a_file_that_changes_meanwhile_is_named(folder, tmp_path):
    a, b, *_ = read_recordings(folder)
    path = write_recording(a, tmp_path / "x.parquet")
    flights = stream_recordings(tmp_path)
    write_recording(b, path, overwrite=True)
    with pytest.raises(DataError, match=r"x\.parquet' has changed since it was listed: 1500 samples, not 900"):
        select(flights, "CZ", POOL)


def test_two_recordings_of_one_name_are_refused(folder, tmp_path):
    (a, *_) = read_recordings(folder)
    write_recording(a, tmp_path / "x.parquet")
    write_recording(a, tmp_path / "x.csv")
    with pytest.raises(DataError, match="would both be called 'x'"):
        stream_recordings(tmp_path)


def test_parts_of_a_file_stay_in_order_of_time(tmp_path):
    t = np.concatenate([100.0 * k + 0.02 * np.arange(60) for k in range(12)])
    write_recording(Recording("long", t, {"alpha": np.sin(t), "CZ": np.cos(t)}), tmp_path / "long.parquet")
    flights = stream_recordings(tmp_path, split=True)
    assert [flight.name for flight in flights] == [f"long_{k}" for k in range(1, 13)]
    assert [flight["t"][0] for flight in flights] == [100.0 * k for k in range(12)]


def test_an_error_in_one_thread_stops_the_others():
    worked = []

    def one(item):
        if item == 3:
            raise Breaking
        worked.append(item)
        time.sleep(0.002)

    with pytest.raises(Breaking):
        list(JobRunner().map(one, range(1000), 2))
    assert len(worked) < 100


# --- very many manoeuvres, in joined blocks -------------------------------------------------------------


@given(lengths=st.lists(st.integers(1, 5000), min_size=1, max_size=200), limit=st.integers(1, 40))
def test_joined_blocks_hold_every_manoeuvre_complete_and_once_in_their_order(lengths, limit):
    joined = blocks.join_manoeuvres(lengths, limit)
    assert len(joined) <= limit
    assert [tuple(segment) for block in joined for segment in block] == [(k, 0, n) for k, n in enumerate(lengths)]
    assert blocks.count_samples(joined).sum() == sum(lengths)


def test_manoeuvres_joined_to_blocks_add_up_and_are_left_out_together(folder, monkeypatch):
    flights = read_recordings(folder)
    separate = select(flights, "CZ", POOL, bootstrap=0, F_in=12.0)
    monkeypatch.setattr(blocks, "MIN_BLOCKS", 3)
    monkeypatch.setattr(blocks, "MAX_BLOCKS", 3)
    joined = select(flights, "CZ", POOL, bootstrap=0, F_in=12.0)
    assert joined.terms == separate.terms
    assert_allclose(joined.values, separate.values, rtol=1e-10)
    assert [part.name for part in separate.held_out] == [f"flight_{k}" for k in range(1, 7)]
    assert [part.name for part in joined.held_out] == ["flight_1, flight_2", "flight_3, flight_4", "flight_5, flight_6"]
    assert len(joined.noise_models) == 6


def test_memory_bounds_the_number_of_separate_blocks():
    few, many = blocks.max_blocks(34), blocks.max_blocks(494)
    assert (few, blocks.max_blocks(3000)) == (blocks.MAX_BLOCKS, blocks.MIN_BLOCKS)
    assert many * 496 * 497 / 2 * 8 < 1.01 * blocks.ROOM


# --- a run that is broken off ----------------------------------------------------------------------


class Breaking(Exception):
    """What breaks a run off."""


def broken(stage, parts):
    """A progress that breaks off once a stage has done so many parts."""

    def progress(name, done, of):
        if name == stage and done == parts:
            raise Breaking

    return progress


@pytest.mark.parametrize(("stage", "parts"), [("noise models", 2), ("prewhitened", 4), ("bootstrap", 3)])
def test_an_interrupted_run_continues_where_it_was(folder, tmp_path, stage, parts):
    kept = tmp_path / "kept"
    flights = stream_recordings(folder)
    expected = select(flights, ["CZ", "CY"], POOL, **ASKED)
    with pytest.raises(Breaking):
        select(flights, ["CZ", "CY"], POOL, checkpoint=kept, workers=1, progress=broken(stage, parts), **ASKED)
    assert kept.exists()
    done = []
    found = select(flights, ["CZ", "CY"], POOL, checkpoint=kept, progress=lambda *stated: done.append(stated), **ASKED)
    assert_same(found, expected, rtol=0.0)
    assert list(tmp_path.iterdir()) == []
    again = [name for name, _, _ in done]
    assert "cross-products" not in again
    assert again[0] in ("checking", stage)
    assert stage in again


@pytest.mark.slow
def test_a_killed_run_continues_in_another_process(folder, tmp_path):
    script = textwrap.dedent(
        f"""
        import json, os, signal, sys
        from structsel import Candidates, select, stream_recordings
        def report(name, done, of):
            if name == "prewhitened" and done == 3 and "die" in sys.argv:
                os.kill(os.getpid(), signal.SIGKILL)
        pool = Candidates.polynomial(["alpha", "q_hat", "de"], 2)
        found = select(stream_recordings({str(folder)!r}), "CZ", pool, checkpoint={str(tmp_path / "kept")!r},
                       F_in=12.0, bootstrap=20, progress=report)
        print(json.dumps(found.values.tolist()))
        """
    )
    killed = subprocess.run([sys.executable, "-c", script, "die"], capture_output=True, text=True, check=False)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert (tmp_path / "kept").exists()
    again = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    expected = select(read_recordings(folder), "CZ", POOL, **ASKED)
    assert_allclose(json.loads(again.stdout), expected.values, rtol=1e-10)
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def kept(folder, tmp_path):
    """The checkpoint of a run that was broken off."""
    path = tmp_path / "kept"
    with pytest.raises(Breaking):
        select(stream_recordings(folder), "CZ", POOL, checkpoint=path, progress=broken("prewhitened", 2), **ASKED)
    return path


def test_a_checkpoint_of_other_options_or_other_data_is_refused(folder, kept):
    before = kept.read_bytes()
    flights = stream_recordings(folder)
    with pytest.raises(DataError, match="belongs to other data or other options"):
        select(flights, "CZ", POOL, checkpoint=kept, F_in=4.0, bootstrap=20)
    with pytest.raises(DataError, match="belongs to other data or other options"):
        select(flights, "CZ", POOL, checkpoint=kept, include=["de^2"], **ASKED)
    with pytest.raises(DataError, match="belongs to other data or other options"):
        select(flights[:-1], "CZ", POOL, checkpoint=kept, **ASKED)
    changed = [flights[0].read().with_channels(alpha=flights[0]["alpha"] * (1.0 + 1e-9)), *flights[1:]]
    with pytest.raises(DataError, match="belongs to other data or other options"):
        select(changed, "CZ", POOL, checkpoint=kept, **ASKED)
    assert kept.read_bytes() == before


def test_a_checkpoint_of_a_newer_schema_is_refused_in_words(folder, kept):
    with ZipFile(kept) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    about = json.loads(members["about.json"]) | {"schema": "structsel.checkpoint/3"}
    with ZipFile(kept, "w", ZIP_STORED) as archive:
        for name, content in (members | {"about.json": json.dumps(about).encode()}).items():
            archive.writestr(name, content)
    with pytest.raises(DataError, match=r"another version of structsel \(structsel\.checkpoint/3; this one reads"):
        select(stream_recordings(folder), "CZ", POOL, checkpoint=kept, **ASKED)


@pytest.mark.parametrize("harm", ["text", "cut", "flipped", "empty"])
def test_a_damaged_checkpoint_is_refused_in_words(folder, kept, harm):
    content = kept.read_bytes()
    at = content.index(b"NUMPY") + 400
    made = {
        "text": b"not a checkpoint",
        "cut": content[: len(content) // 2],
        "flipped": content[:at] + bytes([content[at] ^ 255]) + content[at + 1 :],
        "empty": b"",
    }
    kept.write_bytes(made[harm])
    with pytest.raises(DataError, match="Remove the file and start anew"):
        select(stream_recordings(folder), "CZ", POOL, checkpoint=kept, **ASKED)


def test_a_checkpoint_holds_no_pickle(kept):
    with ZipFile(kept) as archive:
        names = archive.namelist()
        assert names[0] == "about.json"
        for name in names[1:]:
            with archive.open(name) as stream:
                assert np.lib.format.read_array(stream, allow_pickle=False).dtype.kind in "fb"


def test_a_checkpoint_in_use_is_refused(folder, kept):
    flights = stream_recordings(folder)

    def second(name, done, of):
        if name == "checking":
            return
        with pytest.raises(DataError, match="is in use by another run"):
            select(flights, "CZ", POOL, checkpoint=kept, **ASKED)
        raise Breaking

    with pytest.raises(Breaking):
        select(flights, "CZ", POOL, checkpoint=kept, workers=1, progress=second, **ASKED)


# --- on a cluster ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def client():
    """Two processes that work for us."""
    distributed = pytest.importorskip("distributed")
    local = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with local, distributed.Client(local) as one:
        yield one


@pytest.mark.slow
def test_workers_of_a_cluster_give_the_answer_of_this_process_and_so_they_do_when_one_is_killed(folder, client):
    expected = select(read_recordings(folder), ["CZ", "CY"], POOL, **ASKED)
    flights = stream_recordings(folder, client=client)
    assert_same(select(flights, ["CZ", "CY"], POOL, client=client, **ASKED), expected)
    killed = []

    def kill(name, done, of):
        if name == "prewhitened" and done == 2 and not killed:
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    assert_same(select(flights, ["CZ", "CY"], POOL, client=client, progress=kill, **ASKED), expected)
    assert killed


@pytest.mark.slow
def test_recordings_in_memory_go_to_the_workers_too_and_errors_come_back(folder, client):
    flights = read_recordings(folder)[:2]
    asked = {"noise": "white", "bootstrap": 0}
    assert_same(select(flights, "CZ", POOL, client=client, **asked), select(flights, "CZ", POOL, **asked))
    with pytest.raises(ChannelError, match="select needs channel 'Cm'"):
        select(stream_recordings(folder), "Cm", POOL, client=client)


@pytest.mark.slow
def test_a_task_that_kills_every_worker_ends_with_a_clear_message(client):
    client.run_on_scheduler(lambda dask_scheduler: setattr(dask_scheduler, "allowed_failures", 0))
    with pytest.raises(SelectionError, match="every worker that took it died"):
        list(JobRunner(client).map(_kill_own_process, [0]))


def _kill_own_process(item):
    os.kill(os.getpid(), signal.SIGKILL)


# --- the command -----------------------------------------------------------------------------------


SELECT = ("--responses", "CZ", "--candidates", "alpha,q_hat,de", "--degree", 2, "--bootstrap", 20, "--no-plots")


def test_the_command_streams_and_writes_the_same_model(folder, tmp_path):
    for name, how in (("streamed", "--stream"), ("held", "--no-stream")):
        run("select", folder, *SELECT, "--held-out", "flight_6", how, "--out", tmp_path / name)
    models = [json.loads((tmp_path / n / "model.json").read_text())["responses"]["CZ"] for n in ("streamed", "held")]
    assert_allclose(models[0]["values"], models[1]["values"], rtol=1e-10)
    assert {k: v for k, v in models[0].items() if k in ("terms", "region")} == {
        k: v for k, v in models[1].items() if k in ("terms", "region")
    }
    assert sorted(p.name for p in tmp_path.iterdir()) == ["held", "streamed"]


def test_a_streamed_run_keeps_its_checkpoint_with_the_results(folder, tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("structsel.selection.engine.cross_validate", stop)
        run("select", folder, *SELECT, "--stream", "--out", tmp_path / "out", code=130)
    assert [p.name for p in tmp_path.iterdir()] == ["out.checkpoint"]
    run("select", folder, *SELECT, "--stream", "--out", tmp_path / "out")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_large_folders_are_streamed_unless_stated_otherwise(folder, monkeypatch):
    from structsel.cli import streaming

    assert not streaming.StreamingOptions().use_for([folder], reconstruct=False)
    monkeypatch.setattr(streaming, "STREAM_ABOVE", 1000)
    assert streaming.StreamingOptions().use_for([folder], reconstruct=False)
    assert not streaming.StreamingOptions(stream=False).use_for([folder], reconstruct=False)
    assert not streaming.StreamingOptions().use_for([folder], reconstruct=True)


def test_streaming_and_reconstructing_exclude_each_other(folder, tmp_path):
    said = run("select", folder, *SELECT, "--stream", "--reconstruct", "--aircraft", tmp_path / "a.toml", code=2)
    assert "write reconstructed" in said.output.replace("\n", " ")
