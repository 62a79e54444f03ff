"""Filter error on a published lateral record in turbulence; the same flight without it is the reference."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel import Recording, refine
from structsel.refinement import LinearStructure

RECORD = Path(__file__).parents[2] / "shared" / "data" / "jategaonkar-sim" / "y13aus_da1.asc"
pytestmark = pytest.mark.skipif(not RECORD.exists(), reason="the record of [J15] is not ours to ship")
ROLL = {"Lp": -6.7, "Lr": 1.83, "Lda": -18.3, "Ldr": 0.43, "Lv": -0.114, "L0": 0.0}
YAW = {"Np": -0.906, "Nr": -0.665, "Nda": -0.66, "Ndr": -2.82, "Nv": 0.0069, "N0": 0.0}
SIDE = {"Yp": -0.64, "Yr": 1.30, "Yda": -1.40, "Ydr": 2.79, "Yv": -0.193, "Y0": 0.0}
START = {**ROLL, **YAW, **SIDE}  # start values of the book
OUTPUTS = ("p_dot", "r_dot", "ay", "p", "r")


def flight(columns, inputs):
    """Recording of outputs and inputs, columns counted from one."""
    data = np.loadtxt(RECORD)
    channels = dict(zip(OUTPUTS, data[:, np.array(columns) - 1].T))
    channels |= dict(zip(("da", "dr", "v"), data[:, np.array(inputs) - 1].T))
    return Recording("lateral", np.round(data[:, 0] - data[0, 0], 6), channels)


def build(s):
    """Matrices of x = [p, r] with the lateral velocity as an input."""
    zero, one = np.zeros(len(s["Lp"])), np.ones(len(s["Lp"]))

    def rows(*names):
        return np.array([[s.get(n, one if n == "1" else zero) for n in row.split()] for row in names]).transpose(
            2, 0, 1
        )

    return {
        "A": rows("Lp Lr", "Np Nr"), "B": rows("Lda Ldr Lv", "Nda Ndr Nv"),
        "C": rows("Lp Lr", "Np Nr", "Yp Yr", "1 0", "0 1"),
        "D": rows("Lda Ldr Lv", "Nda Ndr Nv", "Yda Ydr Yv", "0 0 0", "0 0 0"),
        "drift": rows("L0 N0")[:, 0], "reference": rows("L0 N0 Y0 0 0")[:, 0],
    }  # fmt: skip


@pytest.fixture(scope="module")
def model():
    return LinearStructure(("p", "r"), ("da", "dr", "v"), OUTPUTS, START, build, name="lateral")


@pytest.fixture(scope="module")
def in_turbulence():
    return flight([12, 13, 14, 15, 16], [17, 18, 19])


@pytest.fixture(scope="module")
def reference():
    """Least squares on the flight without turbulence."""
    calm = flight([2, 3, 4, 5, 6], [7, 8, 9])
    X = np.column_stack([*(calm[name] for name in ("p", "r", "da", "dr", "v")), np.ones(len(calm))])
    found = [np.linalg.lstsq(X, calm[name], rcond=None)[0] for name in ("p_dot", "r_dot", "ay")]
    return dict(zip(START, np.concatenate(found)))


def test_filter_error_finds_the_derivatives_in_turbulence_within_their_errors(model, in_turbulence, reference):
    found = refine(model, None, in_turbulence, noise="process", starts="all")
    assert found.converged
    z = np.array([(found[name].value - value) / found[name].std for name, value in reference.items()])
    # 18 estimates: the mean square of standard normal deviations has a standard deviation of a third.
    assert np.abs(z).max() < 3.0
    assert np.mean(z**2) < 2.0
    # The record contains p and r without noise: the filter may take them as they were read, and states it.
    assert any("takes p from the measurements" in doubt for doubt in found.doubts)


def test_output_error_in_turbulence_does_not_converge_and_its_verdict_is_open(model, in_turbulence, reference):
    found = refine(model, None, in_turbulence, starts="all")
    assert not found.converged
    assert found.verdict == "not validated"
    assert abs(found["Lda"].value / reference["Lda"]) < 0.1  # the roll due to the aileron is lost in the turbulence


def test_in_calm_air_output_error_agrees_with_regression(model, reference):
    found = refine(model, None, flight([2, 3, 4, 5, 6], [7, 8, 9]), starts="all")
    assert found.converged
    assert_allclose([(found[n].value - v) / found[n].std for n, v in reference.items()], 0.0, atol=3.0)
