"""Square-root filter and smoother over the flight-path kinematics: unscented, or linearised.

The covariance P = S S' is never formed: every update is an orthogonal triangularisation of an array of
deviations, and each array only ever *adds* columns, so no downdate can lose what makes P positive. That
holds because the weight of the centre point is not negative: with L states, spread a and beta = 2 [H17]::

    sigma points  x, x +- a sqrt(L) S_i        W_i = 1 / (2 a^2 L)
    W_0 (mean) = 1 - 1/a^2                     W_0 (covariance) = W_0 + 3 - a^2  >= 0  for 0.52 <= a <= 1.93

Pairs of deviations are turned into their odd part O (a linearisation over the spread of S) and even part E
(what curvature adds). With [E c N] the even parts, the centre and the process noise,

    prediction   S- = tria [O E c N]
    update       tria [R_e O_y; 0 S-] = [S_y 0; K S_y  S+],   R_e = tria [E_y c_y R],   K the gain
    smoothing    G = S O' (S- S-')^-1,        S_s = tria [S - G O,  G [E c N],  G S_s+]

The extended filter is the same with O the derivative along S, taken by central differences, and no E, c.

References
----------
[M86], [H17]; [VM01] for the square-root form, [AH09] and [S08] for updates and smoothing by triangularisation.
"""

from structsel.numerics.unscented.kernel import STEEPEST
from structsel.numerics.unscented.problem import FilterResult, KinematicsProblem, SmootherResult
from structsel.numerics.unscented.runs import STEEP, ukf_filter, ukf_smoother

__all__ = ["STEEP", "STEEPEST", "FilterResult", "KinematicsProblem", "SmootherResult", "ukf_filter", "ukf_smoother"]
