"""Smoothing of one channel with derivatives of stated accuracy, and its noise level. Arrays only."""

from structsel.numerics.smoothing.fourier import smooth_fourier
from structsel.numerics.smoothing.noise import is_held, noise_level
from structsel.numerics.smoothing.result import SmoothedSignal
from structsel.numerics.smoothing.spline import smooth_spline

__all__ = ["SmoothedSignal", "is_held", "noise_level", "smooth_fourier", "smooth_spline"]
