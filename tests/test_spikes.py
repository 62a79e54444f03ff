from pathlib import Path

import numpy as np
import pytest
from scipy.signal import savgol_filter

import structsel as ss
from structsel.errors import ChannelError, DomainError
from structsel.numerics.signal_quality import find_spikes

from .signals import step_response

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings (../shared/data) are not here")
MOTION = ("p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az", "alpha", "beta")


def real_recordings():
    yield ss.read_recording(DATA / "hfb320" / "hfb320_1_10.asc", ROOT / "examples" / "hfb320_map.toml")
    for name in ("fAttasElv1", "fAttasElv2", "fAttasAil1", "fAttasRud1", "fAttasAilRud2"):
        path = DATA / "attas-manoeuvres" / f"{name}.mat"
        yield from ss.read_recording(path, ROOT / "examples" / "attas_map.toml").split()


@needs_data
def test_real_motion_holds_no_spikes():
    # 7 recordings, 11 channels, some 45,000 samples of rates, attitudes, accelerations and vanes.
    alarms = {
        (recording.name, name): samples.tolist()
        for recording in real_recordings()
        for name in MOTION
        if name in recording and (samples := find_spikes(recording[name])[0]).size
    }
    assert not alarms


@needs_data
@pytest.mark.parametrize("name", ["p", "q", "theta", "az"])
def test_spikes_planted_in_real_motion_are_found_and_nothing_else(name):
    rng = np.random.default_rng(0)
    found = planted = others = 0
    for recording in real_recordings():
        x = recording[name]
        # What a parabola over nine samples leaves, here by scipy: noise and the fastest motion together.
        left = x - savgol_filter(x, 9, 2)
        for start in range(20, x.size - 20, 60):
            k = start + int(rng.integers(0, 20))
            spiked = x.copy()
            spiked[k] += 8.0 * np.abs(left[k - 20 : k + 21]).max() * rng.choice([-1.0, 1.0])
            samples = find_spikes(spiked)[0]
            planted += 1
            found += k in samples
            others += samples.size - (k in samples)
    assert found >= 0.85 * planted
    assert others <= 0.02 * planted


@pytest.mark.default_cases("8.0-0.85")
@pytest.mark.parametrize(("size", "fraction"), [(8.0, 0.85), (12.0, 0.99)])
def test_spikes_of_eight_sigma_on_white_noise_are_found_nine_times_in_ten_and_of_twelve_always(size, fraction):
    found = 0
    for seed in range(200):
        x = np.random.default_rng(seed).standard_normal(200)
        x[100] += size
        found += 100 in find_spikes(x)[0]
    assert found >= 200 * fraction


def test_white_noise_raises_no_more_than_one_alarm_in_ten_thousand_samples():
    x = np.random.default_rng(1).standard_normal(50_000)
    assert find_spikes(x)[0].size <= 5


@pytest.mark.parametrize("width", [1, 2, 3])
def test_a_group_is_found_completely_and_the_true_values_are_restored(width):
    t, states, _ = step_response(0.02)
    x = states[:, 0]
    noise = 1e-3 * x.std() * np.random.default_rng(width).standard_normal(t.size)
    spiked = x + noise
    spiked[700 : 700 + width] -= 0.5 * x.std()
    samples, values = find_spikes(spiked)
    assert samples.tolist() == list(range(700, 700 + width))
    np.testing.assert_allclose(values, x[samples], atol=4e-3 * x.std())


@pytest.mark.parametrize("level", [0.0, 1e-3])
@pytest.mark.parametrize("width", [4, 5, 10])
def test_steps_and_doublets_of_a_control_are_not_spikes(width, level):
    x = level * np.random.default_rng(width).standard_normal(400)
    x[100:] += 1.0  # a step
    x[200 : 200 + width] += 1.0  # a doublet
    x[200 + width : 200 + 2 * width] -= 1.0
    x[300 : 300 + width] += 1.0  # a pulse
    assert find_spikes(x)[0].size == 0


@pytest.mark.parametrize("dt", [0.02, 0.04, 0.1])
def test_the_kinks_of_a_sharp_manoeuvre_are_not_spikes(dt):
    _, states, rates = step_response(dt, width=0.5)
    for x in (*states.T, *rates.T):
        assert find_spikes(x)[0].size == 0


def test_a_held_channel_is_judged_by_its_changes():
    rng = np.random.default_rng(2)
    slow = np.sin(0.05 * np.arange(200)) + 0.01 * rng.standard_normal(200)
    slow[90] += 0.5
    samples, values = find_spikes(np.repeat(slow, 5))
    assert samples.tolist() == [450, 451, 452, 453, 454]
    assert np.ptp(values) == 0.0


def test_one_step_of_a_coarse_channel_is_not_a_spike():
    x = np.zeros(300)
    x[150] = 0.1
    x[200:] = 0.1
    x[::7] += 0.1  # toggling between two levels
    assert find_spikes(x)[0].size == 0


def test_missing_samples_are_never_spikes_and_hide_none():
    x = 0.01 * np.random.default_rng(3).standard_normal(300)
    x[140:144] = np.nan
    x[160] = 1.0
    assert find_spikes(x)[0].tolist() == [160]


@pytest.mark.parametrize("options", [{"threshold": 0.0}, {"longest": 4}])
def test_options_out_of_range_are_refused(options):
    with pytest.raises(DomainError, match="threshold above 0 and longest 1, 2 or 3"):
        find_spikes(np.zeros(50), **options)


def test_every_sample_a_recording_had_replaced_is_reported_with_its_old_value():
    t = 0.02 * np.arange(500)
    q = 0.1 * np.sin(t) + 1e-3 * np.random.default_rng(4).standard_normal(500)
    q[[100, 300, 301]] += 0.05
    recording = ss.Recording("flight", t, {"q": q, "p": np.cos(t)})
    clean = recording.remove_spikes("q", "p")
    touched = np.flatnonzero(clean["q"] != recording["q"])
    assert touched.tolist() == [100, 300, 301]
    [finding] = [f for f in clean.findings if f.kind == "spike"]
    assert (finding.channel, finding.sample, finding.time, finding.count) == ("q", 100, 2.0, 3)
    for sample in touched:
        assert f"{sample} (t = {t[sample]:g} s, was {q[sample]:.6g}, is " in clean.provenance[-1]
    np.testing.assert_allclose(clean["q"][touched], 0.1 * np.sin(t[touched]), atol=4e-3)
    # A channel without spikes is passed on as it is, without a word; the treatment survives the next one.
    assert clean["p"] is recording["p"]
    assert not any(note.startswith("p:") for note in clean.provenance)
    assert any(f.kind == "spike" for f in clean.align({"q": 0.1}).findings)


def test_a_missing_channel_is_named():
    recording = ss.Recording("flight", np.arange(3.0), {"q": np.zeros(3)})
    with pytest.raises(ChannelError, match="remove_spikes needs channel 'r'"):
        recording.remove_spikes("r")
