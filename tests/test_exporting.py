"""Exports: Python, C and Modelica give the model's values; tables and text carry values, errors and region."""

import math
import operator
import re
import shutil
import subprocess
import sys
from io import StringIO

import matplotlib.mathtext
import numpy as np
import pandas as pd
import pytest
import statsmodels.api as sm
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from structsel import AeroModel, Aircraft, ResponseModel, Term, export_model, published_aircraft
from structsel.candidates.formula import FUNCTIONS
from structsel.errors import DataError, ModelError, TermError
from structsel.exporting import TARGETS
from tests.commands import run
from tests.exported_models import KINDS, exported_to_c, exported_to_python, model_of, random_states

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
STATES = random_states(40, seed=1)
MODEL = model_of({"CX": KINDS[::2], "Cm": KINDS[1::2], "my response": KINDS[:3], "CZ": ()})
EXAMPLE = AeroModel(
    {
        "Cm": ResponseModel(
            ("1", "alpha", "(alpha - 0.2)+^2"),
            np.array([0.0123456789, -1.9876543, 3e-7]),
            np.diag([0.00112, 0.0334, 5.5e-9]) ** 2,
            method="stepwise",
            residuals="coloured",
            ranges={"alpha": (-0.125, 0.375)},
            n=500,
            s2=1e-4,
            r2=0.9712,
        )
    },
    "example",
    ("m01", "m02"),
)


def states_one_by_one(states=STATES, channels=None):
    names = states if channels is None else channels
    return [{name: float(states[name][i]) for name in names} for i in range(len(next(iter(states.values()))))]


def assert_agrees(function, model, states=STATES):
    """Every response at every state, to rounding of its largest term."""
    expected = model.evaluate(states)
    found = [function(**state) for state in states_one_by_one(states, model.channels)]
    for name, held in model.responses.items():
        parts = [np.abs(v * t.evaluate(states)) for t, v in zip(held.terms, held.values)]
        rounding = 1e-12 * (1.0 + np.max(parts, axis=0, initial=0.0))
        error = np.abs(np.array([row[name] for row in found]) - expected[name])
        assert (error <= rounding).all(), name


def test_the_kinds_hold_every_function_and_piece_a_term_can_have():
    called = set(re.findall(r"[a-z]+(?=\()", " ".join(KINDS)))
    assert called == set(FUNCTIONS)
    assert {factor.kind for term in map(Term, KINDS) for factor, _ in term.factors} == {
        "channel", "offset", "spline", "formula",
    }  # fmt: skip


# --- functions ------------------------------------------------------------------------------------------


def test_python_gives_what_the_model_gives(tmp_path):
    assert_agrees(exported_to_python(MODEL, tmp_path), MODEL)


@needs_compiler
def test_c_gives_what_the_model_gives(tmp_path):
    plain = AeroModel({"CX": MODEL["CX"], "Cm": MODEL["Cm"], "CZ": MODEL["CZ"]})
    assert_agrees(exported_to_c(plain, tmp_path, COMPILER), plain)


def modelica_function(path):
    """The exported function as another reader of Modelica understands it."""
    parser = pytest.importorskip("pymoca.parser", reason="pymoca, which reads Modelica, is not installed")
    function = list(parser.parse(path.read_text()).classes.values())[-1]  # Modelica's own come first
    assert function.type == "function"
    known = {name: getattr(math, name) for name in ("sin", "cos", "tan", "exp", "log", "tanh", "sqrt")}
    known |= {"abs": abs, "max": max, "sign": lambda x: math.copysign(1.0, x) if x else 0.0, ">=": operator.ge}
    known |= {"*": operator.mul, "/": operator.truediv, "^": operator.pow}
    known |= {"+": lambda *a: sum(a), "-": lambda *a: a[0] - a[1] if len(a) > 1 else -a[0]}

    def value(node, slots):
        kind = type(node).__name__
        if kind == "Primary":
            return node.value
        if kind == "ComponentRef":
            return slots[node.name]
        if kind == "IfExpression":
            return value(node.expressions[0 if value(node.conditions[0], slots) else 1], slots)
        return known[str(getattr(node.operator, "name", node.operator))](*(value(n, slots) for n in node.operands))

    def evaluate(**slots):
        for statement in function.statements:
            slots[statement.left[0].name] = value(statement.right, slots)
        return slots

    inputs = [name for name, symbol in function.symbols.items() if "input" in symbol.prefixes]
    outputs = [name for name, symbol in function.symbols.items() if "output" in symbol.prefixes]
    return evaluate, inputs, outputs


