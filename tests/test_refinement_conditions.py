import numpy as np
import pytest

from structsel.errors import DataError, ModelError
from structsel.model import AeroModel, ResponseModel
from structsel.recording import Recording
from structsel.refinement import derivatives_by_condition
from structsel.simulation import Instruments, published_aircraft, simulate, trim
from tests.linear_flights import three_two_one_one

AIRCRAFT = published_aircraft("beaver").aircraft


def model(**responses):
    return AeroModel({name: ResponseModel(tuple(t), list(t.values())) for name, t in responses.items()})


TRUTH = model(
    CX={"1": -0.04, "alpha": 0.05, "alpha^2": 4.0},
    CZ={"1": -0.2, "alpha": -5.2, "q_hat": -6.0, "de": -0.4},
    Cm={"1": 0.06, "alpha": -0.55, "alpha^2": -2.0, "q_hat": -28.0, "de": -1.9},
)
"""Cm:alpha of a local model is -0.55 - 4 alpha, CX:alpha 0.05 + 8 alpha; the rest does not depend on trim."""
LOCAL = model(
    CX={"1": -0.04, "alpha": 0.5},
    CZ={"1": -0.2, "alpha": -5.0, "q_hat": -5.0, "de": -0.3},
    Cm={"1": 0.06, "alpha": -0.7, "q_hat": -25.0, "de": -1.7},
)
NOISE = {"V": 0.2, "alpha": 0.002, "q": 0.002, "theta": 0.002, "ax": 0.05, "az": 0.05, "h": 0.5}


def fly(name, V, size=0.03, seed=0):
    converged = trim(TRUTH, AIRCRAFT, V, 1000.0, free=("de", "thrust"))
    t = np.arange(0.0, 14.0, 0.05)
    de = converged.controls["de"] + three_two_one_one(t, 1.5, 0.6, size)
    flight = simulate(
        TRUTH, AIRCRAFT, {"t": t, "de": de}, start=converged, instruments=Instruments(noise=NOISE, seed=seed)
    )
    return Recording(name, flight.t, dict(flight.channels), dict(flight.units), flight.provenance)


@pytest.fixture(scope="module")
def flights():
    return [fly(f"m{k + 1}", V, seed=k) for k, V in enumerate((60.0, 38.0, 47.0))]


@pytest.fixture(scope="module")
def table(flights):
    return derivatives_by_condition(LOCAL, AIRCRAFT, flights, parameters=["CX:alpha", "Cm:alpha", "Cm:q_hat"])


def test_derivatives_follow_the_truth_over_trim_angle_of_attack(table):
    assert table.recordings == (("m1",), ("m3",), ("m2",))  # by angle of attack, not as given
    assert not table.notes
    alpha = table.conditions
    assert (np.diff(alpha) > 0.03).all()
    truth = np.stack([0.05 + 8.0 * alpha, -0.55 - 4.0 * alpha, np.full(3, -28.0)], axis=1)
    j = table.methods.index("output error")
    # The manoeuvre swings about another mean than the trim, and its curve is no line: 5 % beside the interval.
    off = np.abs(table.values[:, :, j] - truth)
    assert (off < 2.0 * table.half[:, :, j] + 0.05 * np.abs(truth)).all()
    for method in ("equation error", "two-step"):
        j = table.methods.index(method)
        assert (np.diff(table.values[:, 0, j]) > 0.2).all()
        assert (np.diff(table.values[:, 1, j]) < -0.1).all()


def test_noise_in_the_regressors_biases_damping_by_regression_and_not_by_output_error(table):
    error = np.abs(table.values[:, 2] / -28.0 - 1.0).mean(axis=0)
    assert error[table.methods.index("output error")] < 0.05
    assert error[table.methods.index("equation error")] > 0.08


def test_the_frame_has_a_row_for_each_condition_parameter_and_method(table):
    frame = table.to_frame()
    assert len(frame) == 27
    row = frame[(frame.recordings == "m2") & (frame.parameter == "Cm:alpha") & (frame.method == "output error")].iloc[0]
    assert row.low < row.value < row.high
    assert row.alpha == pytest.approx(table.conditions[2])
    text = str(table)
    assert "alpha [deg]" in text
    assert text.count("+-") == 27
    with pytest.raises(ValueError, match="read-only"):
        table.values[0, 0, 0] = 0.0


def test_ranges_take_manoeuvres_together_and_leave_others_out(flights):
    table = derivatives_by_condition(
        LOCAL,
        AIRCRAFT,
        flights,
        against="V",
        methods=["equation error"],
        edges=[30.0, 50.0, 55.0],
        parameters=["Cm:de"],
    )
    assert table.recordings == (("m2", "m3"),)
    assert table.conditions[0] == pytest.approx(42.5, abs=0.5)
    with pytest.raises(DataError, match="no manoeuvre between its edges of V"):
        derivatives_by_condition(LOCAL, AIRCRAFT, flights, against="V", edges=[10.0, 20.0])


def test_a_manoeuvre_that_shows_nothing_is_noted_and_the_rest_stands(flights):
    level = flights[2].with_channels(de=float(flights[2]["de"][0]))
    table = derivatives_by_condition(
        LOCAL, AIRCRAFT, [flights[1], level], methods=["equation error", "output error"], parameters=["Cm:de"],
        iterations=4,
    )  # fmt: skip
    lost = table.recordings.index(("m3",))
    assert "depend on each other" in table.notes[lost, "equation error"]
    assert np.isnan(table.values[lost, 0, 0])
    assert (lost, "output error") in table.notes
    kept = 1 - lost
    assert np.isfinite(table.std[kept, 0, 0])
    assert "! m3, equation error" in str(table)


def test_what_it_does_not_know_is_refused(flights):
    with pytest.raises(ModelError, match="'least squares'"):
        derivatives_by_condition(LOCAL, AIRCRAFT, flights, methods=["least squares"])
    with pytest.raises(ModelError, match="'Cm:beta'"):
        derivatives_by_condition(LOCAL, AIRCRAFT, flights, parameters=["Cm:beta"])
