"""A JSBSim aircraft is compared at the states that it takes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel import AeroModel, compute_coefficients, demo_flights, export_model
from structsel.comparison.simulations import open_simulation

pytest.importorskip("jsbsim", reason='JSBSim is not installed; pip install "structsel[jsbsim]" installs it')


def test_a_jsbsim_aircraft_is_evaluated_at_the_angles_of_the_centre_of_gravity(tmp_path):
    # The vane is 4.5 m to the left of the centre of gravity: its angle of attack differs by p y / V.
    (flight,), aircraft, truth = demo_flights(1, turbulence=0.0)
    flight = flight.between(2.0, 4.0)
    model = AeroModel.from_terms(truth)
    path = tmp_path / "aircraft.xml"
    export_model(model, path, to="jsbsim", aircraft=aircraft)
    simulation = open_simulation(f"jsbsim:{path}", [flight], aircraft)
    found = simulation.evaluate(flight)
    at_cg = compute_coefficients(flight, aircraft)
    assert np.abs(at_cg["alpha"] - flight["alpha"]).max() > 1e-4
    for name, expected in model.evaluate(at_cg, outside="ignore").items():
        assert_allclose(found[name], expected, rtol=1e-9, atol=1e-12)
