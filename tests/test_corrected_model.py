"""The simulation with the physics it left out: as terms, as states, as a patched aircraft of JSBSim."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lsim
from threadpoolctl import threadpool_limits

import structsel as ss
from structsel.candidates import Term
from structsel.comparison.flight import prepare_flight
from structsel.comparison.preparing import prepare as prepare_both
from structsel.comparison.surrogate import Surrogate, identify
from structsel.diagnosis.adding import Addition, addition_of
from structsel.diagnosis.bench import Bench
from structsel.diagnosis.extending import Extended, as_models
from structsel.diagnosis.modelling import corrected_model
from structsel.diagnosis.patching import patched_aircraft
from structsel.diagnosis.ranking import rank
from structsel.diagnosis.signatures import work_out
from structsel.effects.base import ModelCase, ParameterEstimate
from structsel.errors import ChannelError, ModelError, StructselWarning
from structsel.model import AeroModel, Quantity, ResponseModel, State
from structsel.numerics.flight_model import outputs_index
from structsel.numerics.flight_simulation import state_derivatives
from structsel.simulation import Actuator, Instruments, linearise, prepare, published_aircraft, simulate, trim
from tests.effect_fits import effect_named

CITATION = published_aircraft("citation")
OWN, AIRCRAFT = CITATION.model, CITATION.aircraft
TRIM = CITATION.trim()
T = np.arange(0.0, 6.0, 0.02)


def state(kind, of, **values):
    return State(kind, of, {name: Quantity(value) for name, value in values.items()})


LAGGED = state("lag", "de", tau=0.15)
SEPARATED = state("separation", "alpha", tau1=0.3, tau2=0.15, a1=20.0, alpha_star=0.08)


def with_term(term, value, **states):
    """The Citation with one more term in Cm."""
    held = OWN["Cm"]
    made = ResponseModel((*held.terms, Term(term)), np.append(held.values, value), states=states)
    return AeroModel({**OWN.responses, "Cm": made})


def following(model, channel, name, one):
    """The model with a state in a channel's place."""
    made = {}
    for response, held in model.responses.items():
        terms = tuple(Term(str(t).replace(channel, name)) for t in held.terms)
        made[response] = ResponseModel(terms, held.values, states={name: one})
    return AeroModel(made)


