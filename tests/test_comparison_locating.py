"""Where, when and how: effects put into synthetic differences are found where they were put, and noise is not."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from structsel.comparison.flight import Flight
from structsel.comparison.locating.ceiling import explainable
from structsel.comparison.locating.changes import find_changes, find_windows, standing_out
from structsel.comparison.locating.character import characterise
from structsel.comparison.locating.coherence import coherences
from structsel.comparison.locating.region import bounds_of, find_region
from structsel.comparison.locating.turbulence import find_turbulence
from structsel.comparison.locating.windows import acting, find_intervals, segments_of
from structsel.comparison.noise import Noise, bins_of, edge_of
from structsel.demo.aircraft import demo_aircraft
from structsel.numerics.atmosphere import dryden_gusts
from structsel.numerics.fourier_series import spectrum

AIRCRAFT = demo_aircraft()
DT = 0.04
T = np.arange(0.0, 30.0, DT)


def wander(rng, n, seconds, sd):
    """Noise that keeps for some seconds."""
    keep = np.exp(-DT / seconds)
    return sd * np.sqrt(1.0 - keep**2) * lfilter([1.0], [1.0, -keep], rng.standard_normal(n + 500))[500:]


def make(count, seed, differences, V=60.0):
    """Flights whose channels wander, and whose differences are functions of them."""
    made = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        n = len(T)
        ch = {c: wander(rng, n, 0.7, 0.05) for c in ("alpha", "beta", "de", "da", "dr")}
        # An aircraft turns smoothly; its gyros are the quieter for it.
        ch |= {
            c: gaussian_filter1d(wander(rng, n, 0.3, 0.2), 10.0) + 3e-4 * rng.standard_normal(n)
            for c in ("p", "q", "r")
        }
        ch |= {c: wander(rng, n, 2.0, 0.1) for c in ("phi", "theta", "psi")}
        ch |= {"ax": np.zeros(n), "ay": np.zeros(n), "az": -9.8 + 0.02 * rng.standard_normal(n)}
        ch |= {"V": V + wander(rng, n, 3.0, 2.0), "rho": np.full(n, 1.2), "mass": np.full(n, 1000.0)}
        ch |= {
            "thrust": np.full(n, 500.0),
            "qbar_ratio": np.ones(n),
            "h_agl": 20.0 - 18.0 * np.exp(-(((T - 15.0 - k) / 4.0) ** 2)),
        }
        stated = differences(ch, rng, k)
        simulated = {c: np.zeros(n) for c in stated if not c.startswith("k_")}
        made.append(Flight(f"m{k + 1}", T, DT, AIRCRAFT, ch, dict(ch), stated, simulated, frozenset(ch)))
    return made


def spectra_of(flights):
    return [{c: spectrum(x, bins_of(f), edge_of(f)) for c, x in f.difference.items()} for f in flights]


def white(flights, sd):
    """Noise that is as strong at every frequency, by response."""
    edges = np.geomspace(0.01, 12.0, 5)
    level = {(f.name, c): 1.0 for f in flights for c in sd}
    return Noise(edges, {c: np.full(5, np.log(s)) for c, s in sd.items()}, level)


def noise_only(ch, rng, k):
    return {"CZ": 0.01 * rng.standard_normal(len(T)), "Cm": 0.01 * rng.standard_normal(len(T))}


def test_short_pauses_are_closed_and_blips_left_out():
    t = np.arange(0.0, 10.0, 0.1)
    on = ((t > 0.95) & (t < 2.0)) | ((t > 2.45) & (t < 4.05)) | ((t > 6.95) & (t < 7.15))
    (only,) = segments_of(t, on)
    assert_allclose(only, (1.0, 4.0), atol=1e-9)
    assert segments_of(t, np.zeros(len(t), dtype=bool)) == []


def test_an_effect_acts_where_it_is_above_a_fraction_of_its_maximum():
    flights = make(3, 1, noise_only)
    bump = np.exp(-0.5 * ((T - 12.0) / 1.5) ** 2)
    stated = [{"CZ": 0.05 * bump, "Cm": 1e-4 * np.ones(len(T))}, {"CZ": np.zeros(len(T))}, {}]
    found = find_intervals(flights, stated, {"CZ": 0.01, "Cm": 0.01})
    # A bell is above 0.21 of its height within sqrt(-2 ln 0.21) standard deviations.
    reach = 1.5 * np.sqrt(-2.0 * np.log(0.21))
    ((start, end),) = found["m1"]
    assert_allclose((start, end), (12.0 - reach, 12.0 + reach), atol=0.12)
    assert found["m2"] == found["m3"] == []


def test_an_effect_that_acts_all_the_time_has_no_intervals():
    flights = make(2, 1, noise_only)
    steady = [{"CZ": 0.05 + 0.01 * np.sin(T)} for _ in flights]
    assert find_intervals(flights, steady, {"CZ": 0.01}) == {}
    nothing = find_intervals(flights, [{}, {}], {"CZ": 0.01})
    assert nothing == {"m1": [], "m2": []}


def test_nothing_acts_below_a_tenth_of_the_noise():
    faint = [{"CZ": 1e-4 * np.exp(-((T - 10.0) ** 2))}]
    assert not acting(faint, {"CZ": 0.01})[0].any()


def test_an_effect_near_the_ground_is_bounded_by_height_alone():
    flights = make(4, 2, noise_only)
    stated = [{"CZ": 0.1 * np.exp(-f["h_agl"] / 2.0)} for f in flights]
    found = bounds_of(flights, stated, {"CZ": 0.001})
    assert list(found) == ["h_agl"]
    # The maximum is at the 99.5 % quantile, just above the lowest height, 2 m.
    assert_allclose(found["h_agl"].high, 2.0 - 2.0 * np.log(0.21), atol=0.3)
    assert found["h_agl"].p <= 0.05
    assert found["h_agl"].separates > 0.9


def test_two_channels_bound_an_effect_that_needs_both():
    flights = make(5, 3, noise_only)
    stated = [{"CZ": ((f["alpha"] > 0.0) & (f["h_agl"] < 8.0)) * 0.1} for f in flights]
    found = find_region(flights, stated, {"CZ": 0.001})
    assert set(found) == {"alpha", "h_agl"}
    assert_allclose(found["h_agl"][1], 8.0, atol=0.3)
    assert_allclose(found["alpha"][0], 0.0, atol=0.005)


def test_segments_that_follow_no_channel_are_bounded_by_none():
    rng = np.random.default_rng(5)
    bounded = 0
    for seed in range(12):
        flights = make(4, 100 + seed, noise_only)
        at = rng.uniform(5.0, 20.0, 4)
        stated = [{"CZ": ((a < T) & (a + 5.0 > T)) * 0.1} for a in at]
        bounded += bool(find_region(flights, stated, {"CZ": 0.001}))
    assert bounded <= 2  # of 12, at a stated 5 %


def test_the_ceiling_is_the_fraction_that_a_function_of_the_state_has():
    def stated(ch, rng, k):
        law = 40.0 * ch["alpha"] ** 2 + ch["beta"] * (ch["de"] > 0)
        law = (law - law.mean()) / law.std()
        # White noise; the band holds 6 of its 12.5 Hz.
        return {"CZ": 0.05 * law + 0.04 * rng.standard_normal(len(T)), "Cm": 0.01 * rng.standard_normal(len(T))}

    flights = make(8, 4, stated)
    found = explainable(flights, [f.difference for f in flights])
    fraction = 0.05**2 / (0.05**2 + 0.04**2 * 6.0 / 12.5)
    assert 0.75 * fraction < found["CZ"] < fraction + 0.05
    assert found["Cm"] < 0.02


def test_the_ceiling_holds_the_recent_past_and_needs_a_second_manoeuvre():
    def stated(ch, rng, k):
        return {"CZ": np.roll(ch["de"], 10) + 0.02 * rng.standard_normal(len(T))}

    flights = make(6, 5, stated)
    differences = [f.difference for f in flights]
    assert explainable(flights, differences)["CZ"] > 0.6
    assert explainable(flights[:1], differences[:1]) == {}


def vanes(sigma, coloured=0.0, size=6):
    """Flights whose vanes and pitot read turbulence of a size [m/s], and noise; accelerometers and gyros do not."""

    def stated(ch, rng, k):
        gusts = dryden_gusts(T, 60.0, AIRCRAFT.b, np.full(3, 250.0), np.full(3, max(sigma, 1e-9)), rng)
        made = {}
        for name, gust, scale in zip(("k_V", "k_beta", "k_alpha"), gusts.T, (1.0, ch["V"], ch["V"])):
            own = 0.08 * rng.standard_normal(len(T)) + wander(rng, len(T), 0.25, coloured)
            made[name] = np.gradient(gust + own, DT) / scale + 0.02 * rng.standard_normal(len(T)) / scale
        return {"CZ": 0.01 * rng.standard_normal(len(T)), **made}

    return lambda seed: make(size, seed, stated)


@pytest.mark.parametrize("sigma", [0.4, 1.0])
def test_turbulence_is_found_with_its_size(sigma):
    flights = vanes(sigma)(7)
    found = find_turbulence(flights, [f.difference for f in flights])
    assert found is not None
    assert set(found.sigma) == {"u", "v", "w"}
    # Above V / 2 pi L, 0.04 Hz here, the spectrum is that of sigma^2 / L: that is what the band tells.
    assert_allclose(np.array(list(found.sigma.values())) / np.sqrt(found.length), sigma / np.sqrt(250.0), rtol=0.15)
    assert found.probability > 0.9
    assert "m/s up and down" in found.says


@pytest.mark.parametrize("coloured", [0.0, 0.1, 0.4])
def test_vane_noise_is_no_turbulence_whatever_its_spectrum(coloured):
    for seed in range(3):
        flights = vanes(0.0, coloured)(20 + seed)
        assert find_turbulence(flights, [f.difference for f in flights]) is None


@pytest.mark.parametrize("sigma", [0.0, 0.1])
def test_noise_of_a_vane_is_that_of_an_angle(sigma):
    """At 50 to 110 m/s the same vane has noise of 0.1 to 0.22 m/s, which says nothing about the air."""

    def stated(ch, rng, k):
        V = ch["V"]
        gusts = dryden_gusts(T, float(V.mean()), AIRCRAFT.b, np.full(3, 250.0), np.full(3, max(sigma, 1e-9)), rng)
        noise = 0.05, 0.002, 0.002  # m/s, rad, rad
        made = {
            name: np.gradient(gust / scale + size * rng.standard_normal(len(T)), DT)
            for name, gust, scale, size in zip(("k_V", "k_beta", "k_alpha"), gusts.T, (1.0, V, V), noise)
        }
        return {"CZ": 0.01 * rng.standard_normal(len(T)), **made}

    flights = [make(1, 30 + k, stated, V)[0] for k, V in enumerate((50.0, 70.0, 90.0, 110.0))]
    found = find_turbulence(flights, [f.difference for f in flights])
    assert (found is not None) == (sigma > 0.0)


def test_one_noisy_vane_is_no_turbulence():
    rough, calm = vanes(1.0)(9), vanes(0.0)(9)
    mixed = [{**c.difference, "k_alpha": r.difference["k_alpha"]} for r, c in zip(rough, calm)]
    assert find_turbulence(calm, mixed) is None


def test_a_step_is_found_at_its_time_with_its_size():
    def stated(ch, rng, k):
        made = noise_only(ch, rng, k)
        return {**made, "CZ": made["CZ"] + 0.02 * ((T > 12.0) & (k == 2))}

    flights = make(6, 8, stated)
    (found,) = find_changes(flights, spectra_of(flights), white(flights, {"CZ": 0.01, "Cm": 0.01}), ("CZ", "Cm"))
    assert (found.flight, found.response) == ("m3", "CZ")
    assert_allclose(found.time, 12.0, atol=0.2)
    assert abs(found.step - 0.02) < 4.0 * found.std


def test_windows_name_the_segment_that_is_worse_and_few_of_noise():
    def stated(ch, rng, k):
        made = noise_only(ch, rng, k)
        return {**made, "Cm": made["Cm"] * np.where((T > 10.0) & (T < 14.0) & (k == 1), 6.0, 1.0)}

    flights = make(6, 9, stated)
    found = find_windows(flights, spectra_of(flights), white(flights, {"CZ": 0.01, "Cm": 0.01}), ("CZ", "Cm"))
    hit = [w for w in found if w.flight == "m2" and w.response == "Cm" and w.end > 10.0 and w.start < 14.0]
    assert len(hit) >= 2
    assert len(found) - len(hit) <= 1


def test_what_stands_out_of_lognormal_powers_does_so_at_the_stated_rate():
    rng = np.random.default_rng(11)
    p = np.concatenate([standing_out(np.exp(0.4 * rng.standard_normal(100))) for _ in range(100)])
    # 10 000 values, scatter from 50 each: 1 % within a factor of two.
    assert 0.005 < np.mean(p < 0.01) < 0.02


def test_coherence_names_the_input_that_drives_and_by_how_much():
    def stated(ch, rng, k):
        response = np.roll(ch["de"], 5)
        noise = wander(rng, len(T), 0.7, 0.05)
        return {"Cm": response + noise, "CZ": wander(rng, len(T), 0.7, 0.05)}

    flights = make(8, 12, stated)
    found = coherences(flights, [f.difference for f in flights], ("Cm", "CZ"))
    assert (found[0].response, found[0].channel) == ("Cm", "de")
    # Two processes of one spectrum and one size: half of the power.
    assert_allclose(found[0].fraction, 0.5, atol=0.12)
    assert_allclose(found[0].delay, 5 * DT, atol=0.04)
    assert sum(x.significant for x in found if (x.response, x.channel) != ("Cm", "de")) <= 1


def test_character_tells_the_state_from_its_past_and_both_from_noise():
    def stated(ch, rng, k):
        n = 0.01 * rng.standard_normal(len(T))
        return {
            "CX": 4.0 * ch["alpha"] ** 2 + n,
            "CZ": 0.3 * np.roll(ch["alpha"], 10) + n,
            "Cm": wander(rng, len(T), 0.5, 0.01),
        }

    flights = make(8, 13, stated)
    found = characterise(flights, spectra_of(flights), white(flights, dict.fromkeys(("CX", "CZ", "Cm"), 0.01)))
    named = {(c.response, c.kind) for c in found if c.significant}
    assert ("CX", "static") in named
    assert ("CX", "memory") not in named
    assert ("CZ", "memory") in named
    assert not any(response == "Cm" for response, _ in named)
    assert (
        characterise(flights[:2], spectra_of(flights[:2]), white(flights, dict.fromkeys(("CX", "CZ", "Cm"), 0.01)))
        == []
    )
