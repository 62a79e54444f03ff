"""Concealed cases whose truth is flown by JSBSim: another plant than ours, with physics of its own."""

from structsel.proving.jsbsim.drawing import FLEET, draw_jsbsim_case

__all__ = ["FLEET", "draw_jsbsim_case"]
