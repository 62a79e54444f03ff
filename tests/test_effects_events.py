"""Changes in flight: simulated at a known time, found in the difference."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.diagnosis.assembling import found_by
from structsel.diagnosis.scoring import judged_by, score_all
from structsel.recording import Recording
from tests.effect_fits import best, check_all, effect_named
from tests.noisy_flights import AIRCRAFT, T, flights_with, fly, ready, tried
from tests.switched_forms import refined, sizes

CONFIGURATION, ICE, RELEASE = (effect_named(e) for e in ("configuration-change", "icing", "store-release"))


def lift_and_drag(lift, drag, term):
    """Terms of an increment of lift and drag by one channel."""
    return {
        "CZ": {f"{term}*cos(alpha)": -lift, f"{term}*sin(alpha)": -drag},
        "CX": {f"{term}*sin(alpha)": lift, f"{term}*cos(alpha)": -drag},
    }


def without(recordings, *names):
    """The recordings as if those channels had not been recorded."""
    return [Recording(r.name, r.t, {n: r[n] for n in r.names if n not in ("t", *names)}) for r in recordings]


def test_a_flap_without_a_channel_is_found_with_its_times():
    starts = (9.0, 11.0)
    extra = {**lift_and_drag(0.10, 0.02, "cfg"), "Cm": {"cfg": -0.03}}
    recordings, stated = fly(extra, cfg=lambda k: np.clip((T - starts[k]) / 2.5, 0.0, 1.0))
    flights = ready(without(recordings, "cfg"), stated)
    assert CONFIGURATION.needs(flights) == ""
    assert CONFIGURATION.event
    _, score = refined(flights, "configuration-change")
    shape, theta = score.signature.variant.shape, sizes(score)
    assert_allclose([shape["time in m01"], shape["time in m02"]], starts, atol=0.1)
    assert shape["duration"] == 2.5
    assert_allclose([theta["lift"], theta["drag"], theta["pitching moment"]], [0.10, 0.02, -0.03], rtol=0.12)


def test_a_change_of_the_same_proportions_is_found_beside_a_larger_one():
    flights = flights_with({}, speeds=(42.0, 46.0, 50.0), h=(1000.0,) * 3)
    times, added = (9.0, 7.0, 11.0), {"CX": 0.003, "CZ": -0.02, "Cm": 0.004}
    changed = []
    for f, at in zip(flights, times):
        measured = {c: f.measured[c] + size * (at <= T) for c, size in added.items()}
        changed.append(replace(f, measured={**f.measured, **measured}))
    larger = {c: changed[-1].measured[c] + 2.0 * x * (T >= 16.0) for c, x in {"Cl": 0.004, "Cn": 0.002}.items()}
    changed[-1] = replace(changed[-1], measured={**changed[-1].measured, **larger})
    _, score = refined(changed, "configuration-change")
    assert [score.signature.variant.shape[f"time in {f.name}"] for f in flights] == pytest.approx(times, abs=0.1)


def test_a_flap_that_is_recorded_is_found_as_its_channel():
    extra = {**lift_and_drag(0.5, 0.1, "df"), "Cm": {"df": -0.1}}
    flights = flights_with(extra, df=lambda k: 0.3 * np.clip((T - 9.0 - 2.0 * k) / 3.0, 0.0, 1.0))
    assert CONFIGURATION.needs(flights) == ""
    variant, theta, fraction = best(flights, CONFIGURATION, ["CZ", "CX", "Cm"])
    assert fraction > 0.95
    assert variant.terms[0] == "df"
    assert_allclose([theta["lift"], theta["drag"], theta["pitching moment"]], [0.5, 0.1, -0.1], rtol=0.1)
    check_all(flights, CONFIGURATION)


def test_a_change_is_an_event_only_at_times_that_were_searched():
    moved = {"df": lambda k: 0.3 * np.clip((T - 9.0 - 2.0 * k) / 3.0, 0.0, 1.0)}
    recordings, stated = fly({**lift_and_drag(0.5, 0.1, "df"), "Cm": {"df": -0.1}}, **moved)
    for seen, is_event in ((recordings, False), (without(recordings, "df"), True)):
        _, score = refined(ready(seen, stated), "configuration-change")
        assert score.event is is_event
    flights = ready(recordings, stated)
    (ice,) = score_all(*tried(flights, "icing"))
    is_event = {s.variant.about: judged_by(ice, k).event for k, s in enumerate(ice.signatures)}
    assert is_event["in m01"]
    assert is_event["in m02"]
    assert not is_event["over each manoeuvre"]
    assert not is_event["from 25 to 75 % of all manoeuvres one after the other"]


def test_ice_that_grows_is_found_with_what_it_costs():
    extra = {"CZ": {"ice*alpha*cos(alpha)": 0.6, "ice*sin(alpha)": -0.03}}
    extra["CX"] = {"ice*alpha*sin(alpha)": -0.6, "ice*cos(alpha)": -0.03}
    recordings, stated = fly(extra, ice=lambda k: np.clip((T - 0.2 * T[-1]) / T[-1], 0.0, 1.0))
    flights = ready(without(recordings, "ice"), stated)
    assert ICE.needs(flights) == ""
    variant, theta, fraction = best(flights, ICE, ["CZ", "CX"])
    assert fraction > 0.95
    assert variant.about == "over each manoeuvre"
    assert_allclose(variant.shape["onset"], 0.2 * T[-1], rtol=0.01)
    # Of the stand-in's slope, 5.58 at the middle of the flights.
    assert_allclose(theta["lift slope loss"], 0.6 / 5.5, rtol=0.1)
    assert_allclose(theta["drag"], 0.03, rtol=0.25)
    check_all(flights, ICE)


def test_ice_from_manoeuvre_to_manoeuvre_uses_the_clock_of_all():
    flights = flights_with({})
    variant = next(v for v in ICE.variants(flights) if v.about.startswith("from 25 to 75 %"))
    ends = [variant.columns(f)["CX"][[0, -1], 0] / -np.cos(f["alpha"][[0, -1]]) for f in flights]
    # A quarter of both is the middle of the first.
    assert_allclose(ends, [[0.0, 0.5], [0.5, 1.0]], atol=1e-12)


def test_a_load_let_go_is_found_with_its_mass_and_time():
    starts = (10.0, 12.0)
    recordings, stated = fly(
        {**lift_and_drag(0.0, -0.006, "gone"), "Cm": {"gone": -0.02}},
        mass=lambda k: np.where(starts[k] > T, AIRCRAFT.mass, 0.92 * AIRCRAFT.mass),
        gone=lambda k: (starts[k] <= T).astype(float),
    )
    flights = ready(without(recordings, "mass", "gone"), stated)
    assert RELEASE.needs(flights) == ""
    assert RELEASE.event
    _, score = refined(flights, "store-release")
    shape, theta = score.signature.variant.shape, sizes(score)
    assert_allclose([shape["time in m01"], shape["time in m02"]], starts, atol=0.1)
    assert_allclose(theta["mass"], 1.0 / 0.92 - 1.0, rtol=0.05)
    assert_allclose(theta["drag"], 0.006, rtol=0.2)


def test_sentences_name_time_and_size():
    starts = (9.0, 11.0)
    recordings, stated = fly(lift_and_drag(0.05, 0.01, "cfg"), cfg=lambda k: (starts[k] <= T).astype(float))
    flights = ready(without(recordings, "cfg"), stated)
    _, score = refined(flights, "configuration-change")
    found = found_by(score)
    assert CONFIGURATION.says(found).startswith(
        "The configuration changed, unrecorded, in 'm01' from 9.0 s, 'm02' from 11.0 s: lift coefficient by 0.0499 "
    )
