"""Terms as values, reading them from text, and the pools built from them."""

import math
import pickle
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from structsel.candidates import Candidates, Factor, Term
from structsel.errors import ChannelError, DataError, TermError

CHANNELS = ["alpha", "de", "q_hat", "V_ratio"]


@pytest.fixture
def signals():
    rng = np.random.default_rng(5)
    return {name: rng.normal(0.1, 0.3, 200) for name in CHANNELS}


# --- values ----------------------------------------------------------------------------------------


def test_a_product_is_equal_whatever_the_order_it_is_written_in():
    written = ["*".join(order) for order in permutations(["alpha^2", "de", "(q_hat - 0.1)+"])]
    assert len({Term(text) for text in written}) == 1
    assert Term("alpha*alpha*de") == Term("de*alpha**2") == Term("alpha") ** 2 * Term("de")
    assert Term("(beta + alpha)") == Term("(alpha + beta)")
    assert Term("alpha*de") != Term("alpha^2*de")


def test_terms_are_ordered_by_degree_then_as_the_words_they_spell():
    texts = ["de^2", "alpha*de", "de", "(alpha - 0.2)+", "alpha^3", "alpha", "1", "(alpha - 0.1)", "alpha^2"]
    assert [str(t) for t in sorted(map(Term, texts))] == [
        "1",
        "alpha",
        "(alpha - 0.1)",
        "(alpha - 0.2)+",
        "de",
        "alpha^2",
        "alpha*de",
        "de^2",
        "alpha^3",
    ]


def test_a_spline_with_a_higher_knot_comes_after_one_with_a_lower():
    # As text "(alpha - 10)+" would come before "(alpha - 9)+".
    assert Factor.spline("alpha", 9) < Factor.spline("alpha", 10)


def test_degree_and_channels_count_what_is_inside():
    term = Term("alpha^2*abs(de)*(q_hat - 0.2)+^3")
    assert term.degree == 6
    assert term.channels == ("alpha", "de", "q_hat")
    assert Term("1").is_constant
    assert Term("1") * term == term == term**1
    assert term**0 == Term("1")


def test_terms_survive_a_pickle():
    term = Term("alpha^2*tanh(10*(de - 0.2))")
    again = pickle.loads(pickle.dumps(term))
    assert again == term
    assert hash(again) == hash(term)


# --- reading ---------------------------------------------------------------------------------------

x = np.linspace(-0.9, 0.9, 37)  # holds 0 and no sample at a knot below
y = np.cos(5.0 * x)