def test_modelica_gives_what_the_model_gives(tmp_path):
    plain = AeroModel({"CX": MODEL["CX"], "Cm": MODEL["Cm"]})
    evaluate, inputs, outputs = modelica_function(export_model(plain, tmp_path / "flight.mo", to="modelica"))
    assert (tuple(inputs), outputs) == (plain.channels, ["CX", "Cm"])
    assert_agrees(evaluate, plain)


def formulas():
    """Formulas that hold everywhere, as text."""
    leaves = st.sampled_from(["V", "alpha", "beta", "de", "q_hat"]) | st.floats(0.01, 9.0).map(lambda x: f"{x:.3g}")

    def grow(inner):
        pairs = st.tuples(inner, inner)
        return st.one_of(
            pairs.map(lambda p: f"({p[0]} + {p[1]})"),
            pairs.map(lambda p: f"({p[0]} - {p[1]})"),
            pairs.map(lambda p: f"({p[0]}*{p[1]})"),
            pairs.map(lambda p: f"({p[0]}/(1 + abs({p[1]})))"),
            inner.map(lambda x: f"({x} - 0.1)+"),
            inner.map(lambda x: f"(-{x})"),
            inner.map(lambda x: f"({x})^2"),
            inner.map(lambda x: f"(0.1 + abs({x}))^-0.7"),
            inner.map(lambda x: f"log(0.1 + abs({x}))"),
            inner.map(lambda x: f"exp(tanh({x}))"),
            inner.map(lambda x: f"sqrt(abs({x}))"),
            st.tuples(st.sampled_from(["sign", "step", "sin", "cos", "tanh", "abs"]), inner).map(
                lambda p: f"{p[0]}({p[1]})"
            ),
        )

    return st.recursive(leaves, grow, max_leaves=6)


@st.composite
def models(draw):
    terms = {}
    for text in draw(st.lists(formulas(), min_size=1, max_size=6)):
        try:
            term = Term(f"alpha*({text})^{draw(st.integers(1, 3))}")
        except TermError:  # degree, or only a number
            continue
        terms[term] = draw(st.floats(-1e3, 1e3))
    return AeroModel({"Cm": ResponseModel(tuple(terms), np.array(list(terms.values())))})


@given(model=models())
@settings(max_examples=60)
def test_python_agrees_for_any_formula(model, tmp_path_factory):
    assert_agrees(exported_to_python(model, tmp_path_factory.getbasetemp()), model)


@needs_compiler
@given(model=models())
@settings(max_examples=12)
def test_c_agrees_for_any_formula(model, tmp_path_factory):
    # A library is loaded once by its path: every one has its own.
    assert_agrees(exported_to_c(model, tmp_path_factory.mktemp("c"), COMPILER), model)


@needs_compiler
def test_inputs_that_are_no_numbers_stay_so_and_none_is_clipped(tmp_path):
    model = model_of({"Cm": ("(alpha - 0.1)+", "sign(beta)")}, ranges={"alpha": (0.0, 0.2), "beta": (-0.1, 0.1)})
    for function in (exported_to_python(model, tmp_path), exported_to_c(model, tmp_path, COMPILER)):
        assert math.isnan(function(alpha=math.nan, beta=0.0)["Cm"])
        assert math.isnan(function(alpha=0.0, beta=math.nan)["Cm"])
        far = {"alpha": 50.0, "beta": -9.0}
        expected = model.evaluate({name: np.array([value]) for name, value in far.items()}, outside="ignore")["Cm"][0]
        assert function(**far)["Cm"] == pytest.approx(expected, rel=1e-14)


