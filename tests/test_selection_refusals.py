"""select(): data and options that are refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.candidates import Candidates
from structsel.errors import ChannelError, DataError, SelectionError
from structsel.recording import Recording
from structsel.selection import select
from tests.flights import fly
from tests.selections import POOL, TRUTH, made


@pytest.fixture(scope="module")
def flights():
    return fly(TRUTH, 0.02, lengths=(2000, 1500, 1800))


def test_a_missing_channel_is_named_with_its_recording(flights):
    with pytest.raises(ChannelError, match=r"(?s)select needs channel 'df'.*flight_1"):
        select(flights, "CZ", POOL + Candidates.parse(["df"]))
    with pytest.raises(ChannelError, match=r"(?s)select needs channel 'Cm'.*flight_1"):
        select(flights, "Cm", POOL)


@pytest.mark.parametrize("channel", ["alpha", "CZ"])
def test_a_sample_that_is_not_a_number_is_named(flights, channel):
    values = flights[1][channel].copy()
    values[17] = np.nan
    bad = [flights[0], flights[1].with_channels(**{channel: values})]
    with pytest.raises(DataError, match=rf"(?s){channel}.*17") as caught:
        select(bad, "CZ", POOL)
    assert "flight_2" in str(caught.value)


def test_a_constant_response_is_refused(flights):
    flat = [r.with_channels(CZ=-0.5) for r in flights]
    with pytest.raises(DataError, match=r"'CZ' is constant \(-0.5\) in flight_1, flight_2, flight_3"):
        select(flat, "CZ", POOL)


def test_a_response_among_the_candidates_is_refused(flights):
    with pytest.raises(SelectionError, match="response 'CZ' is also a channel of the candidates"):
        select(flights, "CZ", POOL + Candidates.parse(["CZ*alpha"]))


def test_a_recording_that_is_too_short_is_named(flights):
    short = Recording("blip", [0.0, 0.02], {n: flights[0][n][:2] for n in flights[0].names})
    with pytest.raises(DataError, match=r"'blip' has 2 sample"):
        select([*flights, short], "CZ", POOL)


def test_no_recording_and_no_candidate_are_refused(flights):
    with pytest.raises(SelectionError, match="at least one recording"):
        select([], "CZ", POOL)
    with pytest.raises(SelectionError, match="the pool is empty"):
        select(flights, "CZ", Candidates())


def test_a_forced_term_outside_the_pool_is_refused(flights):
    with pytest.raises(SelectionError, match=r"to include de\^4, which is not among the 19 candidates"):
        select(flights, "CZ", POOL, include=["de^4"])


def test_more_forced_terms_than_samples_are_refused():
    short = made(lambda c: c["alpha"], n=15, n_recordings=1)
    with pytest.raises(SelectionError, match="19 terms but has 14 degrees of freedom"):
        select(short, "CZ", POOL, include=POOL.names)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"F_in": 4.0, "F_out": 5.0}, "F_out=5 is above F_in=4"),
        ({"F_in": "auto", "F_out": 50.0}, "F_out=50 is above the F_in of 1"),
        ({"F_in": -1.0}, "F_in must be above zero"),
        ({"F_in": "some"}, "give 'auto', 'fdr' or a number"),
        ({"F_out": -1.0}, "F_out must not be negative"),
        ({"method": "lasso"}, "method='lasso' is not one of 'stepwise', 'orthogonal', 'best_subset'"),
        ({"noise": "red"}, "noise='red'"),
        ({"criterion": "R2"}, "criterion='R2'"),
        ({"initial_terms": "half"}, "initial_terms='half'"),
        ({"estimate": "lasso"}, "estimate='lasso'"),
        ({"sigma_max": 0.0}, "sigma_max must be above zero"),
        ({"sigma_max": "big"}, "give 'response', 'residual' or a number"),
        ({"components": 0}, "components must be 1 or more"),
        ({"correlation_limit": 1.5}, "must lie between 0 and 1"),
        ({"bootstrap": -1}, "bootstrap must be 0 or more"),
        ({"max_terms": 0}, "max_terms must be 1 or more"),
    ],
)
def test_an_option_that_cannot_be_meant_is_refused(flights, options, message):
    with pytest.raises(SelectionError, match=message):
        select(flights[:1], "CZ", POOL, **{"bootstrap": 0, **options})


def test_leaving_out_manoeuvres_needs_something_to_leave_out():
    short = made(lambda c: c["alpha"], n=100, n_recordings=1)
    with pytest.raises(SelectionError, match="needs parts to hold out"):
        select(short, "CZ", POOL, criterion="cv", bootstrap=0)


def test_what_a_selection_returns_cannot_be_changed(flights):
    found = select(flights, "CZ", POOL, bootstrap=5)
    with pytest.raises(AttributeError):
        found.r2 = 1.0
    with pytest.raises(TypeError):
        select(flights, ["CZ"], POOL, bootstrap=0).by_response["CZ"] = None
    one = found
    for array in (one.values, one.covariance, one.textbook_errors, one.standard_errors, one.partial_F, one.vif):
        assert not array.flags.writeable


def test_collinearity_tables_equal_belsleys_formulas_and_the_parameter_correlation(flights):
    terms = ["alpha", "alpha^2", "q_hat"]
    found = select(flights, "CZ", Candidates.parse(terms), include=terms, noise="white", bootstrap=0)
    names = ["1", *map(str, found.terms)]
    columns = [np.concatenate([Candidates.parse([t]).evaluate(f)[:, 0] for f in flights]) for t in names[1:]]
    X = np.column_stack([np.ones(len(columns[0])), *columns])
    _, singular, Vt = np.linalg.svd(X / np.linalg.norm(X, axis=0))
    phi = (Vt.T / singular) ** 2
    credit = (phi / phi.sum(axis=1, keepdims=True)).T
    table = found.collinearity_frame()
    assert_allclose(table["condition_index"], singular[0] / singular, rtol=1e-7)
    assert_allclose(table[names].to_numpy(), credit, rtol=1e-6, atol=1e-9)
    correlation = found.correlation_frame()
    assert list(correlation.columns) == names
    assert_allclose(np.diag(correlation), 1.0)
