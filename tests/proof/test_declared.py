"""Effects that declare their proof case: picked up by both plants, refused where they copy the effect."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from proof.generate import declared_effects, draw_case, drawable
from proof.scenario.declared import VARIABLES, band_noise
from structsel import effects
from structsel.comparison.preparing import prepare
from structsel.demo import demo_missing_physics
from structsel.effects import EFFECTS, BandNoise, Effect, EffectParameter, TruthCase, Variant
from structsel.errors import DataError
from tests.proof.independence import copied_terms

BUFFET = TruthCase(
    {"Cm": {"buffet": 0.5}, "CZ": {"buffet": 1.0}}, (0.05, 20.0), ("stall", "stall", "pull-up"), ("turbulence",),
    signals={"buffet": BandNoise(2.0, 5.0, beyond="alpha", onset=0.12)},
)  # fmt: skip
WASH = TruthCase({"Cm": {"CT*de": 2.0}, "CZ": {"CT*de": 0.4}}, (0.05, 5.0), ("throttle", "throttle"))


def a_hypothesis(effect, kind, truth, columns=None):
    """Toy effect from outside the package, of one parameter in Cm."""
    made = columns or (lambda flight: {"Cm": flight["de"][:, None]})
    variant = Variant((EffectParameter("size", "-", 1.0),), made)
    return Effect(effect, kind, effect, lambda flights: "", lambda flights: [variant], lambda found: effect + ".",
                      truth=truth)  # fmt: skip


@pytest.fixture
def library(monkeypatch):
    def extend(*more):
        monkeypatch.setattr(effects, "EFFECTS", (*EFFECTS, *more))

    return extend


@pytest.fixture(scope="module")
def flights():
    case = demo_missing_physics("", flights=2)
    return prepare(case.simulated, case.recordings, case.aircraft).flights


@pytest.mark.parametrize(
    ("name", "kind", "truth"), [("toy-wash", "propulsive", WASH), ("toy-buffet", "random", BUFFET)]
)
@pytest.mark.parametrize("source", ["polynomial", pytest.param("jsbsim", marks=pytest.mark.slow)])
def test_a_declared_effect_is_drawn_in_either_plant(source, name, kind, truth, library):
    if source == "jsbsim":
        pytest.importorskip("jsbsim")
    library(a_hypothesis(name, kind, truth))
    assert name in drawable(source)
    case = draw_case(7, source=source, effect=name, family="single")
    (key,) = case.key.effects
    assert (key.effect, key.kinds, key.tie) == (name, (kind,), truth.ties)
    assert set(key.axes) <= set(truth.terms)
    assert max(case.key.attainable.values()) > 0.05
    again = draw_case(7, source=source, effect=name, family="single")
    assert all(np.array_equal(a["az"], b["az"]) for a, b in zip(case.recordings, again.recordings))


def test_what_a_declared_term_adds_is_its_formula(library):
    library(a_hypothesis("toy-wash", "propulsive", WASH))
    case = draw_case(7, effect="toy-wash")
    size = case.key.effects[0].parameters["Cm:CT*de"]
    added = np.concatenate([x[:, 4] for x in case.contribution])
    formula = np.concatenate(
        [r["thrust"] / (r["qbar"] * case.aircraft.S) * r["de"] for r in case.recordings]
    )  # fmt: skip
    assert_allclose(np.polyfit(formula, added, 1)[0], size, rtol=0.05)


def test_the_librarys_own_declarations_are_read_and_are_no_copies_of_the_effects(flights):
    declared_effects()  # refuses what neither plant can take
    assert {h.name: copied_terms(h, flights) for h in EFFECTS if copied_terms(h, flights)} == {}


def test_a_case_that_repeats_the_effects_own_form_is_refused_but_for_plain_terms(flights):
    truth = TruthCase({"Cm": {"de": 3.0, "alpha*de": 1.0}})
    copy = a_hypothesis("toy", "actuator", truth)
    assert copied_terms(copy, flights) == ["Cm: de"]
    assert copied_terms(replace(copy, kind="parameter"), flights) == []
    assert copied_terms(replace(copy, truth=None), flights) == []
    assert copied_terms(a_hypothesis("toy", "actuator", BUFFET), flights) == []


@pytest.mark.parametrize(
    ("truth", "says"),
    [
        (TruthCase({"CL": {"alpha": 1.0}}), "coefficient 'CL'"),
        (TruthCase({"Cm": {"tanh(alpha)": 1.0}}), r"formula 'tanh\(alpha\)', which is no product"),
        (TruthCase({"Cm": {"alpha^0.5": 1.0}}), "no product of powers"),
        (TruthCase({"Cm": {"alpha": 1.0}}, manoeuvres=("loop",)), "manoeuvre 'loop'"),
        (TruthCase({"Cm": {"a": 1.0}}, signals={"a": BandNoise(1.0, 2.0), "b": BandNoise(1.0, 2.0)}), "has 2 signals"),
        (TruthCase({"Cm": {"a": 1.0}}, signals={"a": BandNoise(1.0, 2.0, beyond="mach")}), "limiting variable 'mach'"),
    ],
)
def test_a_declaration_that_cannot_be_injected_is_refused(truth, says):
    with pytest.raises(DataError, match=says):
        declared_effects([a_hypothesis("toy", "static", truth)])


def test_band_noise_has_unit_variance_within_its_band():
    t = 0.01 * np.arange(6000)
    x = band_noise(BandNoise(2.0, 5.0), t, np.random.default_rng(1))
    power, f = np.abs(np.fft.rfft(x)) ** 2, np.fft.rfftfreq(len(t), 0.01)
    assert_allclose(x.std(), 1.0)
    assert power[(f > 1.5) & (f < 6.5)].sum() > 0.9 * power.sum()


def test_the_variables_of_a_declaration_are_known_to_the_polynomial_plant():
    from proof.polynomial.terms import INDEX

    assert set(VARIABLES) <= set(INDEX)
