"""Options of `design_inputs` and `compare_inputs`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from structsel.inputs.criteria import Criterion
from structsel.inputs.optimal import Basis
from structsel.options import option
from structsel.simulation.linear import Hold

_MODEL, _OPTIMAL = "Model whose parameters are estimated", "compare and optimal"


@dataclass(frozen=True)
class InputOptions:
    """Parameters, clock and basis functions of an experiment.

    Attributes
    ----------
    parameters : sequence of str, optional
        Estimated together; by default those that are not zero.
    duration, dt : float [s]
    basis : {"sines", "fourier", "legendre"}
        Functions of the optimal inputs. ``"sines"`` begin and end at zero.
    functions : int, optional
        For each input; by default up to twice the frequency of the fastest mode, 8 to 30.
    scales : mapping of str to float, optional
        Unit of each input in the energy; 1 by default.
    parameter_scales : mapping of str to float, optional
        Unit of the error of each parameter; its value by default.
    seed : int
        Of the searches for phases and shapes.
    """

    parameters: Sequence[str] | None = option(
        None, help="Parameters estimated together; by default those that are not zero.", group=_MODEL, metavar="NAMES"
    )
    duration: float = option(20.0, help="Length of the record, in s.")
    dt: float = option(0.05, help="Sampling interval, in s.")
    basis: Basis = option("sines", help="Basis functions.", group=_OPTIMAL)
    functions: int | None = option(None, help="Number of basis functions for each control.", group=_OPTIMAL)
    scales: Mapping[str, float] | None = option(
        None, help="Unit of each control in the energy.", group=_OPTIMAL, metavar="NAME=SIZE,..."
    )
    parameter_scales: Mapping[str, float] | None = option(None)
    seed: int = option(0, help="Of the searches for phases and shapes.")


@dataclass(frozen=True)
class DesignOptions(InputOptions):
    """Purpose and limits of an optimal input, in addition to the fields of `InputOptions`.

    Attributes
    ----------
    to_separate : sequence of str, optional
        Two or more parameters to separate: the largest variance of any combination of these is minimised (criterion
        ``"E"``), all other parameters being estimated too. The combination with the largest variance is the one that
        the parameters explain alike.
    criterion : {"A", "D", "trace", "E"}
        Minimise trace, ln det or largest eigenvalue of the covariance, or maximise the trace of the information;
        parameters scaled by `parameter_scales`. The trace often gives an input that determines one combination well
        and the others not.
    energy : float, optional
        Integral of the squared inputs over their scales [s]. Without it limits are needed: shape and energy within
        the limits are then designed together.
    limits : mapping of str to float, optional
        Largest change of inputs, outputs, states, and alpha, beta, V (as w / V, v / V, u).
    rate_limits : mapping of str to float, optional
        Largest rate of inputs, from sample to sample [unit/s].
    hold : {"hold", "linear"}
        Input between samples.
    """

    to_separate: Sequence[str] | None = option(None, help="Parameters to separate.", group=_OPTIMAL, metavar="NAMES")
    criterion: Criterion = option("A", help="Criterion of optimal inputs.", group=_OPTIMAL)
    energy: float | None = option(None, help="Integral of the squared inputs.", group=_OPTIMAL)
    limits: Mapping[str, float] | None = option(
        None, help="Largest changes: de=0.1,alpha=0.08,V=3", group=_OPTIMAL, metavar="NAME=MAX,..."
    )
    rate_limits: Mapping[str, float] | None = option(
        None, help="Largest rates of controls, per s.", group=_OPTIMAL, metavar="NAME=MAX,..."
    )
    hold: Hold = option("hold")
