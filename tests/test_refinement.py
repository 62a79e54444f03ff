import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.errors import DataError, ModelError, RefinementError
from structsel.numerics.linear_models import LinearSystem
from structsel.recording import Recording
from structsel.refinement import LinearStructure, compare_estimates, refine
from tests.linear_flights import AS355, fly_by_solver, helicopter, recording, three_two_one_one

T = np.arange(0.0, 25.0, 0.05)
LEVER = three_two_one_one(T, 1.0, 0.8, 1.0)
DRIFT = np.array([0.02, -0.05, 0.004, 0.001])
REFERENCE = np.array([0.01, 0.02, 0.15, -9.7, 0.05])
NOISE = np.array([0.003, 0.002, 0.05, 0.05, 0.002])
DELAY = 0.284
TRUTH = np.array([*AS355.values(), *DRIFT, *REFERENCE, DELAY])


def as355_flight(noise=NOISE, seed=1):
    y = fly_by_solver(helicopter(), T, [LEVER], delay=DELAY, drift=DRIFT, reference=REFERENCE)
    return recording("m01", T, helicopter(), [LEVER], y, noise, seed)


def wrong(seed=3, spread=0.5):
    """AS 355 with every derivative off by up to a half."""
    off = np.random.default_rng(seed).uniform(1.0 - spread, 1.0 + spread, len(AS355))
    return helicopter(**{name: value * f for (name, value), f in zip(AS355.items(), off)})


ALL_OF_IT = {"drifts": "all", "references": "all", "delay": True}


@pytest.mark.parametrize("cost", ["ml", "weighted"])
def test_23_parameters_of_the_as355_come_back_delay_included(cost):
    found = refine(wrong(), None, as355_flight(), cost=cost, **ALL_OF_IT)
    assert found.converged
    assert len(found.names) == 23
    white = np.sqrt(np.diag(found.crlb))
    assert np.abs((found.values - TRUTH) / white).max() < 3.5  # the largest of 23, two-sided odds about 1 in 100
    assert found["delay"].value == pytest.approx(DELAY, abs=0.01)
    if cost == "ml":
        assert_allclose(list(found.noise_std.values()), NOISE, rtol=0.12)  # 500 samples: 3.2 % each


def test_without_noise_the_23_parameters_come_back_to_the_solvers_accuracy():
    found = refine(wrong(), None, as355_flight(noise=None), **ALL_OF_IT)
    assert_allclose(found.values, TRUTH, rtol=2e-4, atol=2e-5)


@pytest.mark.default_cases("ml")
@pytest.mark.parametrize("cost", ["ml", "weighted"])
def test_evolution_then_descent_finds_the_as355_from_signs_and_rough_sizes(cost):
    # Sizes within a factor of three, signs from physics, as [A10] has them; from here descent alone ends elsewhere.
    rng = np.random.default_rng(11)
    start = helicopter(**{n: v * 3.0 ** rng.uniform(-1, 1) for n, v in AS355.items()})
    limits = {n: tuple(sorted((0.0, 4.0 * v))) for n, v in start.parameters.items()}
    with pytest.raises(RefinementError):
        refine(start, None, as355_flight(), cost=cost, bounds=limits, **ALL_OF_IT)
    stages = []
    found = refine(
        start, None, as355_flight(), cost=cost, bounds=limits, search="global", seed=1, **ALL_OF_IT,
        progress=lambda stage, count, value: stages.append(stage),
    )  # fmt: skip
    assert found.converged
    assert np.abs((found.values - TRUTH) / np.sqrt(np.diag(found.crlb))).max() < 3.5
    assert stages[0] == "evolution"
    assert stages[-1] == "descent"


def test_two_recordings_have_common_derivatives_and_their_own_starts_and_biases():
    structure = helicopter()
    short = T[:240]
    starts = np.array([[0.5, -0.2, 0.02, 0.03], [-0.4, 0.3, -0.01, 0.0]])
    flights = []
    for k, start in enumerate(starts):
        lever = three_two_one_one(short, 0.5 + k, 0.7, 1.0 - 2.0 * k)
        y = fly_by_solver(structure, short, [lever], start=start)
        y[:, 3] += (0.3, -0.2)[k]
        flights.append(recording(f"m0{k + 1}", short, structure, [lever], y, NOISE, 20 + k))
    found = refine(wrong(spread=0.3), None, flights, starts="all", biases=["az"])
    assert found.converged
    truth = {**AS355, "bias:m01:az": 0.3, "bias:m02:az": -0.2}
    for k in range(2):
        truth |= {f"start:m0{k + 1}:{s}": v for s, v in zip(structure.states, starts[k])}
    assert set(found.names) == set(truth)
    z = [(found[n].value - v) / found[n].std_white for n, v in truth.items()]
    assert np.abs(z).max() < 3.6
    assert [f.recording for f in found.fits] == ["m01"] * 5 + ["m02"] * 5
    assert found.simulated[1].name == "m02"
    assert_allclose(found.residuals["m02"]["q"], flights[1]["q"] - found.simulated[1]["q"], atol=1e-12)


