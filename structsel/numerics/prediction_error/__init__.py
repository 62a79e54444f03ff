"""Prediction error: what a model expects of the next sample when the flight is let in sample by sample.

Process noise w, turbulence for one, moves the states beside the inputs; the innovations v, fed back through a steady
Kalman gain, tell the model where it has got to::

    x' = f(x, u) + w                        v[k] = z[k] - y(x[k], u[k])
    z  = y(x, u) + n                        x[k] <- x[k] + K v[k], then on to the next sample

`predict_flight` flies many parameter sets, each with its own gain; `structsel.refinement.filter_kernels` has the gain.
With K = 0 it is the flight in open loop. The innovations take the place of the residuals in
`structsel.numerics.output_error`, which is then the filter-error method.

References
----------
[KM16], filter error; [J15], filter error with a steady gain.
"""

from structsel.numerics.prediction_error.flight import linearise_flight, predict_flight

__all__ = ["linearise_flight", "predict_flight"]
