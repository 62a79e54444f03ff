import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

import structsel as ss
from structsel.errors import ChannelError, DataError, DomainError
from structsel.numerics.alignment import estimate_delay, shift

from .signals import step_response

DT = 0.04


@pytest.fixture(scope="module")
def motion():
    """Incidence after a 3-2-1-1 at any time, from samples forty times as dense."""
    t, states, _ = step_response(DT / 20, seconds=22.0)
    return lambda at: np.interp(at, t, states[:, 0])


def coloured(n, memory, rng):
    return lfilter([np.sqrt(1 - memory**2)], [1, -memory], rng.standard_normal(n + 500))[500:]


CASES = [(0.12, 0.0, 0.02), (0.0131, 0.0, 0.1), (-0.0371, 0.7, 0.02), (0.2, 0.9, 0.02), (0.0531, 0.9, 0.1)]


@pytest.mark.parametrize(("delay", "memory", "level"), CASES)
def test_a_planted_delay_is_found_below_the_sample_with_the_accuracy_stated(motion, delay, memory, level):
    t = 1.0 + DT * np.arange(500)
    leader = motion(t)
    errors, stated = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noise = level * leader.std() * np.array([coloured(t.size, memory, rng) for _ in range(2)])
        # Another gain and offset, and the noise of both.
        late = 0.3 - 1.2 * (motion(t - delay) + noise[0])
        found, std = estimate_delay(late, leader + noise[1], DT, 0.3)
        errors.append(found - delay)
        stated.append(std)
    ratio = np.sqrt(np.mean(np.square(errors))) / np.sqrt(np.mean(np.square(stated)))
    # The rms of 20 errors scatters by 16 %: three of that about 1, and 1.3 where the noise is long.
    assert 0.6 < ratio < (1.75 if memory > 0.8 else 1.45)
    assert abs(np.mean(errors)) < 3.5 * np.std(errors) / np.sqrt(len(errors))


def test_without_noise_the_delay_is_exact(motion):
    t = 1.0 + DT * np.arange(500)
    for delay in (0.1, 0.0137, -0.05):
        found, std = estimate_delay(motion(t - delay), motion(t), DT, 0.2)
        assert found == pytest.approx(delay, abs=2e-4)
        assert std < 1e-3


def test_noise_does_not_draw_the_delay_to_complete_or_half_samples():
    # Linear interpolation of a noisy reference would: its noise variance is half as large between samples.
    t = DT * np.arange(1500)
    rng = np.random.default_rng(0)
    for fraction in (0.25, 0.75):
        found = []
        for _ in range(6):
            noise = 0.2 * rng.standard_normal((2, t.size))
            late = np.sin(t - fraction * DT) + 0.3 * np.sin(2.7 * (t - fraction * DT)) + noise[0]
            found.append(estimate_delay(late, np.sin(t) + 0.3 * np.sin(2.7 * t) + noise[1], DT, 0.2))
        error = np.mean([f for f, _ in found]) - fraction * DT
        assert abs(error) < 3 * found[0][1] / np.sqrt(6)


def test_missing_samples_of_both_channels_are_left_out(motion):
    t = 1.0 + DT * np.arange(500)
    errors, stated = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        late, leader = (motion(t - d) + 0.02 * motion(t).std() * rng.standard_normal(t.size) for d in (0.055, 0.0))
        late[100:115], leader[200:230], leader[350] = np.nan, np.nan, np.nan
        found, std = estimate_delay(late, leader, DT, 0.2)
        errors.append(found - 0.055)
        stated.append(std)
    # The rms of 12 errors scatters by 20 %.
    assert np.sqrt(np.mean(np.square(errors))) < 1.6 * np.mean(stated)
    assert np.mean(stated) < 0.001


@pytest.mark.parametrize(
    ("late", "options", "error", "says"),
    [
        (lambda t: np.sin(t - 0.5), {"max_delay": 0.2}, DataError, "the end of the range"),
        (np.ones_like, {"max_delay": 0.2}, DataError, "a signal that moves"),
        (np.sin, {"max_delay": 9.9}, DataError, "needs 40"),
        (np.sin, {"max_delay": 0.0}, DomainError, "max_delay above zero"),
        (lambda t: t[:-1], {"max_delay": 0.2}, DomainError, "of one length"),
    ],
)
def test_what_cannot_be_estimated_is_said(late, options, error, says):
    t = DT * np.arange(500)
    with pytest.raises(error, match=says):
        estimate_delay(late(t), np.sin(t), DT, **options)


def test_a_ramp_cannot_tell_a_delay_from_an_offset():
    t = DT * np.arange(250)
    rng = np.random.default_rng(2)
    late, leader = t + 1e-3 * rng.standard_normal((2, t.size))
    with pytest.raises(DataError, match=r"a delay from an offset|the end of the range"):
        estimate_delay(late, leader, DT, 0.2)


def test_a_complete_number_of_samples_is_shifted_exactly_and_the_end_is_unknown():
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


def test_a_jump_that_is_no_complete_turn_is_left():
    x = np.concatenate([np.zeros(50), np.full(50, 4.0)])
    recording = ss.Recording("flight", 0.1 * np.arange(100), {"phi": x})
    assert recording.unwrap("phi")["phi"] is recording["phi"]
    assert_allclose(recording.unwrap("phi", turn=4.0)["phi"], 0.0)
