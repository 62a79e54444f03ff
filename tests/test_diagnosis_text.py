"""The text report of a diagnosis: all results, on at most one screen."""

import math
from dataclasses import replace

import pytest

from structsel.diagnosis.result import ToleranceDeviation
from structsel.diagnosis.text_report import no_model, text_report
from structsel.effects import EFFECTS
from structsel.effects.base import ParameterEstimate
from structsel.formatting import as_sentence, format_estimate, format_probabilities, format_probability, format_range
from structsel.report import render
from tests.diagnoses import GROUND, NAMES, TURBULENCE, VANE, diagnosis, fits


def flat(text):
    """The text report without its line breaks."""
    return " ".join(text.split())


def test_the_first_line_is_the_verdict_and_names_the_effect_with_its_probability():
    assert text_report(diagnosis()).splitlines()[0] == "MISMATCH: the simulation leaves out ground-effect (94 %)."


def test_a_finding_says_what_where_how_much_and_what_it_buys():
    stated = flat(text_report(diagnosis()))
    assert "Within one span of the ground lift grows by 0.10 +- 0.004 at touch-down" in stated
    assert "h_agl 1.5 to 5.4 m" in stated
    assert "m03 12.5-19.0 and 24.0-24.5 s" in stated
    assert "lift -0.100 +- 0.004, height 5.0 +- 0.3 m" in stated
    assert "90 % of the mismatch in CZ and CX; a regression on all channels 93 %" in stated
    assert "configuration-change 5 %" in stated


def test_the_three_bars_are_side_by_side_for_each_response_of_the_effect():
    rows = [line.split() for line in text_report(diagnosis()).splitlines()]
    assert ["CZ", "0.220", "0.210", "0.080"] in rows
    assert ["CX", "0.310", "0.300", "0.190"] in rows


def test_a_tie_is_stated_in_the_first_line_with_what_would_separate():
    stated = flat(text_report(diagnosis(GROUND, VANE)))
    assert "ground-effect (94 %) and sensor-scale or wrong-derivative (together 93 %)" in stated
    # 52 % and 41 % are one finding to these recordings.
    assert "wrong-derivative explains as much (together 93 %, neither 7 %)" in stated
    assert "A second source of flow angle" in stated
    assert "10 % is more than a vane on a boom usually has" in stated


def test_the_text_states_when_none_of_the_effects_may_be_right():
    stated = flat(text_report(diagnosis(replace(GROUND, ambiguous_with=("unknown",)))))
    assert "ground-effect or something unknown (together 94 %)" in stated
    assert "something unknown explains as much" in stated


def test_what_was_not_tested_is_grouped_by_what_it_needs():
    stated = flat(text_report(diagnosis()))
    assert "stall-hysteresis, static-stall (needs angle of attack above 10 deg)" in stated
    assert "engine-gyroscopic (needs channel rpm)" in stated


def test_only_tolerances_deviating_beyond_one_sigma_are_stated():
    stated = flat(text_report(diagnosis()))
    assert "CZ: alpha +2.3 sigma (+12 %)" in stated
    assert "turned" not in stated
    assert "no tolerance beyond one sigma" in flat(
        text_report(diagnosis(deviations=(ToleranceDeviation("mass", 0.4, 0.004, 0.01, "relative"),)))
    )


def test_a_consistent_simulation_gets_its_verdict_and_what_would_have_shown():
    stated = flat(text_report(diagnosis(verdict="consistent")))
    assert stated.startswith("CONSISTENT: recordings and simulation agree within the stated tolerances.")
    assert "1 of 2 effects would be named here at 5 %" in stated
    assert "icing from 35 %" in stated


def test_agreement_with_a_tolerance_exceeded_is_not_reported_as_within_tolerances():
    deviations = (ToleranceDeviation("thrust", -8.0, -0.24, 0.01, "relative"),)
    stated = flat(text_report(diagnosis(verdict="consistent", deviations=deviations)))
    assert stated.startswith("CONSISTENT, but not within the stated tolerances")
    assert "'thrust' deviates by -8.0 stated standard deviations." in stated


def test_turbulence_is_stated_with_a_consistent_verdict_and_is_no_missing_effect():
    first = text_report(diagnosis(TURBULENCE, verdict="consistent")).split("\n\n")[0]
    assert first.startswith("CONSISTENT")
    assert "There was also turbulence." in flat(first)
    assert "leaves out" not in first


def test_an_unknown_effect_gets_no_name():
    nameless = replace(GROUND, physics=(replace(GROUND.physics[0], effect="unknown"),))
    assert "no effect in the library explains" in flat(text_report(diagnosis(nameless)))
    assert "of all explained" not in flat(text_report(diagnosis(replace(nameless, fraction=0.0))))
    first_paragraph = flat(text_report(diagnosis(VANE, nameless)).split("\n\n")[0])
    assert "leaves out sensor-scale or wrong-derivative" in first_paragraph
    assert "Something else is missing" in first_paragraph


def test_an_undecidable_case_says_why_at_once():
    lines = text_report(
        diagnosis(verdict="undecidable", remarks=("one manoeuvre only",), recordings=("m01",))
    ).splitlines()
    assert lines[0].startswith("UNDECIDABLE")
    assert "- one manoeuvre only" in lines[:5]
    assert sum("one manoeuvre only" in line for line in lines) == 1


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({}, ""),
        ({"model": None, "responses": ("thrust",)}, "thrust is none"),
        ({"model": None, "verdict": "consistent", "findings": ()}, "there is no effect to add"),
        ({"model": None}, "could not be written as terms"),
    ],
)
def test_a_missing_model_is_explained(changes, says):
    made = replace(diagnosis(), **changes)
    assert says in no_model(made)
    assert bool(no_model(made)) == (made.model is None) == ("no model" in text_report(made))