def pitch(**values):
    """Short period alone: w and q, one useless parameter if requested."""
    system = LinearSystem.of(
        ("w", "q"), ("de",), np.array([[-1.34, 105.0], [-0.048, -1.67]]), np.array([[-21.8], [-19.5]])
    )
    return LinearStructure.from_entries(
        system, {"zw": ("A", 0, 0), "mw": ("A", 1, 0), "mq": ("A", 1, 1), "zde": ("B", 0, 0), "mde": ("B", 1, 0)}
    ).replace(values)


CLOCK = np.arange(0.0, 10.0, 0.05)


def pitch_flight(elevator, seed=1, noise=(0.3, 0.005)):
    y = fly_by_solver(pitch(), CLOCK, [elevator])
    return recording("m01", CLOCK, pitch(), [elevator], y, np.array(noise), seed)


def test_gaps_in_an_output_are_passed_over():
    flight = pitch_flight(three_two_one_one(CLOCK, 0.5, 0.4, 0.02))
    gone = flight["w"].copy()
    gone[50:90] = np.nan
    found = refine(pitch(mw=-0.02, mq=-1.0), None, flight.with_channels(w=gone))
    assert found.converged
    assert found.fits[0].n == len(CLOCK) - 40
    assert found["mw"].value == pytest.approx(-0.048, abs=4.0 * found["mw"].std_white)


def test_bounds_hold_and_have_a_warning():
    found = refine(pitch(), None, pitch_flight(three_two_one_one(CLOCK, 0.5, 0.4, 0.02)), bounds={"mq": (-1.5, 0.0)})
    assert found["mq"].value == -1.5
    assert found["mq"].at_bound
    assert any("at a bound" in warning and "mq" in warning for warning in found.doubts)
    assert "at its bound" in str(found)


def test_an_input_that_moves_nothing_names_what_it_leaves_open():
    flight = pitch_flight(np.zeros(len(CLOCK)))
    with pytest.raises(RefinementError, match="cannot determine zw, mw, mq, zde, mde") as caught:
        refine(pitch(), None, flight)
    assert caught.value.partial.names == ("zw", "mw", "mq", "zde", "mde")
    assert np.isinf(caught.value.partial.std).all()


def test_undetermined_parameters_are_named_and_the_rest_is_in_the_partial_result():
    system = LinearSystem.of(
        ("w", "q"), ("de", "df"), np.array([[-1.34, 105.0], [-0.048, -1.67]]), np.array([[-21.8, -5.0], [-19.5, 1.0]])
    )
    structure = LinearStructure.from_entries(system, {"mq": ("A", 1, 1), "mde": ("B", 1, 0), "mdf": ("B", 1, 1)})
    flight = pitch_flight(three_two_one_one(CLOCK, 0.5, 0.4, 0.02)).with_channels(df=0.0)
    with pytest.raises(RefinementError, match="cannot determine mdf from m01") as caught:
        refine(structure, None, flight)
    assert caught.value.partial["mde"].value == pytest.approx(-19.5, abs=0.2)


def test_a_delay_longer_than_the_recording_is_refused():
    flight = pitch_flight(three_two_one_one(CLOCK, 0.5, 0.4, 0.02))
    with pytest.raises(DataError, match=r"delay the inputs by up to 12 s; 'm01' lasts 9\.95 s"):
        refine(pitch(), None, flight, delay=True, bounds={"delay": (0.0, 12.0)})
    with pytest.raises(ModelError, match="cannot act before"):
        refine(pitch(), None, flight, delay=True, bounds={"delay": (-1.0, 1.0)})


def test_a_start_unstable_enough_to_overflow_is_refused_with_a_remedy():
    flight = pitch_flight(three_two_one_one(CLOCK, 0.5, 0.4, 0.02))
    with pytest.raises(RefinementError, match=r"(?s)no finite outputs.*grows by.*search='global'") as caught:
        refine(pitch(mw=48.0), None, flight)
    assert not caught.value.partial.converged
    found = refine(
        pitch(mw=48.0), None, flight, search="global", constraint="stable",
        bounds={"mw": (-1.0, 1.0), "zw": (-4.0, 0.0)}, generations=60,
    )  # fmt: skip
    assert found["mw"].value == pytest.approx(-0.048, abs=4.0 * found["mw"].std_white)


def test_an_aircraft_unstable_in_open_loop_is_fitted_where_it_was_simulated():
    structure = pitch(mw=0.01)  # diverges at about 0.4 per second: forty-fold in the record
    lever = three_two_one_one(CLOCK, 0.5, 0.3, 0.002)
    y = fly_by_solver(structure, CLOCK, [lever])
    flight = recording("m01", CLOCK, structure, [lever], y, np.array([0.3, 0.005]), 4)
    found = refine(pitch(mw=0.005), None, flight)
    assert found.converged
    assert found["mw"].value == pytest.approx(0.01, abs=4.0 * found["mw"].std_white)


