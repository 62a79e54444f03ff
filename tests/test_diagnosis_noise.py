"""The noise of the differences, beside effects that are in them."""

from dataclasses import replace

import numpy as np
import pytest

from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.signatures import Signature, acting, each_spectra, work_out
from structsel.effects import EFFECTS
from structsel.numerics.dynamic_elements import actuate
from tests.noisy_flights import flights_with


@pytest.fixture(scope="module")
def correct():
    flights = flights_with({})
    library = work_out(EFFECTS, flights, flights[0].responses)
    return flights, library, DiagnosisProblem.set_up(flights, library.signatures).noise


def with_more(flights, extra):
    """Flights that measure more, by response."""
    return [replace(f, measured=f.measured | {c: f.measured[c] + x for c, x in extra(f).items()}) for f in flights]


def times_too_large(noise, true, response):
    return np.exp(noise.log_std[response] - true.log_std[response])


def test_an_effect_of_the_library_is_not_counted_as_noise(correct):
    flights, library, noise = correct

    def play(f):
        return {"Cm": f.slope("Cm", "de") * (actuate(f.t, f["de"], backlash=0.01) - f["de"])}

    problem = DiagnosisProblem.set_up(with_more(flights, play), library.signatures)
    ratios = times_too_large(problem.noise, noise, "Cm")
    assert ratios.min() > 0.75
    assert ratios.max() < 1.35  # 2.2 where the columns that help are chosen by weights that do not fit yet, and kept
    without = DiagnosisProblem.set_up(with_more(flights, play), ())
    assert times_too_large(without.noise, noise, "Cm").max() > 5.0


def test_what_a_form_of_another_shape_explains_is_no_noise_once_that_is_found(correct):
    flights, library, noise = correct
    forms = [s.variant for s in library.of("slosh") if s.variant.about == "sideways"]
    form = min(forms, key=lambda v: (v.shape["damping"], abs(np.log(v.shape["frequency"] / 0.45))))
    between = form.again(1.05 * form.shape["frequency"], form.shape["damping"])

    def slosh(f):
        return {c: 0.3 * x[:, 0] for c, x in between.columns(f).items()}

    problem = DiagnosisProblem.set_up(with_more(flights, slosh), library.signatures)
    before = times_too_large(problem.noise, noise, "CY")
    spectra = next(each_spectra([between], problem.flights, problem.responses))
    found = Signature(library.of("slosh")[0].hypothesis, between, spectra, acting(spectra, problem.flights))
    after = times_too_large(problem.with_noise_without([found], library.signatures).noise, noise, "CY")
    assert before.max() > 10.0
    assert after.max() < 2.0
    assert after.min() > 0.6
