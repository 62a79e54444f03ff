"""Finding manoeuvres in long recordings whose inputs we set, and in real ones."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import chirp, cont2discrete, lfilter

import structsel as ss
from structsel.errors import ChannelError, DomainError
from structsel.recording import Recording, find_manoeuvres, read_recording, split_manoeuvres

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"

PATTERNS = {"doublet": (1, -1), "3211": (3, -2, 1, -1), "121": (1, -2, 1), "step": (4,)}
CONTROLS = ("de", "da", "dr")
# A short period, and a Dutch roll with a roll mode: states alpha q, beta r p; the last input is the gust.
SHORT_PERIOD = np.array([[-1.5, 1.0], [-4.0, -2.0]]), np.array([[0.0, 0.3], [-6.0, 0.6]])
LATERAL = (
    np.array([[-0.2, -1.0, 0.0], [2.5, -0.4, 0.0], [-6.0, 1.0, -4.0]]),
    np.array([[0.0, 0.02, 0.1], [-0.3, -1.5, 0.2], [-8.0, 0.5, 0.8]]),
)


def response(system, inputs, dt):
    A, B, *_ = cont2discrete((*system, np.eye(len(system[0])), np.zeros(system[1].shape)), dt)
    x, out = np.zeros(len(A)), np.empty((len(inputs), len(A)))
    for k, u in enumerate(inputs):
        out[k] = x
        x = A @ x + B @ u
    return out.T


def fly(events, end, seed=0, dt=0.02, noise=2e-4, gusts=0.0, trim=0.0, digit=0.0, drift=0.0):
    """Fly events (start, unit, control, pattern, size) with an actuator, augmentation and imperfect recording."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, end, dt)
    command = {name: np.zeros(len(t)) for name in CONTROLS}
    for start, unit, control, pattern, size in events:
        if pattern == "sweep":
            inside = (t >= start) & (t <= start + unit)
            command[control][inside] += size * chirp(t[inside] - start, 0.15, unit, 2.0, method="log", phi=-90)
            continue
        edge = start
        for part in PATTERNS[pattern]:
            command[control][(t >= edge) & (t < edge + abs(part) * unit)] += size * np.sign(part)
            edge += abs(part) * unit
    lag, keep = np.exp(-20.0 * dt), np.exp(-dt / 1.5)
    act = {name: lfilter([1.0 - lag], [1.0, -lag], values) for name, values in command.items()}
    wind = gusts * lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal((2, len(t))))
    _, q = response(SHORT_PERIOD, np.c_[act["de"], wind[0]], dt)
    _, r, p = response(LATERAL, np.c_[act["da"], act["dr"], wind[1]], dt)
    channels = {"p": p, "q": q, "r": r}
    for name, gain, rate in (("de", 0.1, q), ("da", 0.05, p), ("dr", 0.1, r)):
        values = act[name] + gain * rate + drift * np.cumsum(rng.standard_normal(len(t))) * np.sqrt(dt)
        for start in rng.uniform(0.0, end, 4):
            values = values + trim * rng.choice([-1, 1]) * np.clip((t - start) / rng.uniform(5.0, 15.0), 0.0, 1.0)
        channels[name] = values
    channels = {name: values + noise * rng.standard_normal(len(t)) for name, values in channels.items()}
    if digit:
        channels |= {name: digit * np.round(channels[name] / digit) for name in CONTROLS}
    return Recording("flight", t, channels)


def long_flight(seed, **how):
    """Ten inputs of mixed kinds between steady segments of 8 to 40 s; returns also (start, end, control) of each."""
    rng = np.random.default_rng([seed, 1])
    events, true, t = [], [], rng.uniform(5.0, 25.0)
    for _ in range(10):
        pattern = rng.choice(["doublet", "3211", "121", "step", "sweep"])
        control, unit, size = rng.choice(CONTROLS), rng.uniform(0.4, 1.2), rng.uniform(0.04, 0.12) * rng.choice([-1, 1])
        if pattern == "sweep":
            unit = length = rng.uniform(15.0, 30.0)
        else:
            length = unit * sum(map(abs, PATTERNS[pattern]))
        events.append((t, unit, control, pattern, size))
        true.append((t, t + length, control))
        t += length + rng.uniform(8.0, 40.0)
    return fly(events, t, seed, **how), true


