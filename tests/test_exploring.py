"""What adding a term would do is what refitting with it does, and the explorer shows it."""

import sys

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose

from structsel import AeroModel, Candidates, Recording, explore_residuals, select
from structsel.errors import SelectionError, StructselError
from structsel.exploring import try_additions
from structsel.model import ResponseModel
from structsel.numerics.criteria import pse

POOL = Candidates(["alpha", "de", "alpha^2", "alpha*de", "de^2", "de^3"])


def manoeuvre(k, n=300):
    rng = np.random.default_rng([12, k])
    t = 0.05 * np.arange(n)
    alpha = 0.1 + 0.05 * np.sin(0.9 * t + k) + 0.01 * rng.standard_normal(n)
    de = 0.05 * np.sign(np.sin(1.3 * t)) + 0.02 * rng.standard_normal(n)
    noise = 0.004 * rng.standard_normal((2, n))
    Cm = 0.05 - 0.5 * alpha - 1.5 * de + 8.0 * (alpha - 0.1) ** 2 + noise[0]
    CZ = -0.3 - 4.0 * alpha - 30.0 * de**2 + noise[1]
    return Recording(f"m{k}", t, {"alpha": alpha, "de": de, "V": np.full(n, 60.0), "Cm": Cm, "CZ": CZ})


RECORDINGS = [manoeuvre(k) for k in range(4)]
MODEL = select(RECORDINGS, ["Cm", "CZ"], Candidates(["alpha", "de"]), include=["alpha", "de"], bootstrap=0).model


def columns(recordings, terms):
    return np.concatenate([sm.add_constant(Candidates.parse(terms).evaluate(r)) for r in recordings])


def response(recordings, name="Cm"):
    return np.concatenate([r[name] for r in recordings])


def held_out(recordings, terms):
    """R2 of each recording predicted from the others, about its own mean, one refit after another."""
    error = spread = 0.0
    for k, one in enumerate(recordings):
        others = recordings[:k] + recordings[k + 1 :]
        beta = np.linalg.lstsq(columns(others, terms), response(others), rcond=None)[0]
        error += np.sum((one["Cm"] - columns([one], terms) @ beta) ** 2)
        spread += np.sum((one["Cm"] - one["Cm"].mean()) ** 2)
    return 1.0 - error / spread


@pytest.mark.parametrize("term", ["alpha^2", "alpha*de", "de^3"])
def test_each_term_has_the_effect_of_refitting_with_it(term):
    found = try_additions(MODEL, RECORDINGS, "Cm", POOL)
    terms = ["alpha", "de", term]
    fit = sm.OLS(response(RECORDINGS), columns(RECORDINGS, terms)).fit()
    r2, fraction, ahead = found[term]
    assert_allclose(r2, fit.rsquared, rtol=1e-10)
    assert_allclose(ahead, held_out(RECORDINGS, terms), rtol=1e-9)
    tss = np.sum((response(RECORDINGS) - response(RECORDINGS).mean()) ** 2)
    assert_allclose(fraction, pse(fit.ssr, tss, 1200, 3) / (tss / 1200), rtol=1e-10)
    order = list(map(str, Candidates.parse(terms)))
    i = [str(t) for t in found.terms].index(term)
    assert_allclose(found.values[i], fit.params[1 + order.index(term)], rtol=1e-8)


def test_the_present_model_is_listed_before_them():
    found = try_additions(MODEL, RECORDINGS, "Cm", POOL)
    fit = sm.OLS(response(RECORDINGS), columns(RECORDINGS, ["alpha", "de"])).fit()
    assert_allclose(found.before[0], fit.rsquared, rtol=1e-12)
    assert_allclose(found.before[2], held_out(RECORDINGS, ["alpha", "de"]), rtol=1e-10)
    frame = found.to_frame()
    assert frame.term[0] == "(as it is)"
    assert (np.diff(frame.held_out_r2[1:]) <= 0.0).all()


def test_the_term_left_out_comes_first_for_each_response():
    assert str(try_additions(MODEL, RECORDINGS, "Cm", POOL).terms[0]) == "alpha^2"
    assert str(try_additions(MODEL, RECORDINGS, "CZ", POOL).terms[0]) == "de^2"


def test_one_recording_is_held_out_segment_by_segment():
    long = manoeuvre(0, 800)
    parts = [Recording(str(k), long.t[s], {c: long[c][s] for c in ("alpha", "de", "Cm")})
             for k, s in enumerate(np.split(np.arange(800), 8))]  # fmt: skip
    found = try_additions(MODEL, long, "Cm", POOL)
    assert_allclose(found["alpha^2"][2], held_out(parts, ["alpha", "de", "alpha^2"]), rtol=1e-9)


