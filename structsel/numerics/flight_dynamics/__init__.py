"""Compiled flight: the rigid aircraft with six degrees of freedom, many parameter sets at once.

Arrays in, arrays out. A `FlightPlan` holds what the aircraft is (the aerodynamic terms as a `Program`, mass,
inertia, thrust line), a `Flight` what one manoeuvre does to it (clock, controls, gusts, start), and::

    fly_batch(plan, flight, theta, index, observed, *, substeps=1) -> Batch

    theta     (m, k) array      one row per parameter set
    index     (k,) int array    which entry of the full parameter vector each column of theta replaces
    observed  (c,) int array    which columns of `OUTPUTS` are wanted, see `outputs_index`
    Batch.outputs  (m, n, c) C-contiguous, NaN from where a set blew up
    Batch.flown    (m,) int     samples that hold; n where the whole flight does
    Batch.reason   (m,) int     `REASONS` by number, 0 where nothing went wrong

The full parameter vector (`FlightPlan.parameters(flight)`, names by `FlightPlan.parameter_names`)::

    term values, response by response                 "Cm:alpha"
    the 12 states at the start, of `STATES`           "start:u", ... "start:h"
    what is added to their 12 derivatives             "drift:u", ...
    what is added to each control                     "bias:de", ...
    delay of the controls [s]                         "delay"
    errors of the vanes and of the airspeed           "Cup", "Calpha0", "Csi", "Cbeta0", "KV"

so `FlightPlan.parameter_index(["Cm:alpha", "start:w", "delay"])` gives `index`. Above the kernels,
`structsel.simulation.prepare(model, aircraft, inputs, ...)` makes plan and flight from an AeroModel.

The equations, body axes, with v the velocity relative to a steady wind W0, f the specific force, I the inertia
tensor, h_r = (H, 0, 0) the momentum of the rotors and M the moment of air and thrust about the centre of gravity
[M86], [KM16] ch. 3::

    v' = f + R'g - omega x v                       I omega' = M - omega x (I omega + h_r)
    (phi, theta, psi)' by Euler's kinematics       (x, y, -h)' = R v + W0

The air moves with W0, the rest of the wind W(h) - W0, and the gust: velocity and rates relative to the air are
v - R'(W(h) - W0) - v_g and omega - omega_g, and the coefficients are evaluated there. Integrated by Runge and Kutta's
fourth-order rule over the samples, or `substeps` parts of them.

Terms in alpha_dot_hat or beta_dot_hat make the equations implicit, since those rates depend on the force they help
to make. Each such term is linear in its rate (anything else is refused when the plan is made), so the two rates
follow exactly from two linear equations; the rate of a gust is left out of them.
"""

from structsel.numerics.flight_dynamics.actuators import actuate
from structsel.numerics.flight_dynamics.batch import Batch, fly_batch, slopes
from structsel.numerics.flight_dynamics.layout import (
    AXES,
    CHANNELS,
    OUTPUTS,
    READINGS,
    REASONS,
    STATES,
    SURROUNDINGS,
    VANES,
    outputs_index,
)
from structsel.numerics.flight_dynamics.plan import Flight, FlightPlan

__all__ = [
    "AXES",
    "CHANNELS",
    "OUTPUTS",
    "READINGS",
    "REASONS",
    "STATES",
    "SURROUNDINGS",
    "VANES",
    "Batch",
    "Flight",
    "FlightPlan",
    "actuate",
    "fly_batch",
    "outputs_index",
    "slopes",
]