def excited(recording, **options):
    return [segment for segment in find_manoeuvres(recording, **options) if segment.kind == "excited"]


@pytest.mark.default_cases("gusts-trim-digit-drift")
@pytest.mark.parametrize(
    "how",
    [
        {"noise": 0.0},
        {},
        {"gusts": 0.1},
        {"trim": 0.03},
        {"digit": 0.0044},
        {"drift": 1e-3},
        {"dt": 0.1},
        {"gusts": 0.1, "trim": 0.02, "digit": 0.0044, "drift": 1e-3},
    ],
    ids=lambda how: "-".join(how) or "noise only",
)
def test_inputs_of_long_flights_are_found_and_nothing_else(how):
    hits = found = inputs = 0
    for seed in range(3):
        recording, true = long_flight(seed, **how)
        segments = excited(recording)
        found, inputs = found + len(segments), inputs + len(true)
        for start, end, control in true:
            # A sweep begins slowly, so more than half of it in common is required.
            hits += any(
                min(s.moved[1], end) - max(s.moved[0], start) > 0.6 * (max(s.moved[1], end) - min(s.moved[0], start))
                and s.controls == (control,)
                for s in segments
            )
    # Thirty inputs: one may be missed, and one found in excess.
    assert hits >= inputs - 1
    assert found <= inputs + 1


@pytest.mark.default_cases(2)
@pytest.mark.parametrize("how", [{"noise": 1e-3}, {"gusts": 0.2}, {"trim": 0.03}, {"drift": 1e-3}, {"digit": 0.0044}])
def test_a_flight_without_inputs_is_steady_from_end_to_end(how):
    for seed in range(5):
        (only,) = find_manoeuvres(fly([], 300.0, seed, **how))
        assert (only.kind, only.name, only.start, only.controls) == ("steady", "s01", 0.0, ())
        assert only.end == pytest.approx(300.0, abs=0.11)


def test_an_input_and_its_free_oscillation_are_one_manoeuvre_with_steady_flight_before_it():
    recording = fly([(20.0, 0.7, "dr", "3211", 0.08)], 60.0)
    before, manoeuvre, after = find_manoeuvres(recording)
    assert_allclose(manoeuvre.moved, (20.0, 24.9), atol=0.3)
    assert manoeuvre.start == pytest.approx(manoeuvre.moved[0] - 2.0, abs=0.02)
    assert (manoeuvre.controls, manoeuvre.axis, manoeuvre.name) == (("dr",), "lateral", "m01")
    # The Dutch roll decays with exp(-0.3 t), so most of the tail is wanted; the short period dies in 3 s.
    assert 6.0 < manoeuvre.end - manoeuvre.moved[1] <= 10.0
    assert (before.start, before.end, after.start) == (0.0, manoeuvre.start, manoeuvre.end)
    (quick,) = excited(fly([(20.0, 0.7, "de", "3211", 0.08)], 60.0))
    assert 1.0 < quick.end - quick.moved[1] < 6.0
    assert quick.axis == "longitudinal"
    assert "m01: excited, 1" in str(quick)
    assert "longitudinal, de moved from 20" in str(quick)


def test_inputs_closer_than_quiet_are_one_manoeuvre_and_farther_ones_are_not():
    events = [(20.0, 0.5, "de", "doublet", 0.08), (27.0, 0.5, "da", "doublet", 0.1)]
    recording = fly(events, 60.0)
    assert [s.controls for s in excited(recording)] == [("de",), ("da",)]
    (both,) = excited(recording, quiet=8.0)
    assert set(both.controls) == {"de", "da"}
    assert both.axis == "mixed"
    first, second = excited(recording)
    assert first.end <= second.start


def test_a_step_held_and_taken_back_is_one_manoeuvre():
    (sideslip,) = excited(fly([(20.0, 3.0, "dr", "step", 0.1)], 80.0))
    # The augmentation still answers the Dutch roll for a while after the return.
    assert sideslip.moved[0] == pytest.approx(20.0, abs=0.1)
    assert 32.0 <= sideslip.moved[1] < 36.0


def test_segments_are_in_order_and_do_not_overlap():
    recording, _ = long_flight(4, gusts=0.1)
    segments = find_manoeuvres(recording)
    assert [s.name for s in segments if s.kind == "excited"] == [f"m{k:02d}" for k in range(1, 11)]
    for one, following in pairwise(segments):
        assert one.start < one.end <= following.start
    assert segments[-1].end <= recording.t[-1]