def test_the_text_fits_on_a_screen_and_four_findings_with_everything_on_two():
    many = {f"effect-{k}": f"something of the kind {k} that these recordings do not hold" for k in range(30)}
    far = {name: [(float(k), k + 0.5) for k in range(12)] for name in NAMES}
    bars = {c: fits(0.4, 0.3, 0.2) for c in ("CX", "CY", "CZ", "Cl", "Cm", "Cn")}
    wide = replace(VANE, axes=tuple(bars), bars=bars, intervals=far)
    stated = text_report(diagnosis(wide, wide, wide, wide, not_testable=many, remarks=("a remark",) * 9)).splitlines()
    assert len(stated) <= 70
    assert len(text_report(diagnosis(GROUND, VANE)).splitlines()) <= 45
    assert max(map(len, stated)) <= 80
    assert len(text_report(diagnosis()).splitlines()) <= 30


def test_the_printed_probabilities_add_up_to_100_percent():
    for first, second in ((0.524, 0.414), (0.335, 0.325), (0.505, 0.295), (0.725, 0.125)):
        (a, b), rest = format_probabilities([first, second])
        assert sum(int(text.removesuffix(" %")) for text in (a, b, rest)) == 100
    # 74 % and nothing else that is known: the other 26 % are printed.
    alone = replace(GROUND, physics=(replace(GROUND.physics[0], probability=0.74),))
    assert "another effect, or none 26 %" in text_report(diagnosis(alone))


def test_a_tie_is_the_sum_of_its_printed_probabilities():
    # 0.524 and 0.414 are printed as 52 and 41 %; their sum is 0.938.
    first, second, *others = VANE.physics
    tie = replace(VANE, physics=(replace(first, probability=0.524), replace(second, probability=0.414), *others))
    stated = " ".join(text_report(diagnosis(tie)).split())
    assert "(together 93 %, neither 7 %)" in stated
    assert "together 94 %" not in stated


def test_turbulence_that_explains_nothing_has_no_number():
    gusts = replace(TURBULENCE, fraction=0.0)
    stated = text_report(diagnosis(GROUND, gusts))
    assert "2. turbulence" not in stated
    assert "turbulence " + gusts.physics[0].says.split()[0] in " ".join(stated.split())
    assert "2. turbulence" in text_report(diagnosis(GROUND, replace(gusts, fraction=0.02)))


def test_figures_that_are_not_known_are_left_out_rather_than_printed():
    unknown = replace(GROUND, explainable=math.nan, explained=math.nan, fraction=math.nan)
    assert "nan" not in text_report(diagnosis(unknown))
    assert "nan" not in format_estimate(0.25, math.nan, "s")


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (ParameterEstimate(0.3114, 0.0412, "s"), "0.31 +- 0.04 s"),
        (ParameterEstimate(0.3114, 0.0123, "s"), "0.311 +- 0.012 s"),
        (ParameterEstimate(math.radians(11.52), math.radians(0.31), "rad"), "11.5 +- 0.3 deg"),
        (ParameterEstimate(0.05, 0.007, "relative"), "5.0 +- 0.7 %"),
        (ParameterEstimate(-812.0, 45.0, "N"), "-812 +- 45 N"),
        (ParameterEstimate(2.0e-5, 3.0e-6, "-"), "2e-5 +- 3e-6"),
        (ParameterEstimate(0.5, 0.0, "m"), "0.5 m"),
        (ParameterEstimate(-4.02, 0.3, "1/rad"), "-4.0 +- 0.3 1/rad"),
    ],
)
def test_an_estimate_has_the_digits_it_is_known_to_and_angles_are_in_degrees(estimate, text):
    assert format_estimate(estimate.value, estimate.std, estimate.unit) == text


def test_a_number_that_rounds_to_zero_has_no_minus_sign():
    assert format_estimate(-0.0005, 0.07) == "0.00 +- 0.07"
    small = diagnosis(deviations=(ToleranceDeviation("mass", -0.02, -0.0002, 0.01, "relative"),))
    assert "mass: +0.0 standard deviations" in render(small)


def test_what_to_check_and_to_fly_is_a_sentence_whatever_the_effect():
    for effect in EFFECTS:
        for text in (as_sentence(effect.separated_by), as_sentence(effect.check)):
            assert not text or (text[0].upper() == text[0] and text[-1] in ".?!")
            assert ".." not in text


def test_a_region_is_in_the_units_people_read_and_may_be_open():
    assert format_range("alpha", (math.radians(11.0), math.radians(20.0))) == "alpha 11 to 20 deg"
    assert format_range("h_agl", (-math.inf, 5.4)) == "h_agl below 5.4 m"
    assert format_range("V", (60.0, math.inf)) == "V above 60 m/s"


@pytest.mark.parametrize(("p", "text"), [(0.94, "94 %"), (0.9999, "> 99 %"), (0.003, "< 1 %")])
def test_no_probability_is_called_certain(p, text):
    assert format_probability(p) == text


def test_str_of_a_diagnosis_is_its_text():
    assert str(diagnosis()) == text_report(diagnosis())
