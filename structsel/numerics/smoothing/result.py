"""What a smoother returns."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from structsel.numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class SmoothedSignal:
    """One channel without its noise, its derivatives, and how sure they are. Arrays are read-only.

    Attributes
    ----------
    values, values_std : (n,) arrays [unit of x]
        The smooth signal and its standard deviation at each sample.
    derivative, derivative_std : (n,) arrays [unit of x / s]
    second, second_std : (n,) arrays [unit of x / s^2]
        Second derivative; NaN where the smoother assumes no more than that it is white (order 2).
    noise : float [unit of x]
        Standard deviation of the white noise that was taken off.
    cutoff : float [Hz]
        Frequency of which half the amplitude passes.
    order : int
        Sharpness that was assumed: beyond the cut-off the signal's amplitude falls with this power of frequency.
    """

    values: Array
    values_std: Array
    derivative: Array
    derivative_std: Array
    second: Array
    second_std: Array
    noise: float
    cutoff: float
    order: int

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def __str__(self) -> str:
        return (
            f"{self.values.size} samples, noise {self.noise:.3g}, cut-off {self.cutoff:.3g} Hz (order {self.order}); "
            f"median standard deviation {np.median(self.values_std):.3g} of the values, "
            f"{np.median(self.derivative_std):.3g} of the derivative"
        )
