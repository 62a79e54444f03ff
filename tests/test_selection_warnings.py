"""select(): the warnings of a selection."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.candidates import Candidates
from structsel.selection import select
from tests.flights import fly
from tests.pools import ar1
from tests.selections import POOL, TERMS, TRUTH, WHITE, made, names, warnings_of


def test_well_excited_channels_with_white_noise_leave_no_warning():
    assert warnings_of(made(lambda c: c["alpha"] - 2 * c["de"] + 9 * c["q_hat"] * c["alpha"])) == ""


def test_white_and_coloured_rules_are_reported_side_by_side_where_they_disagree():
    # A lag-one correlation of 0.98 and slow channels: the white rule keeps terms that are not there.
    slow = {c: lambda _, rng: 0.1 * ar1(rng, 1500, 0.97, 0.24) for c in ("alpha", "de", "q_hat")}
    slow["gust"] = lambda _, rng: 0.1 * ar1(rng, 1500, 0.98, 0.2)
    flights = made(lambda c: c["alpha"] - c["de"] + c["gust"], noise=0.0, **slow)
    found = select(flights, "CZ", POOL, F_in="auto", bootstrap=0)
    extra = [str(t) for t in found.classical if t not in found.terms]
    assert names(found.terms) == {"alpha", "de"}
    assert len(extra) >= 2
    (stated,) = [d for d in found.doubts if d.startswith("With white residuals the search")]
    assert f"would also keep {', '.join(extra[:3])}" in stated
    white = select(flights, "CZ", POOL, F_in="auto", parsimony="none", **WHITE)
    assert white.terms == found.classical
    assert not any(d.startswith("With white residuals") for d in white.doubts)


@pytest.mark.parametrize(("lengths", "warned"), [((500,), True), ((1000,), False), ((500, 500), False)])
def test_a_single_short_recording_has_intervals_that_are_too_narrow_and_says_so(lengths, warned):
    flights = fly({"alpha": -1.0, "de": 0.4}, noise=0.02, noise_model="ar1_0.92", lengths=lengths)
    found = select(flights, "CZ", Candidates.polynomial(["alpha", "de", "q_hat"], 1), bootstrap=0)
    assert any(d.startswith("One recording of 500 samples") for d in found.doubts) is warned


def delayed(recordings, samples):
    """The same recordings with the angle of attack read this many samples late."""
    shifted = [np.concatenate([np.full(samples, r["alpha"][0]), r["alpha"][:-samples]]) for r in recordings]
    return [r.with_channels(alpha=a) for r, a in zip(recordings, shifted)]


def test_whitening_is_given_up_where_the_residual_is_misfit_and_not_noise():
    # A channel that is late leaves a residual that follows the inputs: whitening takes it for noise and predicts worse.
    flights = fly(TRUTH, 0.005, lengths=(2000, 1500, 1800))
    found = select(delayed(flights, 10), "CZ", POOL, F_in="auto", bootstrap=0)
    (said,) = [d for d in found.doubts if d.startswith("Prewhitening was dropped")]
    assert "look for delayed channels" in said
    assert found.noise_models == ()
    robust = select(delayed(flights, 10), "CZ", POOL, F_in="auto", noise="cluster", bootstrap=0)
    assert found.terms == robust.terms
    assert_allclose(found.values, robust.values, rtol=1e-12)
    assert "Whitening" not in warnings_of(flights)


def test_tests_by_blocks_hold_in_coloured_noise():
    # Ten flights with lag-one correlation 0.92; the white rule is right in none of them.
    exact = {"cluster": 0, "white": 0}
    for seed in range(10):
        flights = fly(TRUTH, 0.02, "ar1_0.92", lengths=(2000, 1500, 1800), seed=seed)
        for noise in exact:
            found = select(flights, "CZ", POOL, F_in="auto", noise=noise, bootstrap=0)
            exact[noise] += names(found.terms) == TERMS
    assert exact["cluster"] >= 8
    assert exact["white"] <= 2


def test_a_threshold_that_lets_probability_in_is_named():
    found = warnings_of(made(lambda c: c["alpha"]), F_in=4.0)
    assert "With F_in = 4 and 19 candidates about 0.8 false terms are expected" in found


def test_more_candidates_than_samples_is_said_and_the_search_goes_on():
    short = made(lambda c: 3.0 * c["alpha"], n=15, n_recordings=1, noise=0.01)
    found = select(short, "CZ", POOL, F_in="auto", bootstrap=0)
    assert "alpha" in names(found.terms)
    assert len(found.terms) < 14
    assert "15 samples for 19 candidates: many models fit equally well" in "\n".join(found.doubts)
    assert "No cross-validation" in "\n".join(found.doubts)
    assert np.isnan(found.held_out_r2)


def test_exactly_dependent_candidates_are_listed_not_fitted():
    copies = {"beta": lambda c, rng: 2.0 * c["alpha"], "da": lambda c, rng: c["de"] - c["q_hat"]}
    flights = made(lambda c: c["alpha"] + c["de"] + c["q_hat"], **copies)
    pool = Candidates.polynomial(["alpha", "beta", "de", "q_hat", "da"], 1)
    found = select(flights, "CZ", pool, F_in=12.0, bootstrap=0)
    assert len(found.terms) == 3
    assert len(found.dependent) == 2
    assert len({"alpha", "beta"} & names(found.dependent)) == 1
    assert "exactly dependent on the kept terms, so never tested" in "\n".join(found.doubts)


def test_a_channel_that_never_moves_is_listed_with_its_terms():
    flights = made(lambda c: c["alpha"], df=lambda c, rng: np.full(1500, 0.35))
    found = select(flights, "CZ", Candidates.polynomial(["alpha", "df"], 2), F_in=12.0, bootstrap=0)
    assert len(found.terms) == 1
    assert {"df", "df^2"} <= names(found.dependent)
    assert "Constant, or exactly dependent" in "\n".join(found.doubts)


def test_collinear_terms_and_a_bad_condition_are_named():
    near = {"q_hat": lambda c, rng: c["alpha"] + 1e-4 * rng.standard_normal(1500)}
    flights = made(lambda c: c["alpha"] + c["q_hat"], noise=1e-6, **near)
    pool = Candidates.polynomial(["alpha", "q_hat", "de"], 1)
    said = warnings_of(flights, pool, include=["alpha", "q_hat"])
    assert "Collinear (VIF above 10): alpha (" in said
    assert "Condition number" not in said
    # Two channels that hardly move, and move together to a thousandth: 1 / (1e-4 x 1e-3).
    still = {
        "beta": lambda c, rng: 1.0 + 1e-3 * c["alpha"],
        "da": lambda c, rng: 1.0 + 1e-3 * (c["alpha"] + 1e-3 * c["q_hat"]),
    }
    pool = Candidates.parse(["beta", "da", "de"])
    said = warnings_of(made(lambda c: c["de"], **still), pool, include=["beta", "da"])
    assert "about 7 digits of the values are correct" in said


def test_an_oscillation_the_noise_model_cannot_hold_is_named():
    flights = fly(TRUTH, 0.02, "ar2_mode_3Hz", lengths=(2000, 2000))
    assert "asks for more than AR order 1. Raise max_ar_order" in warnings_of(flights, max_ar_order=1)
    assert "Raise max_ar_order" not in warnings_of(flights)


def test_terms_that_probably_do_not_belong_in_the_model_are_named():
    # A true t value near the entry threshold: kept here, but in about half of the resamples.
    for seed in range(30):
        flights = made(lambda c: c["alpha"] + 0.062 * c["de"], seed=seed)
        found = select(flights, "CZ", POOL, F_in="auto", bootstrap=50)
        unsure = [n for n in names(found.terms) if found.probability[n] < 0.5]
        said = [d for d in found.doubts if d.startswith("More probably not")]
        assert bool(unsure) == bool(said)
        if unsure:
            assert all(n in said[0] for n in unsure)
            break
    else:
        pytest.fail("no flight of thirty kept a term with a probability below one half")


def test_one_manoeuvre_warns_that_its_held_out_parts_are_optimistic():
    flights = made(lambda c: c["alpha"])
    assert "One manoeuvre only" in warnings_of(flights[:1])
    assert "One manoeuvre only" not in warnings_of(flights)


def test_a_model_that_does_not_carry_over_to_other_flights_says_so():
    # The sign of alpha's effect differs between the flights.
    flights = made(lambda c: 0.0 * c["alpha"], noise=0.01)
    flights = [r.with_channels(CZ=r["CZ"] + s * r["alpha"]) for r, s in zip(flights, (1.0, 0.3))]
    assert "on data not used for selecting" in warnings_of(flights)