def test_terms_of_the_model_and_their_combinations_are_passed_over():
    # V stands still, so that alpha*V is alpha again.
    found = try_additions(MODEL, RECORDINGS, "Cm", POOL + Candidates(["alpha*V", "V"]))
    assert {str(term) for term in found.terms} == {"alpha^2", "alpha*de", "de^2", "de^3"}
    with pytest.raises(SelectionError, match=r"'V\*alpha' was not tried"):
        found["alpha*V"]
    with pytest.raises(SelectionError, match="in the model of Cm already"):
        try_additions(MODEL, RECORDINGS, "Cm", Candidates(["alpha", "de"]))
    with pytest.raises(SelectionError, match="explain every candidate"):
        try_additions(MODEL, RECORDINGS, "Cm", Candidates(["alpha*V", "V"]))


def test_a_term_that_one_recording_alone_moves_predicts_nothing_of_that_recording():
    # In the other three df is zero, so they give no value of its coefficient: the fourth is predicted without it.
    given = [r.with_channels(df=0.0) for r in RECORDINGS[:3]] + [RECORDINGS[3].with_channels(df=RECORDINGS[3]["Cm"])]
    found = try_additions(MODEL, given, "Cm", Candidates(["df"]))
    spread = [np.sum((r["Cm"] - r["Cm"].mean()) ** 2) for r in given]
    without = (1.0 - held_out(RECORDINGS, ["alpha", "de"])) * sum(spread)
    others = np.linalg.lstsq(columns(given[:3], ["alpha", "de"]), response(given[:3]), rcond=None)[0]
    fourth = np.sum((given[3]["Cm"] - columns(given[3:], ["alpha", "de"]) @ others) ** 2)
    assert (1.0 - found["df"][2]) * sum(spread) >= fourth * (1.0 - 1e-9)
    assert fourth < without


# --- the widget ---------------------------------------------------------------------------------


@pytest.fixture
def explorer():
    pytest.importorskip(
        "ipywidgets", reason='ipywidgets is not installed; pip install "structsel[notebooks]" installs it'
    )
    return explore_residuals(MODEL, RECORDINGS, candidates=POOL)


def test_the_explorer_opens_on_the_term_with_the_largest_gain(explorer):
    assert (explorer.response.value, explorer.channel.value, explorer.term.value) == ("Cm", "alpha", "alpha^2")
    assert bytes(explorer.figure.value).startswith(b"\x89PNG")
    r2 = explorer.additions["alpha^2"][0]
    assert f"{r2:.5g}" in explorer.effect.value


def test_constant_channels_are_not_offered(explorer):
    assert explorer.channel.options == ("alpha", "de", "Cm", "CZ")


def test_another_choice_draws_another_figure_and_describes_another_term(explorer):
    before = explorer.figure.value
    explorer.channel.value = "de"
    with_term = explorer.figure.value
    explorer.term.value = "de^3"
    assert len({before, with_term, explorer.figure.value}) == 3
    assert "de^3" in explorer.effect.value
    assert f"{explorer.additions['de^3'][2]:.5g}" in explorer.effect.value


def test_another_response_offers_its_own_terms_best_first(explorer):
    before = explorer.figure.value
    explorer.response.value = "CZ"
    assert explorer.term.value == explorer.term.options[0] == "de^2"
    assert explorer.figure.value != before
    assert "CZ: adding de^2" in explorer.effect.value


def test_a_selection_brings_its_own_pool():
    pytest.importorskip(
        "ipywidgets", reason='ipywidgets is not installed; pip install "structsel[notebooks]" installs it'
    )
    chosen = select(RECORDINGS, "Cm", POOL, max_terms=2, bootstrap=0)
    offered = {*explore_residuals(chosen, RECORDINGS).term.options, *map(str, chosen.terms)}
    assert offered == {str(term) for term in POOL}
    alone = explore_residuals(chosen, RECORDINGS[0])
    assert alone.response.options == ("Cm",)


def test_a_model_alone_is_offered_products_of_its_channels():
    pytest.importorskip(
        "ipywidgets", reason='ipywidgets is not installed; pip install "structsel[notebooks]" installs it'
    )
    bare = AeroModel({"Cm": ResponseModel(("1", "alpha", "de"), np.array([0.05, -0.5, -1.5]))})
    assert set(explore_residuals(bare, RECORDINGS).term.options) == {"alpha^2", "alpha*de", "de^2"}


def test_without_ipywidgets_it_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    with pytest.raises(StructselError, match=r'pip install "structsel\[notebooks\]"'):
        explore_residuals(MODEL, RECORDINGS)
