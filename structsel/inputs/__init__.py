"""Design of inputs: classical ones, multisines, optimal ones, and their information about a model's parameters.

Inputs are Recordings of controls, as `simulate` takes them; amplitudes are changes from trim.
"""

from structsel.inputs.compare import InputComparison, Scatter, compare_inputs, scatter
from structsel.inputs.design import InputDesign, design_inputs
from structsel.inputs.information import Information, information
from structsel.inputs.mehra_schulz import mehra, schulz
from structsel.inputs.multisine import multisine, peak_factor
from structsel.inputs.settings import DesignOptions, InputOptions
from structsel.inputs.signals import (
    combine,
    doublet,
    energy,
    frequency_sweep,
    impulse,
    multistep,
    step,
    table,
    three_two_one_one,
    two_one_one_one,
    with_energy,
)
from structsel.simulation.dimensional_derivatives import name_derivatives

__all__ = [
    "DesignOptions",
    "Information",
    "InputComparison",
    "InputDesign",
    "InputOptions",
    "Scatter",
    "combine",
    "compare_inputs",
    "design_inputs",
    "doublet",
    "energy",
    "frequency_sweep",
    "impulse",
    "information",
    "mehra",
    "multisine",
    "multistep",
    "name_derivatives",
    "peak_factor",
    "scatter",
    "schulz",
    "step",
    "table",
    "three_two_one_one",
    "two_one_one_one",
    "with_energy",
]