def test_a_search_cut_short_says_so_and_carries_its_best():
    found = refine(wrong(), None, as355_flight(), iterations=2, **ALL_OF_IT)
    assert not found.converged
    assert "NOT CONVERGED" in str(found)
    assert "not converged after 2 steps" in found.doubts[0]
    assert found.costs[-1] < found.costs[0]
    assert len(found.history()) == 3


def test_estimates_that_move_together_are_named():
    found = refine(wrong(), None, as355_flight(), **ALL_OF_IT)
    assert any("Xu and Xq are correlated: -0.9" in warning for warning in found.doubts)


def test_the_report_the_tables_and_a_pickle_hold_the_result():
    found = refine(pitch(mq=-1.0), None, pitch_flight(three_two_one_one(CLOCK, 0.5, 0.4, 0.02)))
    assert str(found).splitlines()[0] == "Refinement: not validated (no recordings were held out)"
    assert str(found).splitlines()[2].endswith(", converged")
    frame = found.to_frame().set_index("name")
    assert frame.loc["mq", "value"] == found["mq"].value
    assert found.to_dict()["parameters"][0]["name"] == "zw"
    again = pickle.loads(pickle.dumps(found.estimates))
    assert again == found.estimates
    with pytest.raises(ValueError, match="read-only"):
        found.residuals["m01"]["q"][0] = 0.0


def test_wrong_names_and_clocks_are_refused():
    flight = pitch_flight(three_two_one_one(CLOCK, 0.5, 0.4, 0.02))
    with pytest.raises(ModelError, match=r"parameter 'mqq'.*Did you mean 'mq'"):
        refine(pitch(), None, flight, free=["mqq"])
    with pytest.raises(ModelError, match="bounds of 'start:m01:w'"):
        refine(pitch(), None, flight, bounds={"start:m01:w": (0.0, 1.0)})
    with pytest.raises(ModelError, match="bias of output 'alpha'"):
        refine(pitch(), None, flight, biases=["alpha"])
    with pytest.raises(ModelError, match="nothing to estimate"):
        refine(pitch(), None, flight, free=[])
    uneven = Recording("m02", np.append(flight.t[:-1], 12.0), dict(flight.channels))
    with pytest.raises(DataError, match="'m02' has one of"):
        refine(pitch(), None, uneven)
    with pytest.raises(TypeError, match="its model is of type int"):
        refine(3, None, flight)


def test_entries_must_lie_in_their_matrix_and_agree_where_they_repeat():
    system = LinearSystem.of(("w", "q"), ("de",), np.array([[-1.34, 105.0], [-0.048, -1.67]]), np.zeros((2, 1)))
    with pytest.raises(ModelError, match=r"entry \(2, 0\) of A"):
        LinearStructure.from_entries(system, {"x": ("A", 2, 0)})
    with pytest.raises(ModelError, match="different values"):
        LinearStructure.from_entries(system, {"x": [("A", 0, 0), ("A", 1, 1)]})


def test_methods_stand_side_by_side_with_intervals():
    # Output error, and equation error on noisy channels, which is biased.
    flight = pitch_flight(three_two_one_one(CLOCK, 0.5, 0.4, 0.02), noise=(0.6, 0.01))
    found = refine(pitch(), None, flight)
    q_dot = np.gradient(flight["q"], flight.dt)
    X = np.column_stack([flight["w"], flight["q"], flight["de"]])
    theta, rss, *_ = np.linalg.lstsq(X, q_dot, rcond=None)
    std = np.sqrt(np.diag(np.linalg.inv(X.T @ X)) * rss[0] / (len(q_dot) - 3))
    regression = dict(zip(("mw", "mq", "mde"), zip(theta, std)))
    table = compare_estimates(
        {"equation error": regression, "output error": found}, truth={"mw": -0.048, "mq": -1.67, "mde": -19.5}
    )
    assert table.parameters == ("mw", "mq", "mde", "zw", "zde")
    assert np.isnan(table.values[3, 0])
    i = table.parameters.index("mde")
    assert abs(table.values[i, 1] + 19.5) < abs(table.values[i, 0] + 19.5)
    low, high = table.intervals[i, 1]
    assert low < -19.5 < high
    frame = table.to_frame()
    assert len(frame) == 10
    text = str(table)
    assert "equation error" in text
    assert "truth" in text
    assert "intervals of 95 %" in text
    with pytest.raises(ModelError, match="needs estimates"):
        compare_estimates({})


def test_old_names_work_and_warn():
    with pytest.warns(DeprecationWarning, match="use EstimateComparison instead"):
        from structsel import Comparison
    assert isinstance(compare_estimates({"one": {"a": (1.0, 0.1)}}), Comparison)
    with pytest.warns(DeprecationWarning, match="use delayed instead"):
        structure = pitch().replace({}, late=("de",))
    with pytest.warns(DeprecationWarning, match="use delayed instead"):
        assert structure.late == structure.delayed == ("de",)
