"""The recursive estimate is that of all samples at once, follows a change, and reads a file that grows."""

import json
import threading
import time

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal
from scipy.stats import chi2

import structsel as ss
from structsel.errors import ChannelError, DataError, DomainError
from structsel.numerics import frequency_regression, spectra
from structsel.recording.growing import GrowingFile
from tests.commands import run

DT = 0.02
FREQUENCIES = np.arange(0.1, 1.5, 0.05)
TRUTH = {"alpha": -4.0, "q": -1.5, "de": -6.0}


def flight(seed=0, duration=40.0, changed=None, noise=0.02, start=5.0):
    """Pitching motion that satisfies q_dot = M_alpha alpha + M_q q + M_de de, exactly, except for noise on q_dot.

    From half of the time on the elevator has `changed` instead of its effectiveness.
    """
    rng = np.random.default_rng(seed)
    t = start + DT * np.arange(round(duration / DT))
    b, a = signal.butter(2, 1.2, fs=1.0 / DT)
    de = 0.3 * signal.lfilter(b, a, rng.standard_normal(t.size))
    alpha, q, q_dot = np.zeros(t.size), np.zeros(t.size), np.zeros(t.size)
    error = noise * rng.standard_normal(t.size)
    for k in range(t.size):
        M_de = TRUTH["de"] if changed is None or k < t.size // 2 else changed
        q_dot[k] = TRUTH["alpha"] * alpha[k] + TRUTH["q"] * q[k] + M_de * de[k] + error[k]
        if k + 1 < t.size:
            q[k + 1] = q[k] + DT * q_dot[k]
            alpha[k + 1] = alpha[k] + DT * (q[k] - 0.9 * alpha[k])
    channels = {"alpha": alpha + 0.03, "q": q, "de": de - 0.02, "q_dot": q_dot}
    return ss.Recording(f"flight{seed}", t, channels)


def estimator(**options):
    return ss.RecursiveEstimator("q_dot", list(TRUTH), frequencies=FREQUENCIES, **options)


def batch(recording):
    X = np.column_stack([recording[name] for name in TRUTH])
    return frequency_regression.equation_error(X, recording["q_dot"], DT, FREQUENCIES)


# --- agreement with the estimate from all samples --------------------------------------------------


def test_the_last_estimate_is_that_of_all_samples_at_once():
    recording = flight()
    found = estimator()
    found.feed(recording)
    last, expected = found.estimate(), batch(recording)
    assert_allclose(last.values, expected.theta, rtol=1e-9)
    assert_allclose(last.std, expected.std, rtol=1e-8)
    assert_allclose(last.r2, expected.r2, rtol=1e-9)
    assert (last.t, last.samples) == (recording.t[-1], len(recording))


def test_every_estimate_is_that_of_the_samples_so_far():
    recording = flight()
    for one in estimator().feed(recording, every=10.0):
        so_far = recording.between(recording.t[0], one.t)
        assert_allclose(one.values, batch(so_far).theta, rtol=1e-8)


def test_the_estimate_of_equation_error_in_refinement_is_the_same():
    # At its own frequencies, multiples of 1 / T.
    recording = flight()
    model = ss.AeroModel.from_terms({"q_dot": dict.fromkeys(TRUTH, 1.0)})
    expected = ss.equation_error(model, None, recording, domain="frequency", band=(0.1, 1.5))
    multiples = spectra.choose_frequencies(recording.duration, 0.1, 1.5)
    found = ss.RecursiveEstimator("q_dot", list(TRUTH), frequencies=multiples)
    found.feed(recording)
    assert_allclose(found.estimate().values, expected.values, rtol=1e-8)


def test_samples_one_by_one_and_parts_give_the_same():
    recording = flight(duration=20.0)
    complete, single, parts = estimator(), estimator(), estimator()
    complete.feed(recording)
    for k, t in enumerate(recording.t):
        single.update(t, {name: recording[name][k] for name in recording.names})
    for start in (5.0, 10.0, 17.3):
        parts.feed(recording.between(start, {5.0: 10.0, 10.0: 17.3, 17.3: 30.0}[start]), after=parts.estimate().t)
    for other in (single, parts):
        assert_allclose(other.estimate().values, complete.estimate().values, rtol=1e-12)


