"""Effects that declare their proof case: picked up by both plants, refused where they copy the effect."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lsim

from proof.generate import declared_effects, draw_case, drawable
from proof.jsbsim.added_force import delayed
from proof.polynomial.aircraft import truth_aircraft
from proof.polynomial.effects_declared import declared_effect
from proof.polynomial.flight import InjectedPhysics, settings_of, simulate_truth
from proof.polynomial.manoeuvres import DT, make_manoeuvre
from proof.polynomial.terms import AXES
from proof.scenario.declared import VARIABLES, band_noise
from structsel import effects
from structsel.comparison.preparing import prepare
from structsel.demo import demo_missing_physics
from structsel.effects import EFFECTS, BandNoise, Delayed, Effect, EffectParameter, Lag, TruthCase, Variant
from structsel.errors import DataError
from structsel.numerics.dynamic_elements import first_order_lag
from tests.proof.independence import copied_terms

BUFFET = TruthCase(
    {"Cm": {"buffet": 0.5}, "CZ": {"buffet": 1.0}}, (0.05, 20.0), ("stall", "stall", "pull-up"), ("turbulence",),
    signals={"buffet": BandNoise(2.0, 5.0, beyond="alpha", onset=0.12)},
)  # fmt: skip
WASH = TruthCase({"Cm": {"CT*de": 2.0}, "CZ": {"CT*de": 0.4}}, (0.05, 5.0), ("throttle", "throttle"))

# The wing's downwash at the tail follows the flap with a lag.
TRANSIT = TruthCase(
    {"Cm": {"df": -0.6, "at_tail": 0.6}}, (0.05, 5.0), ("flap", "flap", "flap"), ("downwash-lag",),
    signals={"at_tail": Lag("df", 0.5)},
)  # fmt: skip


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
    # The flap and the thrust move, so that effects of them are compared.
    moved = [
        r.with_channels(
            df=0.2 * np.clip((r.t - 5.0) / 2.0, 0.0, 1.0), thrust=r["thrust"] * (1.0 + 0.3 * np.sin(0.8 * r.t))
        )
        for r in case.recordings
    ]
    return prepare(case.simulated, moved, case.aircraft).flights


@pytest.mark.parametrize(
    ("name", "kind", "truth"),
    [("toy-wash", "propulsive", WASH), ("toy-buffet", "random", BUFFET), ("toy-transit", "memory", TRANSIT)],
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
    if truth is TRANSIT:
        assert sum(np.ptp(r["df"]) > 0.09 for r in case.recordings) >= 3
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
        (TruthCase({"Cm": {"a": 1.0}}, signals={"a": BandNoise(1.0, 2.0), "b": BandNoise(1.0, 2.0)}), "2 random"),
        (TruthCase({"Cm": {"a": 1.0}}, signals={c: Lag("de", 0.1) for c in "abcde"}), "and 5 lags and delays"),
        (TruthCase({"Cm": {"a": 1.0}}, signals={"a": Lag("mach", 0.1)}), "variable of a signal 'mach'"),
        (TruthCase({"Cm": {"a": 1.0}}, signals={"a": Delayed("de", 0.001)}), r"'a' .* between 0\.02 and 5\.0 s"),
        (TruthCase({"Cm": {"de": 1.0}}, signals={"de": Lag("de", 0.1)}), "signal 'de'; its name must be a word"),
        (TruthCase({"Cm": {"alpha^3*de^2": 1.0}}), "of 5 factors; 4 fit"),
        (TruthCase({"Cm": {"df": 1.0}}), "in the manoeuvre 'flap' only"),
        (TruthCase({"Cm": {"a": 1.0}}, signals={"a": BandNoise(1.0, 2.0, beyond="mach")}), "limiting variable 'mach'"),
    ],
)
def test_a_declaration_that_cannot_be_injected_is_refused(truth, says):
    with pytest.raises(DataError, match=says):
        declared_effects([a_hypothesis("toy", "static", truth)])


def test_effects_whose_channels_the_flights_lack_are_not_compared(flights):
    def columns(flight):
        return {"Cm": (flight["az_tail"] * flight["de"])[:, None]}

    lacking = a_hypothesis("toy", "actuator", TruthCase({"Cm": {"de": 3.0}}), columns)
    assert copied_terms(replace(lacking, needs=lambda flights: "channel az_tail"), flights) == []


def test_a_flap_in_the_declaration_is_compared(flights):
    truth = TruthCase({"Cm": {"df": 1.0}}, manoeuvres=("flap",))
    copy = a_hypothesis("toy", "memory", truth, lambda flight: {"Cm": flight["df"][:, None]})
    assert copied_terms(copy, flights) == ["Cm: df"]


def test_a_sum_of_terms_that_repeats_the_effects_own_form_is_refused(flights):
    def columns(flight):
        return {"Cm": (flight["de"] - first_order_lag(flight["de"], flight.dt, 0.3))[:, None]}

    for signal, copied in (
        (Lag("de", 0.3), ["Cm: the sum of its terms"]),
        (Lag("de", 0.6), []),
        (Delayed("de", 0.3), []),
    ):
        truth = TruthCase({"Cm": {"de": 1.0, "late": -1.0}}, signals={"late": signal})
        assert copied_terms(a_hypothesis("toy", "memory", truth, columns), flights) == copied


# SciPy's lag of a variable that is linear between samples, or held, is exact. CL is neither where the elevator steps:
# it is half a step late at most, 0.005 s over 0.4 s of its range.
@pytest.mark.parametrize(
    ("of", "linear", "tolerance"), [("alpha", True, 1e-4), ("df", False, 1e-4), ("CL", True, 0.0125)]
)
def test_signals_of_the_polynomial_plant_are_the_lag_and_the_delay_of_their_variable(of, linear, tolerance):
    truth = truth_aircraft("beaver")
    manoeuvre = make_manoeuvre("flap-extension", truth, 48.0, 1500.0, 25.0, np.random.default_rng(2))
    # 0.07 times the delayed signal is added to Cm: the aircraft responds to it.
    physics = InjectedPhysics([("Cm", "signal2", 0.07)], signals=((of, 0.4, 0.0), (of, 0.0, 0.25)))
    settings = settings_of(truth, [manoeuvre], 0.0)
    (flight,) = simulate_truth(truth, [manoeuvre], physics, settings, 1.0 / DT)
    x, lagged, later = (flight.variable(name) for name in (of, "signal1", "signal2"))
    assert np.ptp(x) > 0.05
    _, expected, _ = lsim(([1.0], [0.4, 1.0]), x - lagged[0], flight.t, interp=linear)
    assert_allclose(lagged, lagged[0] + expected, rtol=0, atol=tolerance * np.ptp(x))
    assert_allclose(later[25:], x[:-25], rtol=0, atol=1e-15)
    assert_allclose(flight.extras[:, AXES.index("Cm")], 0.07 * later, rtol=1e-12)


def test_a_value_is_delayed_by_steps_in_jsbsim():
    memory = {}
    assert [delayed(memory, "x", float(k), 0.01, 0.03) for k in range(7)] == [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0]


def test_what_needs_a_flap_is_drawn_of_aircraft_that_have_one():
    (flap,) = declared_effects([a_hypothesis("toy-transit", "memory", TRANSIT)])
    assert declared_effect(flap).aircraft == ("beaver",)
    assert declared_effect(flap).channels == ("df",)
    (other,) = declared_effects([a_hypothesis("toy-wash", "propulsive", WASH)])
    assert declared_effect(other).aircraft == ()


def test_an_aircraft_of_jsbsim_without_flaps_refuses_what_needs_one():
    pytest.importorskip("jsbsim")
    from proof.jsbsim.aircraft import JSBSimPlant
    from proof.jsbsim.effects import effects_of

    declared = declared_effects([a_hypothesis("toy-transit", "memory", TRANSIT)])
    assert "toy-transit" in effects_of(JSBSimPlant("c172p"), declared)
    assert "toy-transit" not in effects_of(JSBSimPlant("J3Cub"), declared)


def test_band_noise_has_unit_variance_within_its_band():
    t = 0.01 * np.arange(6000)
    x = band_noise(BandNoise(2.0, 5.0), t, np.random.default_rng(1))
    power, f = np.abs(np.fft.rfft(x)) ** 2, np.fft.rfftfreq(len(t), 0.01)
    assert_allclose(x.std(), 1.0)
    assert power[(f > 1.5) & (f < 6.5)].sum() > 0.9 * power.sum()


def test_the_variables_of_a_declaration_are_known_to_the_polynomial_plant():
    from proof.polynomial.terms import INDEX

    assert set(VARIABLES) <= set(INDEX)