@pytest.mark.parametrize(
    ("text", "canonical", "values"),
    [
        ("alpha*de", "alpha*de", x * y),
        ("de * alpha", "alpha*de", x * y),
        ("alpha**2", "alpha^2", x**2),
        ("alpha^2", "alpha^2", x**2),
        ("(alpha*de)^2", "alpha^2*de^2", (x * y) ** 2),
        ("(alpha-0.1)^2*de", "(alpha - 0.1)^2*de", (x - 0.1) ** 2 * y),
        ("(alpha + 0.1)", "(alpha + 0.1)", x + 0.1),
        ("(alpha - 0.0)", "alpha", x),
        ("(alpha-0.2)+", "(alpha - 0.2)+", np.where(x > 0.2, x - 0.2, 0)),
        ("(alpha - 0.2) + ^ 2 * de", "(alpha - 0.2)+^2*de", np.where(x > 0.2, x - 0.2, 0) ** 2 * y),
        ("(alpha)+", "(alpha)+", np.where(x > 0, x, 0)),
        ("(0.2 - alpha)+", "(0.2 - alpha)+", np.where(x < 0.2, 0.2 - x, 0)),
        ("abs(de)*de", "abs(de)*de", np.abs(y) * y),
        ("sin(alpha)", "sin(alpha)", np.sin(x)),
        ("tanh(10*(alpha-0.2))", "tanh(10*(alpha - 0.2))", np.tanh(10 * (x - 0.2))),
        ("exp(-(alpha-0.1)^2/2)", "exp(-(alpha - 0.1)^2/2)", np.exp(-((x - 0.1) ** 2) / 2)),
        ("sqrt(1 - alpha^2)", "sqrt(1 - alpha^2)", np.sqrt(1 - x**2)),
        ("step(alpha - 0.2)", "step(alpha - 0.2)", (x >= 0.2) * 1.0),
        ("(alpha + de)", "(alpha + de)", x + y),
        ("alpha/(2 + de)^2", "(1/(de + 2))^2*alpha", x / (2 + y) ** 2),
        ("(2 + alpha)^-1", "(1/(alpha + 2))", 1 / (2 + x)),
        ("(2 + alpha)^0.5", "((alpha + 2)^0.5)", np.sqrt(2 + x)),
        ("sin(alpha - (de - 0.1) - -2*de)", "sin(2*de + alpha + 0.1 - de)", np.sin(x - (y - 0.1) + 2 * y)),
        ("cos(2*(alpha)+ - de)", "cos(2*(alpha)+ - de)", np.cos(2 * np.maximum(x, 0) - y)),
        ("1", "1", np.ones_like(x)),
    ],
)
def test_text_is_read_as_the_formula_it_shows(text, canonical, values):
    term = Term.parse(text)
    assert str(term) == canonical
    assert Term.parse(canonical) == term
    assert_allclose(term.evaluate({"alpha": x, "de": y}), values, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "position", "message"),
    [
        ("2*alpha", 1, "only a number"),
        ("0.3", 1, "only a number"),
        ("alpha*sin(0.1)", 7, "only a number"),
        ("alpha + alpha^2", 1, "Write two terms"),
        ("-alpha", 1, "no sign of its own"),
        ("alpha*", 7, "ends too early"),
        ("alpha de", 7, "does not follow"),
        ("(alpha - 0.2", 1, "parenthesis"),
        ("alpha*foo(de)", 7, "'foo' is not a function"),
        ("alpha(de - 0.1)", 1, r"Use \* to multiply"),
        ("sin(alpha, de)", 1, "one argument"),
        ("sin(*alpha)", 1, "one argument"),
        ("alpha^de", 7, "a power is a number"),
        ("alpha^0", 1, "a power of zero"),
        ("alpha^1000", 1, "above 99"),
        ("alpha[0]", 6, "means nothing here"),
        ("alpha # de", 7, "means nothing here"),
        ("__import__('os')", 12, "means nothing here"),
        ("alpha.real", 1, "cannot be used"),
        ("alpha if de else q", 1, "cannot be used"),
        ("alpha//de", 1, "FloorDiv"),
        ("de*True", 4, "cannot be used"),
        ("2j*alpha", 1, "cannot be used"),
        ("1e999*alpha", 1, "too large"),
        ("de*" + "(" * 300 + "alpha" + ")" * 300, 204, "does not follow on"),
        ("de*" + "sin(" * 190 + "alpha" + ")" * 190, 604, "deeply nested"),
        ("a" * 2000, 1001, "longer than"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_position_and_a_remedy(text, position, message):
    with pytest.raises(TermError, match=message) as caught:
        Term.parse(text)
    assert f"at position {position}:" in str(caught.value)


@pytest.mark.parametrize(("text", "message"), [("", "empty"), ("  ", "empty"), (3, "found 3 of type int")])
def test_a_term_that_is_no_text_is_refused(text, message):
    with pytest.raises(TermError, match=message):
        Term.parse(text)


names = st.sampled_from(["alpha", "beta", "V", "q_hat", "de"])
numbers = st.floats(-1e6, 1e6).filter(lambda v: v != 0)
simple = st.one_of(
    st.builds(Factor.channel, names),
    st.builds(Factor.offset, names, numbers),
    st.builds(Factor.spline, names, numbers),
)
inside = st.recursive(
    st.one_of(names, st.floats(1e-9, 1e9).map(repr)),
    lambda inner: st.one_of(
        st.builds("({} {} {})".format, inner, st.sampled_from("+-*/"), inner),
        st.builds("({})+".format, inner),
        st.builds("(-{})".format, inner),
        st.builds("({})^{}".format, inner, st.sampled_from(["2", "0.5", "-3"])),
        st.builds("{}({})".format, st.sampled_from(["abs", "sin", "exp", "step"]), inner),
    ),
    max_leaves=8,
)
formulas = st.builds("tanh(V + {})".format, inside).map(lambda text: Term(text).factors[0][0])


@given(st.dictionaries(st.one_of(simple, formulas), st.integers(1, 4), max_size=4))
@settings(max_examples=300, deadline=None)
def test_the_text_of_any_term_reads_back_to_the_same_term(powers):
    term = Term(powers)
    again = Term.parse(str(term))
    assert again == term
    assert str(again) == str(term)


POINT = {"alpha": 3, "beta": -2, "V": 7, "q_hat": -11, "de": 1}


def combined(left, sign, right):
    value = {"+": left[1] + right[1], "-": left[1] - right[1], "*": left[1] * right[1]}[sign]
    return f"({left[0]} {sign} {right[0]})", value, max(left[2], right[2], abs(value))


# (text, value by Python's own whole numbers, largest number met on the way)
worked = st.recursive(
    st.one_of(
        st.sampled_from([(name, value, abs(value)) for name, value in POINT.items()]),
        st.integers(0, 20).map(lambda v: (str(v), v, v)),
    ),
    lambda inner: st.one_of(
        st.builds(combined, inner, st.sampled_from("+-*"), inner),
        inner.map(lambda e: (f"({e[0]})+", max(e[1], 0), e[2])),
        inner.map(lambda e: (f"(-{e[0]})", -e[1], e[2])),
        inner.map(lambda e: (f"abs({e[0]})", abs(e[1]), e[2])),
        inner.map(lambda e: (f"({e[0]})**2", e[1] ** 2, max(e[2], e[1] ** 2))),
    ),
    max_leaves=10,
).filter(lambda e: e[2] < 2**50)


@given(worked)
@settings(max_examples=300, deadline=None)
def test_the_value_of_a_formula_is_that_of_integer_arithmetic(example):
    # Whole numbers below 2^53 are exact in float64 in whatever order they are added.
    text, value, _ = example
    got = Term(f"abs(V + ({text}))").evaluate({name: np.array([float(v)]) for name, v in POINT.items()})
    assert got[0] == abs(POINT["V"] + value)


# --- values on signals -----------------------------------------------------------------------------


def test_a_missing_channel_is_named_with_the_term_that_needs_it(signals):
    pool = Candidates(["alpha", "alpha*mach"])
    with pytest.raises(ChannelError, match=r"(?s)Term 'alpha\*mach' needs channel 'mach'.*It has: alpha, de"):
        pool.evaluate_base(signals)


def test_a_channel_with_a_nan_is_refused_with_its_sample(signals):
    signals["de"][17] = np.nan
    with pytest.raises(DataError, match=r"needs channel 'de'.*nan at sample 17 \(1 such"):
        Candidates(["alpha*de"]).evaluate(signals)


def test_a_formula_outside_its_domain_names_term_and_sample():
    with pytest.raises(TermError, match=r"Term 'de\*log\(alpha\)' is nan at sample 2, where alpha = -0.5"):
        Term("de*log(alpha)").evaluate({"alpha": np.array([1.0, 2.0, -0.5]), "de": np.ones(3)})
    with pytest.raises(TermError, match=r"is inf at sample 1"):
        Term("1/V").evaluate({"V": np.array([1.0, 0.0])})


def test_every_pool_value_is_the_power_product_of_its_base(signals):
    pool = Candidates.polynomial(CHANNELS, 3) + Candidates.splines("alpha", [0.0, 0.2], 2, times=["de"])
    base = pool.evaluate_base(signals)
    assert base.flags.c_contiguous
    assert base.dtype == np.float64
    assert base.shape == (len(pool.base), 200)
    values = pool.evaluate(signals)
    for i, term in enumerate(pool):
        assert_allclose(values[:, i], np.prod(base.T ** pool.exponents[i], axis=1), rtol=1e-13, atol=0)
        assert_array_equal(values[:, i], term.evaluate(signals))  # to the last bit
    assert_array_equal(pool.exponents.sum(axis=1), [term.degree for term in pool])


# --- pools -----------------------------------------------------------------------------------------


@given(st.integers(1, 6), st.integers(1, 4))
def test_a_polynomial_pool_holds_every_monomial_once(count, degree):
    pool = Candidates.polynomial([f"x{i}" for i in range(count)], degree)
    assert len(pool) == math.comb(count + degree, degree) - 1
    assert len(set(pool)) == len(pool)
    assert list(pool) == sorted(pool)


def test_interactions_and_powers_are_limited_as_asked():
    both = ["alpha", "de"]
    plain = Candidates.polynomial(both, 3, interactions=False)
    assert plain.names == ["alpha", "de", "alpha^2", "de^2", "alpha^3", "de^3"]
    assert Candidates.polynomial(both, 3, interactions=2) == plain + "alpha*de"
    assert Candidates.polynomial(both, 3, max_power=1).names == ["alpha", "de", "alpha*de"]
    assert Candidates.polynomial(both, 3) == Candidates.polynomial(both, 3, interactions=7)


def test_a_polynomial_takes_factors_as_well_as_channels():
    pool = Candidates.polynomial(["(alpha - 0.1)", "abs(de)"], 2)
    assert pool.names == ["abs(de)", "(alpha - 0.1)", "abs(de)^2", "abs(de)*(alpha - 0.1)", "(alpha - 0.1)^2"]


def test_splines_are_klein_s_truncated_powers(signals):
    pool = Candidates.splines("alpha", [0.1, 0.3], degree=2, times=["de", "q_hat*de"])
    assert pool.names[:2] == ["(alpha - 0.1)+^2", "(alpha - 0.3)+^2"]
    assert len(pool) == 6
    a = signals["alpha"]
    assert_allclose(pool.evaluate(signals)[:, 0], np.where(a >= 0.1, (a - 0.1) ** 2, 0.0), rtol=1e-14)
    step = Candidates.splines("alpha", [0.1], degree=0)
    assert_array_equal(step.evaluate(signals)[:, 0], (a >= 0.1) * 1.0)


def test_a_pool_about_a_reference_spans_the_same_models(signals):
    pool = Candidates.polynomial(["alpha", "de"], 2)
    moved = pool.about(alpha=0.1)
    assert "(alpha - 0.1)*de" in moved
    assert len(moved) == len(pool)
    one = np.ones((200, 1))
    ours, theirs = np.hstack([one, pool.evaluate(signals)]), np.hstack([one, moved.evaluate(signals)])
    residual = theirs - ours @ np.linalg.lstsq(ours, theirs, rcond=None)[0]
    assert_allclose(residual, 0.0, atol=1e-12)


def test_pools_join_without_duplicates_and_give_up_terms():
    pool = Candidates(["de", "alpha", "1"]) + Candidates(["alpha", "alpha*de"]) + Term("alpha^2")
    assert pool.names == ["de", "alpha", "alpha*de", "alpha^2"]  # the order given, what is new last
    assert pool == Candidates.parse(["alpha*de", "alpha^2", "de", "alpha"])
    assert hash(pool) == hash(Candidates.parse(["alpha*de", "alpha^2", "de", "alpha"]))
    assert pool != Candidates(["de", "alpha"])
    assert "de*alpha" in pool
    assert Term("beta") not in pool
    assert pool[2] == Term("alpha*de")
    assert pool.index("de") == 0
    assert pool.channels == ("alpha", "de")
    assert pool.without("alpha", lambda term: term.degree == 2).names == ["de"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Candidates(["alpha"]).without("alhpa"),
            "'alhpa', which is not among the 1 candidates. Nearest: alpha",
        ),
        (lambda: Candidates(["alpha"]).about(beta=0.1), "about.. was given beta.*Plain channels: alpha"),
        (lambda: Candidates(["alpha"]).index("beta"), "not among"),
        (lambda: Candidates("alpha"), "takes a list"),
        (lambda: Candidates.polynomial("alpha", 2), "takes a list"),
        (lambda: Candidates.polynomial(["alpha*de"], 2), "single channels or factors"),
        (lambda: Candidates.polynomial(["alpha"], 0), "degree is a whole number, 1 or more; found 0"),
        (lambda: Candidates.polynomial(["alpha"], 1.5), "degree is a whole number"),
        (lambda: Candidates.polynomial([f"x{i}" for i in range(60)], 6), "would hold .* Lower the degree"),
        (lambda: Candidates.splines("alpha", [np.nan]), "knot of a factor must be finite"),
        (lambda: Candidates.splines("al pha", [0.1]), "needs a channel's name"),
        (lambda: Term("alpha") ** -1, "power is 0, 1, 2"),
        (lambda: (Term("alpha") * Term("de")) ** 60, "has degree 120"),
    ],
)
def test_what_a_pool_cannot_do_is_refused_with_a_remedy(make, message):
    with pytest.raises(TermError, match=message):
        make()


def test_latex_uses_the_symbols_of_the_nomenclature():
    assert Term("alpha^2*de").latex() == r"\alpha^{2} \, \delta_e"
    assert Term("(alpha - 0.2)+^2").latex() == r"\left(\alpha - 0.2\right)_+^{2}"
    assert Term("abs(de)").latex() == r"\left|\delta_e\right|"
    assert Term("alpha/my_V").latex() == r"\left(\frac{1}{\mathrm{my\_V}}\right) \, \alpha"