@pytest.mark.parametrize("forgetting", [1.0, 0.999])
def test_the_derivative_of_a_channel_is_taken_in_the_frequency_domain(forgetting):
    # Motion and its derivative from scipy.signal.lsim, with an elevator that is linear between samples.
    t, de = DT * np.arange(2000), flight(duration=40.0)["de"]
    system = signal.StateSpace(
        [[-0.9, 1.0], [TRUTH["alpha"], TRUTH["q"]]], [[0.0], [TRUTH["de"]]], np.eye(2), np.zeros((2, 1))
    )
    alpha, q = signal.lsim(system, de, t)[1].T
    q_dot = TRUTH["alpha"] * alpha + TRUTH["q"] * q + TRUTH["de"] * de
    motion = {"alpha": alpha, "q": q, "de": de}
    by_parts, recorded = estimator(forgetting=forgetting), estimator(forgetting=forgetting)
    by_parts.feed(ss.Recording("f", t, motion))
    recorded.feed(ss.Recording("f", t, {**motion, "q_dot": q_dot}))
    assert_allclose(recorded.estimate().values, list(TRUTH.values()), rtol=1e-8)
    assert_allclose(by_parts.estimate().values, list(TRUTH.values()), rtol=0.005)
    assert by_parts.estimate().r2 > 0.9999


# --- forgetting ----------------------------------------------------------------------------------


def test_a_change_is_followed_with_forgetting_and_averaged_without():
    recording = flight(duration=120.0, changed=-3.0)
    fading, constant = estimator(forgetting=float(np.exp(-DT / 10.0))), estimator()
    before = recording.between(5.0, 64.0)
    fading.feed(before)
    value, std = fading.estimate()["de"]
    assert abs(value - TRUTH["de"]) < 4.0 * std
    fading.feed(recording, after=64.0 + 1e-9)
    constant.feed(recording)
    value, std = fading.estimate()["de"]
    assert abs(value + 3.0) < 4.0 * std
    assert std < 0.2
    assert -5.5 < constant.estimate()["de"][0] < -3.8


def scores(seeds, forgetting):
    """Errors of the estimates in their standard errors; the noise is that of the recorded q_dot."""
    found = []
    for seed in seeds:
        one = estimator(forgetting=forgetting)
        exact = flight(seed, noise=0.0, duration=24.0)
        noise = 0.3 * np.random.default_rng([3, seed]).standard_normal(len(exact))
        one.feed(exact.with_channels(q_dot=exact["q_dot"] + noise))
        found.append((one.estimate().values - list(TRUTH.values())) / one.estimate().std)
    return np.array(found)


@pytest.mark.parametrize("forgetting", [1.0, 0.998])
def test_errors_are_as_large_as_stated(forgetting):
    # The mean of squares scatters at most as if each flight had one score: chi-squared of 8, 1 in 1,000 on each side.
    total = np.mean(np.square(scores(range(8), forgetting))) * 8.0
    assert chi2.ppf(0.001, 8) < total < chi2.ppf(0.999, 8)


@pytest.mark.slow
@pytest.mark.parametrize("forgetting", [1.0, 0.998])
def test_intervals_hold_as_often_as_stated(forgetting):
    # 240 scores, correlated within a flight: three standard deviations of 120 independent ones.
    within = np.mean(np.abs(scores(range(100, 180), forgetting)) < 1.96)
    assert abs(within - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 120.0)


# --- what is refused -----------------------------------------------------------------------------


def test_what_cannot_be_used_is_refused():
    with pytest.raises(ChannelError, match="without the constant"):
        ss.RecursiveEstimator("q_dot", ["1", "alpha"])
    with pytest.raises(DomainError, match="forgetting factor"):
        estimator(forgetting=1.2)
    with pytest.raises(DomainError, match="1 frequencies give 2 equations for 3 parameters"):
        ss.RecursiveEstimator("q_dot", list(TRUTH), frequencies=[0.5])
    with pytest.raises(ChannelError, match="needs channel 'Cm'"):
        ss.RecursiveEstimator("Cm", ["alpha"]).feed(flight(duration=2.0))
    recording = flight(duration=2.0)
    q_dot = recording["q_dot"].copy()
    q_dot[7] = np.nan
    with pytest.raises(DataError, match=r"finite samples; that at t = 5\.14 s is not"):
        estimator().feed(recording.with_channels(q_dot=q_dot))
    jump = ss.Recording("jump", np.r_[recording.t[:50], recording.t[50:] + 1.0], dict(recording.channels))
    with pytest.raises(DataError, match=r"samples 0\.02 s apart; after t = 5\.98 s comes 7 s"):
        estimator().feed(jump)


