"""Compiled programs: what they compute is what the terms say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from structsel.aircraft import Aircraft
from structsel.candidates import Term
from structsel.errors import ChannelError, ModelError, TermError
from structsel.model import AeroModel, ResponseModel
from structsel.numerics.expressions import ProgramMaker, TermProgram, run_program
from structsel.numerics.flight_model import CHANNELS
from structsel.simulation.compile_model import Formulas, compile_aircraft

AIRCRAFT = Aircraft(name="test", mass=1000.0, S=10.0, b=8.0, cbar=1.4, V0=50.0)
TERMS = [
    *("1", "alpha", "alpha^3", "alpha^2*de", "beta^2*de*p", "(alpha - 0.1)^2*q", "(alpha - 0.05)+^3", "abs(de)*de"),
    *("sign(beta)", "tanh(10*(alpha - 0.2))", "exp(-V/50)", "sqrt(abs(beta))*de", "1/V", "de/V^2", "step(alpha - 0.1)"),
    *("(0.3 - alpha)", "(alpha - beta - 0.1)", "sin(alpha)*cos(beta)", "tan(alpha)", "log(V)", "(alpha*de/(1 + V))"),
    *("abs(alpha)^1.5", "(2*alpha + 3*beta)^2", "(-alpha - beta)"),
]


def model_of(terms, response="CZ"):
    return AeroModel({response: ResponseModel(tuple(map(Term, terms)), np.ones(len(terms)))})


def evaluate(program, rows):
    """(n, slots) every slot for each row of inputs."""
    slots = np.empty((len(rows), program.slots))
    slots[:, : program.inputs] = rows
    for row in slots:
        run_program(program, row)
    return slots


def channel_rows(n, controls, rng):
    rows = rng.normal(0.0, 0.2, (n, len(CHANNELS) + len(controls)))
    rows[:, CHANNELS.index("V")] = rng.uniform(30.0, 80.0, n)
    return rows, dict(zip((*CHANNELS, *controls), rows.T))


@pytest.mark.parametrize("term", TERMS)
def test_a_compiled_term_is_the_term(term):
    rows, channels = channel_rows(50, ("de",), np.random.default_rng(1))
    plan = compile_aircraft(model_of([term]), AIRCRAFT, Formulas(AIRCRAFT), ("de",)).arrays
    got = evaluate(plan.program, rows)[:, plan.term_slot[0]]
    assert_allclose(got, Term(term).evaluate(channels), rtol=4e-15, atol=1e-300)


def test_dimensionless_channels_and_definitions_are_worked_out_from_the_state():
    rows, channels = channel_rows(20, ("power",), np.random.default_rng(2))
    formulas = Formulas(AIRCRAFT, {"dpt": "0.1 + 3*load", "load": "power/V^3"})
    plan = compile_aircraft(model_of(["q_hat", "p_hat", "V_ratio", "dpt^2"]), AIRCRAFT, formulas, ("power",)).arrays
    got = evaluate(plan.program, rows)[:, plan.term_slot]
    V = channels["V"]
    assert_allclose(got[:, 0], channels["q"] * 1.4 / (2 * V), rtol=1e-14)
    assert_allclose(got[:, 1], channels["p"] * 8.0 / (2 * V), rtol=1e-14)
    assert_allclose(got[:, 2], V / 50.0, rtol=1e-14)
    assert_allclose(got[:, 3], (0.1 + 3 * channels["power"] / V**3) ** 2, rtol=1e-14)


def test_terms_with_a_common_factor_evaluate_it_once():
    maker = ProgramMaker(2)
    square = maker.emit("multiply", 0, 0)
    assert maker.emit("multiply", 0, 0) == square
    assert maker.done().slots == 3
    alone = [compile_aircraft(model_of([t]), AIRCRAFT, Formulas(AIRCRAFT), ("de",)) for t in ("alpha^2", "alpha^2*de")]
    both = compile_aircraft(model_of(["alpha^2", "alpha^2*de"]), AIRCRAFT, Formulas(AIRCRAFT), ("de",))
    assert both.arrays.program.operation.size == 2 == max(p.arrays.program.operation.size for p in alone)


def test_undefined_values_are_nan_or_inf_without_a_warning():
    maker = ProgramMaker(1)
    made = [maker.emit("log", 0), maker.emit("sqrt", 0), maker.emit("divide", maker.emit("number", value=1.0), 0)]
    program = maker.done()
    assert isinstance(program, TermProgram)
    with np.errstate(all="raise"):
        values = evaluate(program, np.array([[-1.0], [0.0]]))[:, made]
    assert_array_equal(np.isnan(values), [[True, True, False], [False, False, False]])
    assert_array_equal(values[1], [-np.inf, 0.0, np.inf])


def test_an_unknown_operation_or_an_unfilled_slot_is_refused():
    with pytest.raises(TermError, match="no operation 'cube'"):
        ProgramMaker(1).emit("cube", 0)
    with pytest.raises(TermError, match="takes slot 3; only 1"):
        ProgramMaker(1).emit("abs", 3)


def test_a_term_in_an_unknown_channel_names_it_and_what_there_is():
    with pytest.raises(ChannelError, match=r"needs channel 'gear'.*de"):
        compile_aircraft(model_of(["alpha*gear"]), AIRCRAFT, Formulas(AIRCRAFT), ("de",))


@pytest.mark.parametrize("term", ["alpha_dot_hat^2", "alpha_dot_hat*beta_dot_hat", "abs(beta_dot_hat)", "beta_dot^2"])
def test_a_term_not_linear_in_the_rate_of_the_flow_is_refused(term):
    with pytest.raises(ModelError, match="not linear in alpha_dot or beta_dot"):
        compile_aircraft(model_of([term]), AIRCRAFT, Formulas(AIRCRAFT), ())


def test_definitions_that_go_in_a_circle_are_refused():
    formulas = Formulas(AIRCRAFT, {"a": "2*b", "b": "a + 1"})
    with pytest.raises(ModelError, match="circle: a -> b -> a"):
        compile_aircraft(model_of(["a"]), AIRCRAFT, formulas, ())
    with pytest.raises(ModelError, match="'alpha' cannot be defined"):
        Formulas(AIRCRAFT, {"alpha": "theta"})


def test_body_and_wind_axes_are_not_mixed_and_other_responses_are_refused():
    one = ResponseModel((Term("alpha"),), np.ones(1))
    with pytest.raises(ModelError, match="mixes wind and body axes"):
        compile_aircraft(AeroModel({"CL": one, "CX": one}), AIRCRAFT, Formulas(AIRCRAFT), ())
    with pytest.raises(ModelError, match=r"has 'CM'.*'Cm'"):
        compile_aircraft(AeroModel({"CM": one}), AIRCRAFT, Formulas(AIRCRAFT), ())
