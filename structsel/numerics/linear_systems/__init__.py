"""Linear systems with a delay: their motion, exactly and many at once; their modes; how they depend on parameters.

::

    x'(t) = A x(t) + B u(t - delay) + bias          y(t) = C x(t) + D u(t - delay) + y_ref

``LinearSystem(states, inputs, outputs, A, B, C, D, delay, bias, y_ref)`` is one system, or m of them when arrays
carry a leading axis. ``simulate_linear(A, B, C, D, u, dt, ...)`` gives outputs (n, no), or (m, n, no) in a batch;
nothing is approximated between samples, whatever the delay, for inputs held or linear there. ``modes(A, states)``
names and measures the modes. ``LinearFamily`` is a system that depends linearly on named parameters, and on the
delay; ``family.at(theta)`` takes (k,) or (m, k) and gives a `LinearSystem`, ``family.simulate(theta, u, dt)`` its
outputs, and ``family.sensitivities(theta, u, dt)`` the exact derivatives of the outputs, (n, no, k).
"""

from structsel.numerics.linear_systems.family import LinearFamily
from structsel.numerics.linear_systems.modes import Modes, modes
from structsel.numerics.linear_systems.motion import discretise, previous_input, simulate_linear
from structsel.numerics.linear_systems.system import LinearSystem

__all__ = [
    "LinearFamily",
    "LinearSystem",
    "Modes",
    "discretise",
    "modes",
    "previous_input",
    "simulate_linear",
]
