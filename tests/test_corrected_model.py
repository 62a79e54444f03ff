"""The simulation with the effects it lacked: as terms, as states, as a patched aircraft of JSBSim."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from threadpoolctl import threadpool_limits

import structsel as ss
from structsel.candidates import Term
from structsel.comparison.flight import prepare_flight
from structsel.comparison.preparing import prepare as prepare_both
from structsel.comparison.surrogate import Surrogate, identify
from structsel.diagnosis.adding import Addition, addition_of
from structsel.diagnosis.extending import Extended, as_models
from structsel.diagnosis.modelling import corrected_model
from structsel.diagnosis.patching import patched_aircraft
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import rank
from structsel.diagnosis.signatures import work_out
from structsel.effects.base import ModelCase, ParameterEstimate
from structsel.effects.latched_stall import LATCH
from structsel.model import AeroModel
from structsel.simulation import Instruments
from tests.citation_states import AIRCRAFT, LAGGED, OWN, SEPARATED, T, fly, following, inputs, state, with_term
from tests.effect_fits import effect_named

# --- added to a model ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flights():
    """Flights of the Citation at moderate and high angle of attack, the simulation the Citation itself."""
    t = np.arange(0.0, 15.0, 0.04)
    made = []
    for k in range(2):
        w = {c: np.sin(f * t + k) for c, f in (("V", 0.3), ("alpha", 1.1), ("beta", 0.9), ("de", 1.7), ("da", 1.9))}
        channels = {
            "V": 120.0 + 30.0 * w["V"], "alpha": 0.14 + 0.1 * w["alpha"], "beta": 0.05 * w["beta"],
            "p": 0.1 * np.cos(t), "q": 0.1 * np.cos(1.1 * t), "r": 0.05 * np.sin(0.8 * t), "phi": 0.1 * np.sin(0.7 * t),
            "theta": 0.1 * w["V"], "psi": 0.0 * t, "h": 5000.0 + 100.0 * w["V"], "ax": 1.0 + 0.0 * t, "ay": 0.0 * t,
            "az": -9.8 + w["alpha"], "de": 0.05 * w["de"], "da": 0.05 * w["da"], "dr": 0.05 * np.sin(1.5 * t),
            "thrust": 5000.0 + 900.0 * np.sin(0.6 * t), "h_agl": 8.0 + 5.0 * w["V"],
        }  # fmt: skip
        made.append(ss.Recording(f"m{k}", t, channels))
    complete = ss.compute_all(made, AIRCRAFT)
    stated = [OWN.evaluate(r, outside="ignore") for r in complete]
    prepared = [prepare_flight(r, AIRCRAFT, s) for r, s in zip(made, stated)]
    smooth = [{c: OWN[c].evaluate(f) for c in OWN} for f in prepared]
    prepared = [replace(f, simulated=s) for f, s in zip(prepared, smooth)]
    stand_in = identify(prepared, smooth, list(OWN))
    return [replace(f, surrogate=stand_in) for f in prepared]


def as_added(effect, variant, flights):
    """An effect at its usual size, as an addition."""
    # How a recording begins is no part of a model.
    theta = np.array([0.0 if p.of_beginning else np.clip(p.sd, p.low, p.high) for p in variant.parameters])
    stated = {p.name: ParameterEstimate(x, 0.1 * abs(x), p.unit) for p, x in zip(variant.parameters, theta)}
    stated |= {n: ParameterEstimate(x, 0.1 * abs(x), variant.units.get(n, "-")) for n, x in variant.shape.items()}
    case = ModelCase(variant, stated, AIRCRAFT, dict(OWN.responses), flights)
    return addition_of(effect, case, theta, np.diag((0.1 * theta) ** 2)), theta


_TERMS = ("missing-term", "static-stall", "control-nonlinearity", "flexibility", "slipstream", "thrust-line")
_OF_LIFT = ("drag-polar", "ground-effect")
_STATES = (
    *("stall-hysteresis", "unsteady-lift", "downwash-lag", "thrust-lag", "actuator-lag", "actuator-rate-limit"),
    *("actuator-saturation", "backlash", "augmentation"),
)

_WITHOUT_STATE = {LATCH}  # forms for which a model has no kind of state
_BY_FORM = ("stall-hysteresis", "actuator-lag")


@pytest.mark.parametrize(
    ("effect", "within"),
    [*((e, 1e-10) for e in _TERMS), *((e, 1e-3) for e in _OF_LIFT), *((e, 0.03) for e in _STATES)],
)
def test_the_effect_in_the_model_is_the_effect_that_was_found(effect, within, flights):
    # Terms are the found signature to the last digits, except the lift, which the signature has from a surrogate of
    # the simulation; states are the physics that a signature is the slope of.
    variants = [v for v in effect_named(effect).variants(flights) if v.about not in _WITHOUT_STATE]
    stated = (
        {(v.about, *(p.name for p in v.parameters)): v for v in variants}.values()
        if effect in _BY_FORM
        else variants[:2]
    )
    for variant in stated:
        one, theta = as_added(effect_named(effect), variant, flights)
        assert one.is_known
        made = Extended(OWN.responses, flights)
        assert made.take(one)
        after, off, size = made.responses(), 0.0, 0.0
        for f in flights:
            for c, columns in variant.columns(f).items():
                off += np.sum((after[c].evaluate(f) - OWN[c].evaluate(f) - columns @ theta) ** 2)
                size += np.sum((columns @ theta) ** 2)
        assert size > 0.0
        assert np.sqrt(off) < within * np.sqrt(size)


def test_a_surrogate_can_be_simulated_with_the_rate_of_angle_of_attack_and_gives_the_same_values(flights):
    scale, centre = {"alpha": 0.1, "alpha_dot_hat": 0.002}, {"alpha": 0.14, "alpha_dot_hat": 1e-4}
    terms, values = {"Cm": (("alpha",), ("alpha_dot_hat",))}, {"Cm": np.array([-0.1, -0.02])}
    stand_in = Surrogate(centre, scale, terms, values, {"Cm": 0.01}, {"Cm": 1.0})
    made = as_models(stand_in, flights)
    for f in flights:
        assert_allclose(made["Cm"].evaluate(f), stand_in.evaluate(f, "Cm"), rtol=1e-9, atol=1e-12)
    assert len(fly(AeroModel({**OWN.responses, "Cm": made["Cm"]}), inputs(t=T[:20]))) == 20


def test_an_instrument_fault_is_not_put_into_the_model(flights):
    one, _ = as_added(effect_named("sensor-scale"), effect_named("sensor-scale").variants(flights)[0], flights)
    assert not one.is_known
    assert "an error of an instrument" in one.remark


def recorded(model, count=3):
    noise = {
        "alpha": 3e-4,
        "beta": 3e-4,
        "p": 2e-4,
        "q": 2e-4,
        "r": 2e-4,
        "ax": 5e-3,
        "ay": 5e-3,
        "az": 1e-2,
        "V": 0.05,
    }
    t = np.arange(0.0, 12.0, 0.04)
    made = []
    for seed in range(count):
        simulated = fly(model, inputs(seed, t=t), instruments=Instruments(noise=noise, seed=seed))
        made.append(ss.Recording(f"m{seed}", simulated.t, dict(simulated.channels)))
    return made


@threadpool_limits.wrap(limits=1)
def corrected(truth, effect):
    """What model.json holds of the Citation, compared with a truth, if one effect may be found."""
    prepared = prepare_both(OWN, recorded(truth), AIRCRAFT)
    library = work_out([effect_named(effect)], prepared.flights, prepared.flights[0].responses, None)
    ranking = rank(DiagnosisProblem.set_up(prepared.flights, library.signatures), library)
    assert [step.score.effect for step in ranking.steps] == [effect]
    return corrected_model(prepared, ranking)


def test_own_terms_stay_bit_for_bit_and_the_missing_term_comes_with_value_and_error():
    found = corrected(with_term("alpha^2", -3.0), "missing-term")
    assert found["Cm"].terms[:-1] == OWN["Cm"].terms
    assert (found["Cm"].values[:-1] == OWN["Cm"].values).all()
    assert all(found[c] == OWN[c] for c in OWN if c != "Cm")
    assert str(found["Cm"].terms[-1]) == "alpha^2"
    assert abs(found["Cm"]["alpha^2"] + 3.0) < 0.05
    assert 0.0 < found["Cm"].standard_errors[-1] < 0.05
    assert found.remarks == ()


def test_a_model_with_the_lag_found_is_nearer_to_the_truth_than_the_simulation():
    truth = following(OWN, "de", "de_late", LAGGED)
    found = corrected(truth, "actuator-lag")
    tau = found.states["de_late"].parameters["tau"]
    assert tau.unit == "s"
    assert abs(tau.value - 0.15) < 0.02
    assert (found["Cm"].values == OWN["Cm"].values).all()
    assert found["Cl"] == OWN["Cl"]
    stated, before, after = (fly(m, inputs(9))["q"] for m in (truth, OWN, found))
    assert np.std(after - stated) < 0.15 * np.std(before - stated)


# --- a patched aircraft of JSBSim ----------------------------------------------------------------


def effect(name, terms=None, **parts):
    made = {c: {Term(t): np.array([v]) for t, v in mine.items()} for c, mine in (terms or {}).items()}
    return Addition(effect=name, theta=np.ones(1), covariance=np.eye(1) * 0.01, terms=made, **parts)


def test_a_patched_aircraft_differs_from_the_original_by_the_term(tmp_path):
    pytest.importorskip("jsbsim")
    from structsel.simulation.jsbsim import open_jsbsim

    aircraft = open_jsbsim(
        "f16"
    )  # its aerodynamics do not ask for the rate of angle of attack, which any force changes
    terms = {"Cm": {"alpha^2": -2.0, "alpha*q_hat": -3.0}, "CD": {"alpha^2": 0.3}, "CY": {"beta^3": 2.0},
             "Cn": {"beta*dr": -0.3}}  # fmt: skip
    patched = patched_aircraft("f16", [effect("missing-term", terms)], aircraft.aircraft, [])
    assert patched.remarks == ()
    t = np.linspace(0.0, 1.0, 5)
    at = ss.Recording("x", t, {"V": 200.0 + t, "h": 1000.0 + 0.0 * t, "alpha": 0.05 + 0.1 * t, "beta": 0.08 * t,
                               "q": 0.1 - 0.2 * t, "dr": 0.05 * t})  # fmt: skip
    before = aircraft.coefficients(at)
    after = open_jsbsim(patched.write(tmp_path)).coefficients(at)
    alpha, beta, q_hat = at["alpha"], at["beta"], at["q"] * aircraft.aircraft.cbar / (2.0 * at["V"])
    expected = {
        "CX": -0.3 * alpha**2 * np.cos(alpha), "CY": 2.0 * beta**3, "CZ": -0.3 * alpha**2 * np.sin(alpha),
        "Cl": 0.0 * t, "Cm": -2.0 * alpha**2 - 3.0 * alpha * q_hat, "Cn": -0.3 * beta * at["dr"],
    }  # fmt: skip
    for c, x in expected.items():
        assert_allclose(after[c] - before[c], x, atol=1e-12)


def test_a_patched_actuator_flies_as_the_delayed_input_does(tmp_path):
    pytest.importorskip("jsbsim")
    from structsel.simulation.jsbsim import open_jsbsim

    aircraft = open_jsbsim("c172p")
    start = aircraft.trim(55.0, 1000.0)
    t = np.arange(0.0, 2.0, 0.02)
    actuator_lag = state("lag", "de", tau=0.2)
    asked = start.controls["de"] + 0.05 * np.interp(t, [0.0, 0.3, 0.4, 1.0, 1.1, 2.0], [0, 0, 1, 1, -1, -1])
    given = {"t": t, **{c: np.full(len(t), v) for c, v in start.controls.items()}}
    one = effect("actuator-lag", states={"de_late": actuator_lag}, replaced={"Cm": {"de": "de_late"}})
    patched = patched_aircraft("c172p", [one], aircraft.aircraft, [])
    simulated = open_jsbsim(patched.write(tmp_path)).fly({**given, "de": asked}, start=start)
    lagged = aircraft.fly({**given, "de": actuator_lag.along(t, {"de": asked})}, start=start)
    plain = aircraft.fly({**given, "de": asked}, start=start)
    # JSBSim's control system is a step of 2 ms ahead of its aerodynamics.
    assert np.abs(simulated["q"] - lagged["q"]).max() < 0.02 * np.abs(plain["q"] - lagged["q"]).max()


def test_an_effect_that_jsbsim_can_hold_only_in_part_is_not_written():
    pytest.importorskip("jsbsim")
    states = {"de_late": state("lag", "de", tau=0.2), "da_late": state("delay", "da", tau=0.2)}
    both = effect("actuator-lag", states=states, replaced={"Cm": {"de": "de_late", "da": "da_late"}})
    patched = patched_aircraft("c172p", [both, effect("missing-term", {"Cm": {"beta^2": 0.1}})], AIRCRAFT, [])
    assert "With missing-term, as estimated by structsel." in patched.text
    assert "lag of" not in patched.text
    assert any("counts a delay" in remark for remark in patched.remarks)


def test_an_effect_that_jsbsim_cannot_hold_is_reported_and_nothing_is_written():
    pytest.importorskip("jsbsim")
    one = effect("stall-hysteresis", {"CD": {"(1 - x_sep)": 0.1}}, states={"x_sep": SEPARATED})
    patched = patched_aircraft("c172p", [one], AIRCRAFT, [])
    assert patched.name == patched.text == ""
    assert "separation of alpha) cannot be written" in patched.remarks[0]