def test_without_controls_the_angular_rates_are_used():
    complete = fly([(20.0, 0.6, "da", "doublet", 0.1), (45.0, 0.6, "de", "doublet", 0.1)], 80.0)
    rates = Recording("rates", complete.t, {name: complete[name] for name in "pqr"})
    lateral, longitudinal = excited(rates)
    assert lateral.moved[0] == pytest.approx(20.0, abs=0.5)
    assert longitudinal.moved[0] == pytest.approx(45.0, abs=0.5)
    assert (longitudinal.controls, longitudinal.axis, lateral.axis) == (("q",), "longitudinal", "lateral")


def test_no_segment_reaches_across_a_gap():
    complete = fly([(20.0, 0.6, "de", "3211", 0.08)], 60.0)
    keep = (complete.t < 25.0) | (complete.t > 40.0)
    cut = Recording("cut", complete.t[keep], {name: complete[name][keep] for name in complete.names})
    assert all(s.end <= 25.0 or s.start >= 40.0 for s in find_manoeuvres(cut))
    assert excited(cut)[0].end == pytest.approx(24.98, abs=0.03)


def test_missing_samples_and_spikes_are_no_inputs():
    complete = fly([(20.0, 0.6, "de", "3211", 0.08)], 60.0)
    de = complete["de"].copy()
    de[500:520] = np.nan
    de[2000] = 0.5
    (only,) = excited(complete.with_channels(de=de))
    assert_allclose(only.moved, (20.0, 24.2), atol=0.3)


def test_manoeuvres_are_cut_named_and_noted():
    recording, true = long_flight(0)
    cuts = split_manoeuvres(recording)
    segments = excited(recording)
    assert [cut.name for cut in cuts] == [f"flight_m{k:02d}" for k in range(1, len(true) + 1)]
    for cut, segment in zip(cuts, segments):
        assert cut.t[0] == pytest.approx(segment.start)
        assert cut.t[-1] == pytest.approx(segment.end)
        assert_allclose(cut["de"], recording.between(cut.t[0], cut.t[-1])["de"], rtol=0, atol=0)
        assert cut.provenance[-1] == f"manoeuvre {segment}"
        assert cut.provenance[-2].endswith("of 'flight'")
    assert split_manoeuvres(fly([], 60.0)) == []


def test_a_recording_without_usable_channels_and_impossible_lengths_are_refused():
    bare = Recording("bare", np.arange(100.0), {"V": np.ones(100)})
    with pytest.raises(ChannelError, match=r"find_manoeuvres needs channels 'de' \[rad\].*'bare' has none"):
        find_manoeuvres(bare)
    with pytest.raises(ChannelError, match="'stick'"):
        find_manoeuvres(bare, channels=["stick"])
    with pytest.raises(DomainError, match=r"quiet >= lead; quiet is 1, lead 2"):
        find_manoeuvres(bare, quiet=1.0)


@pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings (../shared/data) are not here")
@pytest.mark.parametrize(
    ("name", "control", "moved"),
    # By eye from the control's own trace.
    [
        ("fAttasElv1", "de", (5.6, 12.4)),
        ("fAttasAil1", "da", (55.7, 60.8)),
        ("fAttasRud1", "dr", (116.1, 123.0)),
    ],
)
def test_attas_inputs_are_found_where_the_pilot_made_them(name, control, moved):
    recording = read_recording(DATA / "attas-manoeuvres" / f"{name}.mat", ROOT / "examples" / "attas_map.toml")
    (only,) = excited(recording)
    assert only.controls == (control,)
    assert_allclose(only.moved, moved, atol=0.6)


@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings of ../shared/data are not here")
@pytest.mark.parametrize(
    ("name", "control", "end"),
    [("de3211_1", "de", 27.0), ("da3211_2", "da", 27.0), ("dr3211_1", "dr", 27.0), ("dadoublet_1", "da", 12.0)],
)
def test_citation_inputs_without_any_noise_are_found(name, control, end):
    recording = ss.read_recording(DATA / "citation-sim" / f"{name}.mat")
    (only,) = excited(recording)
    assert only.controls == (control,)
    assert_allclose(only.moved, (20.0 if end == 27.0 else 10.0, end), atol=0.05)
