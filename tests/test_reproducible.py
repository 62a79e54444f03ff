"""The same input and the same seed give the same output: to the last bit, and to 1e-12 with more workers."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from structsel import Candidates, Recording, reconstruct_all, select, write_recording
from structsel.cli import app
from structsel.demo import demo_instruments, demo_missing_physics
from structsel.diagnosis import diagnose
from tests.report_pages import manoeuvre

POOL = Candidates.polynomial(["alpha", "q_hat", "de"], 3)


def leaves(held, place=""):
    """Every number and text of nested results, by its place."""
    if isinstance(held, dict):
        return {k: v for key, one in held.items() for k, v in leaves(one, f"{place}.{key}").items()}
    if isinstance(held, list | tuple):
        return {k: v for i, one in enumerate(held) for k, v in leaves(one, f"{place}[{i}]").items()}
    return {place: held}


def assert_close(found, expected, rtol=1e-12):
    a, b = leaves(found), leaves(expected)
    assert a.keys() == b.keys()
    for place, value in b.items():
        if isinstance(value, float):
            assert_allclose(a[place], value, rtol=rtol, atol=1e-300, err_msg=place)
        else:
            assert a[place] == value, place


@pytest.fixture(scope="module")
def recordings():
    return [manoeuvre(k) for k in range(4)]


@pytest.mark.parametrize("method", ["stepwise", "orthogonal", "best_subset"])
def test_a_selection_with_its_resampling_is_repeatable_also_on_two_threads(method, recordings):
    asked = {"method": method, "bootstrap": 40, "seed": 3}
    first, again = (select(recordings, ["Cm", "CZ"], POOL, workers=1, **asked).to_dict() for _ in range(2))
    assert json.dumps(again) == json.dumps(first)
    assert_close(select(recordings, ["Cm", "CZ"], POOL, workers=2, **asked).to_dict(), first)


def test_another_seed_draws_other_manoeuvres(recordings):
    # Else the test above would say nothing of seeds.
    one, other = (select(recordings, "CZ", POOL, bootstrap=40, seed=seed).inclusion for seed in (3, 4))
    assert one != other


def test_every_file_of_a_selection_is_written_alike_twice(recordings, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for one in recordings:
        write_recording(one, tmp_path / f"{one.name}.csv")
    names = [f"{one.name}.csv" for one in recordings]
    asked = ("--responses", "Cm,CZ", "--candidates", "alpha,q_hat,de", "--degree", "2", "--bootstrap", "20")
    for out in ("first", "second"):
        stated = CliRunner().invoke(app, ["select", *names, *asked, "--held-out", "m04", "--no-plots", "--out", out])
        assert stated.exit_code == 0, stated.output
    first = {p.name: p.read_bytes() for p in (tmp_path / "first").iterdir()}
    assert first.keys() >= {"model.json", "selection.json", "validation.json", "report.html", "terms.csv", "report.txt"}
    assert {p.name: p.read_bytes() for p in (tmp_path / "second").iterdir()} == first


@pytest.fixture(scope="module")
def paths():
    """Two recordings with their aircraft, and their flight paths by this process."""
    flights = demo_instruments("all-axes", 2, duration=6.0)
    measured = [flights.measured, flights.measured.between(0.0, 4.0)]
    measured[1] = Recording("part", measured[1].t, measured[1].channels, measured[1].units)
    return measured, flights.aircraft, reconstruct_all(measured, flights.aircraft, workers=1)


def test_flight_paths_are_repeatable(paths):
    measured, aircraft, first = paths
    again = reconstruct_all(measured, aircraft, workers=1)
    assert json.dumps(again.to_dict()) == json.dumps(first.to_dict())
    for a, b in zip(again.recordings, first.recordings):
        assert all(np.array_equal(a[name], b[name], equal_nan=True) for name in b.names)


@pytest.mark.slow
def test_flight_paths_are_the_same_by_two_processes(paths):
    measured, aircraft, first = paths
    both = reconstruct_all(measured, aircraft, workers=2)
    assert_close(both.to_dict(), first.to_dict())
    for a, b in zip(both.recordings, first.recordings):
        for name in b.names:
            assert_allclose(a[name], b[name], rtol=1e-12, atol=1e-12 * np.nanmax(np.abs(b[name])))


def test_a_diagnosis_is_repeatable():
    case = demo_missing_physics("ground-effect", flights=2)
    first, again = (json.dumps(diagnose(case.simulated, case.recordings, case.aircraft).to_dict()) for _ in range(2))
    assert again == first
