"""Recordings that are parts of one flight, and joined where they continue each other."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from structsel.comparison.preparing import prepare
from structsel.comparison.sequences import join_continued, sequences
from structsel.diagnosis import diagnose
from structsel.recording import Recording
from tests.noisy_flights import AIRCRAFT, T, fly

CUTS = (0, 150, 330, len(T))


def part(recording, first, last, name):
    return Recording(name, recording.t[first:last], {c: recording[c][first:last] for c in recording.names})


def cut(recording, overlap=0):
    """A recording in three parts, each of which begins some samples before the end of the one before."""
    edges = [(max(a - overlap, 0), b) for a, b in pairwise(CUTS)]
    return [part(recording, a, b, f"{recording.name}{k}") for k, (a, b) in enumerate(edges)]


def along(parts, recording, stated):
    """Simulated responses along the parts."""
    first = {p.name: int(np.searchsorted(recording.t, p.t[0] - 1e-6)) for p in parts}
    return {p.name: {c: x[first[p.name] :][: len(p)] for c, x in stated.items()} for p in parts}


def names(chains):
    return [[r.name for r in chain] for chain in chains]


@pytest.fixture(scope="module")
def flown():
    return fly({}, speeds=(42.0, 50.0), h=(1000.0, 1100.0))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_recordings_that_do_not_overlap_are_one_flight_in_any_order(flown, order):
    parts = cut(flown[0][0])
    assert names(sequences([parts[k] for k in order])) == [["m010", "m011", "m012"]]
    assert sequences(parts[:1]) == []


def test_parts_of_flights_with_the_same_clock_are_told_apart_by_their_channels(flown):
    parts = [p for r in flown[0] for p in cut(r)]
    assert sorted(names(sequences(parts))) == [["m010", "m011", "m012"], ["m020", "m021", "m022"]]
    assert sorted(names(sequences(parts[::-1]))) == sorted(names(sequences(parts)))
    assert sequences(flown[0]) == []


@pytest.mark.parametrize("overlap", [0, 40])
def test_recordings_that_continue_each_other_are_joined_to_what_they_were_cut_from(flown, overlap):
    recording, stated = flown[0][0], flown[1][0]
    parts = cut(recording, overlap)
    made = join_continued(parts[::-1], along(parts, recording, stated))
    (joined,) = made.recordings
    assert joined.name == "m010 to m012"
    assert "3 recordings continue each other" in made.remarks[0]
    for c in ("t", *recording.names):
        assert_array_equal(joined[c], recording[c])
    for c, x in stated.items():
        assert_array_equal(made.simulated[joined.name][c], x)


def test_held_out_recordings_others_with_other_readings_and_new_simulations_stay_apart(flown):
    recording, stated = flown[0][0], flown[1][0]
    parts = cut(recording)
    simulated = along(parts, recording, stated)
    apart = join_continued(parts, simulated, but_for=["m011"])
    assert [r.name for r in apart.recordings] == ["m010", "m011", "m012"]
    assert apart.simulated == simulated
    assert not apart.remarks
    begun_anew = {**simulated, "m012": {c: x + np.ptp(x) for c, x in simulated["m012"].items()}}
    assert [r.name for r in join_continued(parts, begun_anew).recordings] == ["m010 to m011", "m012"]
    first, second, _ = cut(recording, 40)
    other = replace(second, channels={**second.channels, "alpha": second["alpha"] + 1e-6})
    assert len(join_continued([first, other], {}).recordings) == 2
    wrapped = [replace(p, channels={**p.channels, "psi": (p["psi"] + np.pi) % (2.0 * np.pi) - np.pi}) for p in parts]
    assert len(join_continued(wrapped, {}).recordings) == 1


def test_the_diagnosis_does_not_depend_on_how_flights_were_cut():
    recordings, stated = fly({"Cm": {"alpha^2": -0.8}}, speeds=(42.0, 50.0), h=(1000.0, 1100.0))
    simulated = {r.name: Recording(r.name, r.t, x) for r, x in zip(recordings, stated)}
    parts = [p for r in recordings for p in cut(r)]
    of_parts = {}
    for r, x in zip(recordings, stated):
        each = cut(r)
        of_parts |= {p.name: Recording(p.name, p.t, y) for p, y in zip(each, along(each, r, x).values())}
    complete, divided = diagnose(simulated, recordings, AIRCRAFT), diagnose(of_parts, parts, AIRCRAFT)
    assert divided.recordings == ("m010 to m012", "m020 to m022")
    assert divided.verdict == complete.verdict
    assert divided.probability == pytest.approx(complete.probability, abs=1e-9)
    assert sum("were taken as one" in remark for remark in divided.remarks) == 2
    assert [f.name for f in prepare(of_parts, parts, AIRCRAFT).flights] == [p.name for p in parts]