def test_without_enough_samples_there_is_no_estimate():
    found = estimator()
    assert not found.estimate().determined
    found.feed(flight(duration=0.5))
    assert not found.estimate().determined
    assert "do not determine" in str(found.estimate())


# --- a file that grows ---------------------------------------------------------------------------


def write_csv(recording, path, rows=slice(None), header=True):
    lines = [",".join(("t", *recording.names))] if header else []
    samples = np.column_stack([recording.t, *(recording[n] for n in recording.names)])[rows]
    lines += [",".join(f"{x:.9g}" for x in row) for row in samples]
    with path.open("a", encoding="utf-8") as stream:
        stream.write("\n".join(lines) + "\n")


def test_a_growing_file_is_read_in_parts_down_to_half_lines(tmp_path):
    recording, path = flight(duration=4.0), tmp_path / "live.csv"
    growing = GrowingFile(path)
    assert growing.read_new() is None
    write_csv(recording, path, slice(0, 50))
    assert len(growing.read_new()) == 50
    assert growing.read_new() is None
    write_csv(recording, path, slice(50, 51), header=False)
    one = growing.read_new()
    assert_allclose(one.t, recording.t[49:51])
    with path.open("a") as stream:
        stream.write("6.02,0.1")
    assert growing.read_new() is None
    path.write_text("t,q\n")
    with pytest.raises(DataError, match="became shorter"):
        growing.read_new()


def test_the_header_of_a_growing_file_states_the_units(tmp_path):
    path = tmp_path / "live.csv"
    path.write_text("t,alpha [deg]\n" + "".join(f"{0.1 * k:.1f},{k}\n" for k in range(5)))
    growing = GrowingFile(path)
    assert_allclose(growing.read_new()["alpha"], np.deg2rad(np.arange(5.0)))
    with path.open("a") as stream:
        stream.write("0.5,5\n0.6,6\n")
    assert_allclose(growing.read_new()["alpha"], np.deg2rad([4.0, 5.0, 6.0]))


def test_the_command_follows_a_file_and_ends_where_the_complete_file_does(tmp_path):
    recording, path = flight(duration=20.0), tmp_path / "live.csv"
    write_csv(recording, path, slice(0, 100))

    def write_on():
        for start in range(100, len(recording), 150):
            time.sleep(0.05)
            write_csv(recording, path, slice(start, min(start + 150, len(recording))), header=False)

    options = ("--response", "q_dot", "--terms", "alpha,q,de", "--every", "5", "--json")
    writer = threading.Thread(target=write_on)
    writer.start()
    followed = run("monitor", path, *options, "--follow", "--idle", "1")
    writer.join()
    complete = run("monitor", path, *options)
    ends = [json.loads(done.stdout.splitlines()[-1]) for done in (followed, complete)]
    assert [one["t"] for one in map(json.loads, followed.stdout.splitlines())] == [10.0, 15.0, 20.0, 24.98]
    assert ends[0] == ends[1]
    values = [one["value"] for one in ends[0]["parameters"]]
    assert_allclose(values, list(TRUTH.values()), rtol=0.05)
    assert "nothing was added" in followed.stderr


def test_the_command_prints_a_line_for_each_interval(tmp_path):
    path = tmp_path / "flight.csv"
    write_csv(flight(duration=12.0), path)
    done = run("monitor", path, "--response", "q_dot", "--terms", "alpha,q,de", "--every", "4", "--memory", "8")
    head, *lines = done.stdout.splitlines()
    assert "q_dot on alpha, q, de" in head
    assert [line.split()[0] for line in lines] == ["8.00", "12.00", "16.00", "16.98"]
    assert "+-" in lines[-1]
    assert "above zero" in run("monitor", path, "--response", "q", "--terms", "de", "--every", "0", code=2).output