def inputs(seed=0, size=0.02, t=T):
    rng = np.random.default_rng(seed)
    made = {"t": t}
    for c, value in TRIM.controls.items():
        steps = np.repeat(rng.choice([-1.0, 0.0, 1.0], size=len(t) // 40 + 1), 40)[: len(t)]
        made[c] = value + (size * gaussian_filter1d(steps, 4) if c in ("de", "da", "dr") else 0.0 * t)
    return made


def fly(model, given=None, start=TRIM, **options):
    return simulate(model, AIRCRAFT, given or inputs(), start=start, air=CITATION.air, outside="ignore", **options)


# --- states --------------------------------------------------------------------------------------


def test_a_lag_is_what_a_linear_system_makes_of_its_input():
    x = 0.1 + np.sin(3.0 * T)
    expected = x[0] + lsim(([1.0], [0.15, 1.0]), x - x[0], T)[1]
    assert_allclose(LAGGED.along(T, {"de": x}), expected, atol=5e-5)


def test_a_distance_travelled_is_a_time_at_constant_speed():
    x, V = np.sin(2.0 * T), np.full(len(T), 40.0)
    for kind in ("lag", "delay"):
        by_distance = state(kind, "alpha", distance=8.0).along(T, {"alpha": x, "V": V})
        assert_allclose(by_distance, state(kind, "alpha", tau=0.2).along(T, {"alpha": x}), atol=1e-12)


def test_a_fraction_of_a_state_acts():
    x = np.sin(2.0 * T)
    complete = state("backlash", "de", width=0.1).along(T, {"de": x})
    part = state("backlash", "de", width=0.1, fraction=0.4).along(T, {"de": x})
    assert_allclose(part, 0.6 * x + 0.4 * complete, atol=1e-15)


@pytest.mark.parametrize(
    ("kind", "values", "says"),
    [
        ("spring", {"tau": 1.0}, "no state of kind 'spring'"),
        ("lag", {"rate": 1.0}, "tau or distance"),
        ("lag", {"tau": 0.0}, "must be above zero"),
        ("stops", {"low": 0.2, "high": 0.1}, "nothing between"),
    ],
)
def test_an_impossible_state_is_refused_with_what_it_needs(kind, values, says):
    with pytest.raises(ModelError, match=says):
        state(kind, "de", **values)


def test_a_model_with_states_is_evaluated_along_a_recording_and_reads_back(tmp_path):
    model = following(OWN, "de", "de_late", State("lag", "de", {"tau": Quantity(0.15, 0.02, "s")}))
    simulated = fly(OWN)
    simulated = ss.compute_all([simulated], AIRCRAFT)[0]
    lagged = simulated.with_channels(de=LAGGED.along(simulated.t, {"de": simulated["de"]}), note="lagged")
    assert_allclose(model.evaluate(simulated)["Cm"], OWN.evaluate(lagged)["Cm"], atol=1e-14)
    model.to_json(tmp_path / "model.json")
    held = json.loads((tmp_path / "model.json").read_text())["states"]["de_late"]
    assert held == {"kind": "lag", "input": "de", "parameters": {"tau": {"value": 0.15, "std": 0.02, "unit": "s"}}}
    again = AeroModel.from_json(tmp_path / "model.json")
    assert again == model
    assert "de_late" not in again.channels
    assert "de" in again.channels
    assert "states" not in OWN.to_dict()
    with pytest.raises(ChannelError, match="needs the clock 't'"):
        model.evaluate({c: simulated[c] for c in model.channels})


def test_a_file_with_an_impossible_state_is_refused_with_file_and_state(tmp_path):
    model = following(OWN, "de", "de_late", LAGGED)
    stated = model.to_dict()
    stated["states"]["de_late"]["kind"] = "spring"
    (tmp_path / "model.json").write_text(json.dumps(stated))
    with pytest.raises(ModelError, match=r"model\.json', state 'de_late': There is no state of kind 'spring'"):
        AeroModel.from_json(tmp_path / "model.json")


# --- simulated ---------------------------------------------------------------------------------------


def test_a_delayed_input_flies_as_one_behind_an_actuator():
    simulated = fly(following(OWN, "de", "de_late", LAGGED))
    behind = fly(OWN, actuators={"de": Actuator(lag=0.15)})
    assert_allclose(simulated["alpha"], behind["alpha"], atol=1e-14)
    assert np.abs(simulated["alpha"] - fly(OWN)["alpha"]).max() > 1e-3


@pytest.mark.parametrize(
    ("term", "value", "one"),
    [("alpha_late", -0.15, state("lag", "alpha", tau=0.3)), ("x_sep", -0.03, SEPARATED)],
)
def test_a_state_of_the_flight_itself_is_integrated_with_the_rigid_body(term, value, one):
    model = with_term(term, value, **{term: one})
    start = trim(model, AIRCRAFT, TRIM["V"], TRIM["h"], air=CITATION.air)
    given = inputs() | {c: np.full(len(T), v) for c, v in start.controls.items() if c != "de"}
    given["de"] = inputs()["de"] - TRIM.controls["de"] + start.controls["de"]
    simulated = fly(model, given, start)
    made = prepare(model, AIRCRAFT, given, start=start, air=CITATION.air)
    place, seen = made.compiled.controls.index(term), outputs_index(("alpha", "alpha_dot"))

    def rates(t, y):
        controls = np.array([np.interp(t, T, column) for column in made.manoeuvre.controls.T])
        controls[place] = y[12]
        slope, out = state_derivatives(made.compiled, made.manoeuvre, y[None, :12], controls[None])
        alpha, alpha_dot = out[0, seen]
        steady = alpha if term == "alpha_late" else 0.5 * (1.0 - np.tanh(20.0 * (alpha - 0.15 * alpha_dot - 0.08)))
        return np.append(slope[0], (steady - y[12]) / 0.3)

    found = solve_ivp(
        rates, (0.0, T[-1]), np.append(start.state, simulated[term][0]), t_eval=T, rtol=1e-8, max_step=0.02
    )
    assert np.ptp(simulated[term]) > 0.005
    assert_allclose(np.arctan2(found.y[2], found.y[0]), simulated["alpha"], atol=5e-7)
    assert_allclose(found.y[12], simulated[term], atol=2e-6)


@pytest.mark.parametrize("values", [{"tau": 0.11}, {"distance": 15.0}, {"tau": 0.11, "fraction": 0.5}])
def test_a_delayed_angle_of_attack_is_the_one_simulated_before(values):
    one = state("delay", "alpha", **values)
    simulated = fly(with_term("alpha_late", -0.15, alpha_late=one), inputs(size=0.005), substeps=4)
    # Between samples the recorded angle of attack is linear, the simulated one is not.
    expected = one.along(simulated.t, {"alpha": simulated["alpha"], "V": simulated["V"]})
    assert np.abs(simulated["alpha_late"] - simulated["alpha"]).max() > 1e-3
    assert_allclose(simulated["alpha_late"], expected, atol=2e-5)


def test_delayed_controls_and_a_state_of_the_motion_are_simulated_together():
    model, given = with_term("alpha_late", -0.15, alpha_late=state("lag", "alpha", tau=0.3)), inputs(size=0.005)
    made = prepare(model, AIRCRAFT, given, start=TRIM, air=CITATION.air)
    names = ("alpha", "q", "az")
    delayed = made.simulate(names, ["delay"], np.array([[5 * 0.02]])).outputs
    moved = given | {c: np.append(np.full(5, given[c][0]), given[c][:-5]) for c in ("de", "da", "dr")}
    expected = prepare(model, AIRCRAFT, moved, start=TRIM, air=CITATION.air).simulate(names).outputs
    assert_allclose(delayed, expected, atol=1e-11)


def test_a_state_without_effect_changes_nothing_of_the_flight():
    plain = fly(OWN)
    with_state = fly(with_term("alpha_late", 0.0, alpha_late=state("delay", "alpha", distance=20.0)))
    for c in ("V", "alpha", "q", "h", "x", "Cm"):
        assert_allclose(with_state[c], plain[c], rtol=1e-9, atol=1e-9)


def test_play_of_a_simulated_channel_is_refused():
    with pytest.raises(ModelError, match="backlash of 'alpha', which is simulated"):
        fly(with_term("alpha_play", -0.1, alpha_play=state("backlash", "alpha", width=0.01)))


def test_a_trim_and_a_linear_model_have_states_where_nothing_changes():
    model = following(OWN, "de", "de_late", LAGGED)
    found = trim(model, AIRCRAFT, TRIM["V"], TRIM["h"], air=CITATION.air)
    assert_allclose(found.controls["de"], TRIM.controls["de"], atol=1e-9)
    with pytest.warns(StructselWarning, match="de_late follow at once"):
        linearise(model, AIRCRAFT, found, air=CITATION.air)
    with pytest.raises(ModelError, match=r"de_late.*no export holds"):
        ss.export_model(model, "model.py", to="python")


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
    theta = np.array([np.clip(p.sd, p.low, p.high) for p in variant.parameters])
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

_BY_FORM = ("stall-hysteresis", "actuator-lag")


@pytest.mark.parametrize(
    ("effect", "within"),
    [*((e, 1e-10) for e in _TERMS), *((e, 1e-3) for e in _OF_LIFT), *((e, 0.03) for e in _STATES)],
)
def test_the_effect_in_the_model_is_the_effect_that_was_found(effect, within, flights):
    # Terms are the found signature to the last digits, except the lift, which the signature has from a surrogate of
    # the simulation; states are the physics that a signature is the slope of.
    variants = effect_named(effect).variants(flights)
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
    assert "in what an instrument reads" in one.remark


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
    ranking = rank(Bench.set_up(prepared.flights, library.signatures), library)
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
    assert "With missing-term, as structsel found it missing." in patched.text
    assert "lag of" not in patched.text
    assert any("counts a delay" in remark for remark in patched.remarks)


def test_an_effect_that_jsbsim_cannot_hold_is_reported_and_nothing_is_written():
    pytest.importorskip("jsbsim")
    one = effect("stall-hysteresis", {"CD": {"(1 - x_sep)": 0.1}}, states={"x_sep": SEPARATED})
    patched = patched_aircraft("c172p", [one], AIRCRAFT, [])
    assert patched.name == patched.text == ""
    assert "separation of alpha) cannot be written" in patched.remarks[0]


def test_old_names_of_the_parameters_of_a_state_still_work():
    with pytest.warns(DeprecationWarning, match="alpha_star"):
        old = state("separation", "alpha", tau1=0.3, tau2=0.15, sharpness=20.0, onset=0.08)
    assert old == SEPARATED