def test_python_raises_where_a_formula_does_not_hold(tmp_path):
    function = exported_to_python(model_of({"Cm": ("log(V)", "1/alpha", "beta^0.5")}), tmp_path)
    for state in ({"V": -1.0}, {"alpha": 0.0}, {"beta": -1.0}):
        with pytest.raises((ValueError, ArithmeticError)):
            function(**{"V": 1.0, "alpha": 1.0, "beta": 1.0, **state})


def test_the_python_module_needs_nothing_but_python(tmp_path):
    export_model(MODEL, tmp_path / "alone.py", to="python")
    state = {name: states_one_by_one()[0][name] for name in MODEL.channels}
    program = f"import alone; print(repr(alone.evaluate(**{state!r})['Cm']))"
    bare = [sys.executable, "-I", "-S", "-c", f"import sys; sys.path.insert(0, '.'); {program}"]
    done = subprocess.run(bare, cwd=tmp_path, capture_output=True, text=True, check=True)
    expected = MODEL.evaluate({name: np.array([value]) for name, value in state.items()})["Cm"][0]
    assert float(done.stdout) == pytest.approx(expected, rel=1e-12)


@needs_compiler
def test_a_c_program_links_two_models(tmp_path):
    for stem, response in (("pitch", "Cm"), ("force", "CZ")):
        export_model(AeroModel({response: EXAMPLE["Cm"]}), tmp_path / f"{stem}.c", to="c")
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "pitch.h"\n#include "force.h"\nint main(void) {\n'
        "  struct pitch_inputs a = { .alpha = 0.3 }; struct force_inputs b = { .alpha = 0.1 };\n"
        '  printf("%.17g %.17g", pitch_evaluate(a).Cm, force_evaluate(b).CZ); return 0; }\n'
    )
    build = [COMPILER, "-std=c99", "-o", "main", "main.c", "pitch.c", "force.c", "-lm"]
    subprocess.run(build, cwd=tmp_path, check=True)
    printed = subprocess.run(["./main"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout.split()
    assert_allclose([float(x) for x in printed], EXAMPLE["Cm"].evaluate({"alpha": np.array([0.3, 0.1])}), rtol=1e-14)


AWKWARD = model_of({"int": ("int*math", "model", "out*_x", "Δ^2"), "class": ("factor_1", "abs*abs(abs)", "evaluate")})


def awkward_states():
    rng = np.random.default_rng(3)
    return {name: rng.uniform(0.1, 1.0, 5) for name in AWKWARD.channels}


def by_order(function, names):
    """Call with our names a function whose inputs are named otherwise, in our order."""

    def call(**state):
        return function(**dict(zip(names, (state[c] for c in AWKWARD.channels))))

    return call


def test_words_of_a_language_are_written_so_that_it_takes_them_in_python(tmp_path):
    function = exported_to_python(AWKWARD, tmp_path)
    names = list(function.__kwdefaults__ or function.__code__.co_varnames[: function.__code__.co_kwonlyargcount])
    assert_agrees(by_order(function, names), AWKWARD, awkward_states())
    assert "Δ in the model" in function.__doc__


def test_words_of_a_language_are_written_so_that_it_takes_them_in_modelica(tmp_path):
    evaluate, inputs, outputs = modelica_function(export_model(AWKWARD, tmp_path / "end.mo", to="modelica"))

    def named(**state):
        return dict(zip(AWKWARD, (evaluate(**state)[name] for name in outputs)))

    assert_agrees(by_order(named, inputs), AWKWARD, awkward_states())


@needs_compiler
def test_words_of_a_language_are_written_so_that_it_takes_them_in_c(tmp_path):
    source = export_model(AWKWARD, tmp_path / "double.c", to="c")
    strict = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
    subprocess.run([COMPILER, *strict, "-c", source, "-o", tmp_path / "double.o"], check=True)
    fields = re.findall(r"^    double (\w+);", source.with_suffix(".h").read_text(), re.MULTILINE)
    assert len(fields) == len(AWKWARD.channels) + len(AWKWARD)
    assert {"int_", "out_", "n_x", "abs"} <= set(fields)


@needs_compiler
def test_names_cannot_end_a_comment_or_begin_code(tmp_path):
    name = 'a */ #error \\\n#error here """ --> ??/'
    model = AeroModel({"Cm": ResponseModel(("alpha",), np.array([2.0]), method=name)}, name, (name,))
    assert exported_to_python(model, tmp_path)(alpha=1.5)["Cm"] == 3.0
    assert exported_to_c(model, tmp_path, COMPILER)(alpha=1.5)["Cm"] == 3.0
    evaluate, *_ = modelica_function(export_model(model, tmp_path / "it.mo", to="modelica"))
    assert evaluate(alpha=1.5)["Cm"] == 3.0


@needs_compiler
def test_a_model_of_constants_has_no_inputs(tmp_path):
    model = model_of({"Cm": ("1",), "CX": ()})
    for function in (exported_to_python(model, tmp_path), exported_to_c(model, tmp_path, COMPILER)):
        assert function() == {"Cm": model["Cm"].values[0], "CX": 0.0}


# --- what every export says -----------------------------------------------------------------------------


@pytest.mark.parametrize("target", TARGETS)
def test_every_export_says_the_errors_the_region_and_the_lengths(target, tmp_path):
    path = export_model(EXAMPLE, tmp_path / "example.xml", to=target, aircraft=published_aircraft("citation").aircraft)
    text = path.read_text()
    for said in (
        "m01, m02",
        "-0.125",
        "0.375",
        "S = 24.99 m^2",
        "cbar = 1.991 m",
        "0.0334" if target != "summary" else "0.033",
    ):
        assert said in text, said
    assert "not clipped" in text


def test_a_value_whose_error_is_not_known_says_so(tmp_path):
    text = export_model(model_of({"Cm": ("alpha",)}), tmp_path / "m.py", to="python").read_text()
    assert "alpha: standard error not known" in text
    assert "does not say where it was flown" in text


# --- tables and text ------------------------------------------------------------------------------------


def test_csv_reads_back_to_the_last_bit(tmp_path):
    path = export_model(MODEL, tmp_path / "terms.csv", to="csv")
    frame = MODEL.to_frame()
    read = pd.read_csv(path, comment="#", dtype=str)  # pandas 2 reads floats in haste
    read = read.assign(held=read.held == "True").astype(frame.dtypes)
    pd.testing.assert_frame_equal(read, frame, check_exact=True, check_dtype=False)


def test_the_table_of_the_summary_is_that_of_statsmodels(tmp_path):
    rng = np.random.default_rng(5)
    channels = {name: rng.normal(size=80) for name in ("alpha", "q_hat", "de")}
    y = 0.1 - 0.8 * channels["alpha"] + 0.02 * channels["q_hat"] + 0.3 * rng.normal(size=80)
    fit = sm.OLS(pd.Series(y, name="Cm"), sm.add_constant(pd.DataFrame(channels)).rename(columns={"const": "1"})).fit()
    cov = fit.cov_params().to_numpy()
    held = ResponseModel(tuple(fit.params.index), fit.params.to_numpy(), cov, n=80, s2=fit.scale, r2=fit.rsquared)
    text = export_model(AeroModel({"Cm": held}), tmp_path / "m.txt", to="summary").read_text()
    assert fit.summary().tables[1].as_text() in text
    assert re.search(rf"R-squared: +{fit.rsquared:.3f}", text)
    assert re.search(r"No\. Observations: +80", text)
    assert re.search(r"Df Residuals: +76", text)
    assert re.search(rf"Residual std: +{math.sqrt(fit.scale):.4g}", text)


def test_latex_equations_can_be_set_and_the_table_is_the_model_s(tmp_path):
    text = export_model(MODEL, tmp_path / "m.tex", to="latex").read_text()
    assert MODEL.latex() in text
    equations = re.search(r"\\begin\{align\*\}\n(.*?)\n\\end\{align\*\}", text, re.DOTALL)[1]
    lines = [line.replace("&{}", "").replace("={}&", "=") for line in equations.split(r"\\")]
    parser = matplotlib.mathtext.MathTextParser("path")
    for line in lines:
        assert parser.parse(f"${line.strip()}$").width > 0
    shown = " ".join(lines)
    for held in MODEL.responses.values():
        for value in held.values:
            mantissa = f"{abs(value):.5g}".partition("e")[0]
            assert mantissa in shown
    assert shown.count("=") == len(MODEL)


# --- files and refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize("target", TARGETS)
def test_a_file_that_is_there_stays_unless_it_may_go(target, tmp_path):
    path = tmp_path / "m.xml"
    path.write_text("mine")
    with pytest.raises(DataError, match="exists already"):
        export_model(EXAMPLE, path, to=target)
    assert path.read_text() == "mine"
    assert export_model(EXAMPLE, path, to=target, overwrite=True) == path
    assert path.read_text() != "mine"
    assert not list(tmp_path.glob(".*"))


def test_a_header_that_is_there_stays_too(tmp_path):
    (tmp_path / "m.h").write_text("mine")
    with pytest.raises(DataError, match=r"m\.h' exists already"):
        export_model(EXAMPLE, tmp_path / "m.c", to="c")
    assert not (tmp_path / "m.c").exists()
    with pytest.raises(ModelError, match=r"overwrite its own header.*m\.c"):
        export_model(EXAMPLE, tmp_path / "m.h", to="c", overwrite=True)


def test_what_cannot_be_written_says_why(tmp_path):
    with pytest.raises(DataError, match="cannot be written: No such file"):
        export_model(EXAMPLE, tmp_path / "nowhere" / "m.py", to="python")
    with pytest.raises(ModelError, match=r"no export to 'jsbsin'\. Did you mean 'jsbsim'"):
        export_model(EXAMPLE, tmp_path / "m", to="jsbsin")
    with pytest.raises(ModelError, match="takes the model's channels as they are"):
        export_model(EXAMPLE, tmp_path / "m", to="c", definitions={"alpha": "theta"})


# --- command --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", TARGETS)
def test_the_command_writes_what_the_function_writes(target, tmp_path):
    EXAMPLE.to_json(tmp_path / "model.json")
    (tmp_path / "aircraft.toml").write_text(
        'name = "example"\nS = 20.0\nb = 12.0\ncbar = 1.8\nmass = 2000.0\n'
        "[inertia]\nIx = 3000.0\nIy = 4000.0\nIz = 6000.0\n"
    )
    there, here = tmp_path / "there", tmp_path / "here"
    for folder in (there, here):
        folder.mkdir()
    expected = export_model(
        EXAMPLE, here / "out.xml", to=target, aircraft=Aircraft.from_toml(tmp_path / "aircraft.toml")
    ).read_text()
    asked = ("export", tmp_path / "model.json", "--to", target, "--aircraft", tmp_path / "aircraft.toml")
    said = run(*asked, "--out", there / "out.xml").stdout
    assert said == f"Written to {there / 'out.xml'}.\n"
    assert (there / "out.xml").read_text() == expected
    assert "pass --overwrite" in run(*asked, "--out", there / "out.xml", code=1).stderr
    run(*asked, "--out", there / "out.xml", "--overwrite")


def test_the_command_says_what_it_cannot_read(tmp_path):
    EXAMPLE.to_json(tmp_path / "model.json")
    run("export", tmp_path / "model.json", "--out", tmp_path / "m.xml", "--properties", "rpm", code=2)
    refused = run("export", tmp_path / "model.json", "--to", "csv", "--out", tmp_path / "m", "--define", "a=V", code=1)
    assert "as they are" in refused.stderr
    page = run("export", "--help").stdout
    assert "structsel export out/model.json --to jsbsim" in page
    assert max(map(len, page.splitlines())) <= 80


def test_the_exported_csv_is_one_table(tmp_path):
    text = export_model(EXAMPLE, tmp_path / "m.csv", to="csv").read_text()
    rows = [line for line in text.splitlines() if not line.startswith("#")]
    assert len(pd.read_csv(StringIO("\n".join(rows)))) == 3
