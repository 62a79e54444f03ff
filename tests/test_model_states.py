"""States with their own dynamics in a model: along a recording, in a file, and simulated."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.signal import lsim

import structsel as ss
from structsel.errors import ChannelError, ModelError, StructselWarning
from structsel.model import AeroModel, Quantity, State
from structsel.numerics.flight_model import outputs_index
from structsel.numerics.flight_simulation import state_derivatives
from structsel.simulation import Actuator, linearise, prepare, trim
from tests.citation_states import (
    AIRCRAFT,
    CITATION,
    LAGGED,
    OWN,
    SEPARATED,
    TRIM,
    T,
    fly,
    following,
    inputs,
    state,
    with_term,
)

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


def test_old_names_of_the_parameters_of_a_state_still_work():
    with pytest.warns(DeprecationWarning, match="alpha_star"):
        old = state("separation", "alpha", tau1=0.3, tau2=0.15, sharpness=20.0, onset=0.08)
    assert old == SEPARATED
