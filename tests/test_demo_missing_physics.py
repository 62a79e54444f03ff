"""The demonstration of missing physics: what its simulation lacks is what was added, and nothing else."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel import compute_all
from structsel.demo import demo_missing_physics
from structsel.errors import DataError


def difference(case, axis):
    measured = compute_all(case.recordings, case.aircraft)
    return [r[axis] - case.simulated[r.name][axis] for r in measured], measured


def test_the_difference_near_the_ground_is_the_effect_that_was_added():
    case = demo_missing_physics("ground-effect", flights=2)
    differences, (low, high) = difference(case, "CZ")
    near = np.exp(-4.0 * low["h_agl"] / case.aircraft.b)
    assert near.max() > 0.2
    added = case.terms["CZ"]["near"] * near + case.terms["CZ"]["near*alpha"] * near * low["alpha"]
    # Errors of the simulation within its tolerances are of the size of 0.5 % of CZ.
    assert_allclose(differences[0] - added, 0.0, atol=0.02)
    assert np.abs(added).max() > 0.03
    assert np.abs(differences[1]).max() < 0.02
    assert high["h_agl"].min() > 500.0


def test_the_same_seed_gives_the_same_recordings_and_another_gives_others():
    first, again, other = (demo_missing_physics(flights=1, seed=s).recordings[0] for s in (1, 1, 2))
    assert np.array_equal(first["az"], again["az"])
    assert not np.array_equal(first["az"], other["az"])


def test_the_simulation_as_a_model_gives_the_coefficients_stated():
    case = demo_missing_physics("", flights=1)
    assert case.terms == {}
    recorded = compute_all(case.recordings, case.aircraft)[0]
    predicted = case.simulation.evaluate(recorded, outside="ignore")
    assert_allclose(predicted["CZ"], case.simulated["m01"]["CZ"], atol=0.02)


def test_an_effect_without_an_example_and_no_flights_are_refused():
    with pytest.raises(DataError, match=r"no effect 'slosh'; it has ground-effect, cross-coupling"):
        demo_missing_physics("slosh")
    with pytest.raises(DataError, match="needs one flight or more; found 0"):
        demo_missing_physics(flights=0)
