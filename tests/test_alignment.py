import numpy as np
import pytest
from numpy.testing import assert_allclose

import structsel as ss
from structsel.errors import ChannelError, DomainError
from structsel.numerics.dynamic_elements import shift


def test_an_integer_number_of_samples_is_shifted_exactly_and_the_end_is_unknown():
    x = np.random.default_rng(3).standard_normal(50)
    t = 0.1 * np.arange(50)
    got = shift(x, t, 0.3)
    assert_allclose(got[:-3], x[3:], rtol=1e-12, atol=1e-12)
    assert np.isnan(got[-3:]).all()
    got = shift(x, t, -0.3)
    assert_allclose(got[3:], x[:-3], rtol=1e-12, atol=1e-12)
    assert np.isnan(got[:3]).all()
    assert_allclose(shift(x, t, 0.0), x, rtol=1e-12)


def test_a_shift_between_samples_follows_the_signal():
    t = 0.02 * (np.arange(500) + np.random.default_rng(4).uniform(-0.3, 0.3, 500))
    got = shift(np.sin(t), t, 0.0213)
    known = np.isfinite(got)
    assert known.sum() >= 490
    assert_allclose(got[known], np.sin(t + 0.0213)[known], atol=1e-4)


def test_nothing_is_made_up_next_to_missing_samples_or_in_a_gap():
    t = np.concatenate([0.1 * np.arange(20), 5.0 + 0.1 * np.arange(20)])
    x = t.copy()
    x[8:10] = np.nan
    got = shift(x, t, 0.05)
    lost = np.flatnonzero(np.isnan(got))
    # Half a step ahead of 0.7 s lies between a sample and none; 1.9 s is the last before the gap.
    assert lost.tolist() == [7, 8, 9, 19, 39]
    assert_allclose(got[~np.isnan(got)], (t + 0.05)[~np.isnan(got)], rtol=1e-12)
    with pytest.raises(DomainError, match="finite delay"):
        shift(x, t, np.nan)


def test_a_recording_is_aligned_and_says_by_how_much():
    t = 0.1 * np.arange(100)
    recording = ss.Recording("flight", t, {"alpha": np.sin(t - 0.2), "theta": np.sin(t)})
    got = recording.align({"alpha": 0.2})
    assert_allclose(got["alpha"][:-2], np.sin(t)[:-2], atol=1e-12)
    assert got["theta"] is recording["theta"]
    assert got.provenance[-1] == "advanced in time: alpha by 0.2 s (2 samples lost)"
    assert [(f.kind, f.channel, f.count) for f in got.findings] == [("not-finite", "alpha", 2)]
    with pytest.raises(ChannelError, match="align needs channel 'beta'"):
        recording.align({"beta": 0.1})


@pytest.mark.parametrize("start", [-np.pi, 0.0])
def test_wraps_are_unwrapped_like_numpy_does_also_past_missing_samples(start):
    # Headings logged from -180 to 180, and from 0 to 360 degrees.
    t = 0.1 * np.arange(600)
    truth = 3.0 + 0.4 * t * np.sin(0.1 * t)
    wrapped = np.mod(truth - start, 2 * np.pi) + start
    recording = ss.Recording("flight", t, {"psi": wrapped})
    got = recording.unwrap("psi")
    assert_allclose(got["psi"], np.unwrap(wrapped), atol=1e-12)
    assert "removed, at samples" in got.provenance[-1]
    holed = wrapped.copy()
    holed[100:104] = np.nan
    got = ss.Recording("flight", t, {"psi": holed}).unwrap("psi")
    known = np.isfinite(holed)
    assert_allclose(got["psi"][known], np.unwrap(wrapped)[known], atol=1e-12)
    assert np.isnan(got["psi"][~known]).all()


def test_a_jump_that_is_no_full_turn_is_left():
    x = np.concatenate([np.zeros(50), np.full(50, 4.0)])
    recording = ss.Recording("flight", 0.1 * np.arange(100), {"phi": x})
    assert recording.unwrap("phi")["phi"] is recording["phi"]
    assert_allclose(recording.unwrap("phi", turn=4.0)["phi"], 0.0)
