"""An effect that is on in some flights, from a time or until one."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag, toeplitz
from scipy.stats import multivariate_normal

from structsel.comparison.tolerances import tolerances_of
from structsel.diagnosis.running_sums import RunningSums
from structsel.diagnosis.switch_search import ALWAYS, On, search
from structsel.diagnosis.switching import switched_form
from structsel.effects import EFFECTS
from tests.effect_fits import effect_named, fitted_effect
from tests.noisy_flights import T, flights_with
from tests.switched_forms import refined, sizes

SPEEDS, HEIGHTS = (42.0, 50.0, 46.0, 44.0), (1000.0,) * 4
GAIN = 0.1  # s


@pytest.fixture(scope="module")
def correct():
    return flights_with({}, speeds=SPEEDS, h=HEIGHTS)


def damped(flights, *when):
    """Flights with a pitch damper that is on in each as stated."""
    (form,) = (v for v in effect_named("augmentation").variants(flights) if v.about == "q to elevator")
    made = []
    for flight, on in zip(flights, when):
        columns = form.columns(flight)
        added = {c: GAIN * on(flight.t) * x[:, 0] for c, x in columns.items()}
        measured = {c: y + added.get(c, 0.0) for c, y in flight.measured.items()}
        made.append(replace(flight, measured=measured))
    return made


def always(t):
    return np.ones(len(t))


def never(t):
    return np.zeros(len(t))


def test_the_flights_and_times_at_which_a_damper_is_on_are_found_with_its_gain(correct):
    flights = damped(correct, lambda t: t >= 12.6, always, never, lambda t: t < 9.8)
    _, score = refined(flights, "augmentation")
    form = score.signature.variant
    assert form.only_in == ("m01", "m02", "m04")
    spread = np.array([form.spread[name] for name in ("time in m01", "time in m04, end")])
    assert np.all((spread > 0.02) & (spread < 0.3))
    times = np.array([form.shape[name] for name in ("time in m01", "time in m04, end")])
    assert np.all(np.abs(times - (12.6, 9.8)) < 0.05 + 3.0 * spread)
    assert form.about == f"q to elevator, in 'm01' from {times[0]:.1f} s, 'm02', 'm04' until {times[1]:.1f} s"
    assert_allclose(sizes(score)["gain of q"], GAIN, rtol=0.05)


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.switched], ids=lambda e: e.name)
def test_every_form_of_an_effect_that_is_switched_has_a_sentence(correct, effect):
    for form in effect.switched(correct):
        there = switched_form(form, {"m01": On(5.0), "m03": On(4.0, 9.0)})
        says = effect.says(fitted_effect(there, {p.name: p.sd for p in there.parameters}))
        assert "in 'm01' from 5.0 s, 'm03' from 4.0 s until 9.0 s" in says
        assert says.endswith(".")


def test_an_effect_that_is_always_on_or_not_there_is_not_switched(correct):
    (damper,) = (v for v in effect_named("augmentation").variants(correct) if v.about == "q to elevator")
    sums = RunningSums.of(correct, tolerances_of(correct))
    assert sums.find([damper], may_end=True)[2] <= 0.0
    flights = damped(correct, *[always] * 4)
    _, on, log_evidence = RunningSums.of(flights, tolerances_of(flights)).find([damper], may_end=True)
    assert set(on) == {ALWAYS}
    assert log_evidence > 30.0


@pytest.mark.parametrize("duration", [0.0, 2.0])
def test_running_sums_have_the_evidence_of_scipy(correct, duration):
    flights = damped(correct, lambda t: t >= 12.6, always, never, lambda t: t < 9.8)[:2]
    (damper,) = (v for v in effect_named("augmentation").variants(flights) if v.about == "q to elevator")
    sums = RunningSums.of(flights, tolerances_of(flights))
    on = (On(4.0, 12.6, duration), On(end=9.0, duration=duration))
    y, own, shared, column, noise = [], [], [], [], []
    for f, one in zip(sums.flights, on):
        y.append(f.rows[..., -1].ravel())
        shared.append(f.rows[..., :-1].reshape(len(y[-1]), -1))
        own.append(f.biases.reshape(len(y[-1]), -1))
        t, step = f.flight.t, round(0.2 / f.flight.dt)
        # A ramp is the mean of steps in each of its blocks.
        ramp = On(one.start - 0.2, one.end - 0.2, duration + 0.2)
        there = ramp.along(t[::step][: f.rows.shape[1]])
        x = {c: x[:, 0] * damper.parameters[0].sd for c, x in damper.columns(f.flight).items()}
        blocks = [x.get(c, np.zeros(len(t)))[: step * len(there)].reshape(-1, step).mean(axis=1) for c in f.scale]
        column.append(np.concatenate([b * there / s for b, s in zip(blocks, f.scale.values())]))
        noise += [toeplitz(m ** np.arange(len(there))) / (1.0 - m**2) for m in f.memory]
    rows, x = np.concatenate(y), np.concatenate(column)
    G = np.hstack([np.vstack(shared), block_diag(*own)])
    alone = block_diag(*noise) + G @ G.T
    with_it, without = (multivariate_normal(cov=C).logpdf(rows) for C in (alone + np.outer(x, x), alone))
    one, other = (
        f.running_sums(damper, x).within(duration).parts(f.options_of(w))
        for f, x, w in zip(sums.flights, sums.factored, on)
    )
    assert max(sums.flights[0].memory) > 0.5
    assert_allclose(search(sums.y, [one, other], [0, 0]).log_evidence, with_it - without - 3 * 4.0, rtol=1e-6)


def test_what_begins_and_ends_in_one_flight_is_found(correct):
    off = (correct[0].t >= 6.0) & (correct[0].t < 14.0)
    pitched = {**correct[0].measured, "Cm": correct[0].measured["Cm"] + 0.004 * off}
    flights = [replace(correct[0], measured=pitched), *correct[1:]]
    _, score = refined(flights, "configuration-change")
    form = score.signature.variant
    assert form.about == "in 'm01' from 6.0 s until 14.0 s"
    assert_allclose(sizes(score)["pitching moment"], 0.004, rtol=0.05)


def test_an_engine_that_fails_in_two_flights_is_found_at_its_times():
    # The throttle is closed afterwards: what is seen is a pulse.
    flights = flights_with({}, speeds=SPEEDS[:3], h=HEIGHTS[:3], thrust=np.where(T < 15.0, 400.0, 100.0))
    failed = []
    for f, time in zip(flights, (8.0, 12.0, np.inf)):
        yaw = -0.5 * np.where(f.t >= time, f["CT"], 0.0) / f.aircraft.b
        failed.append(replace(f, measured={**f.measured, "Cn": f.measured["Cn"] + yaw}))
    _, score = refined(failed, "asymmetric-thrust")
    form = score.signature.variant
    assert form.only_in == ("m01", "m02")
    assert_allclose([form.shape[f"time in {name}"] for name in form.only_in], (8.0, 12.0), atol=0.05)
    assert_allclose(sizes(score)["offset"], 0.5, rtol=0.1)
