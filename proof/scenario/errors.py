"""Errors that every case has: levels of the instruments, tolerances, and effects that are not combined."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import cast

from proof.keys import Severity

CONTROLS = ("de", "da", "dr")
NOISE = {
    "V": 0.15, "alpha": 1.0e-3, "beta": 1.0e-3, **dict.fromkeys("pqr", 3.5e-4), "phi": 9e-4, "theta": 9e-4,
    "psi": 1.2e-3, "h": 0.37, "h_agl": 0.095, "ax": 0.0125, "ay": 0.0125, "az": 0.025,
    **dict.fromkeys(CONTROLS, 4e-4), **dict.fromkeys(("vn", "ve", "vd"), 0.05),
}  # fmt: skip
"""Standard deviation of the white noise of good instruments [SI]; a case has these times 1 to 1.7."""
BIAS = {
    "V": 0.2, "alpha": 1.5e-3, "beta": 1.5e-3, **dict.fromkeys("pqr", 6e-4), "phi": 1.5e-3, "theta": 1.5e-3,
    "psi": 2e-3, "h": 1.0, "ax": 0.02, "ay": 0.02, "az": 0.03, **dict.fromkeys(CONTROLS, 5e-4),
}  # fmt: skip
"""Standard deviation of the constant bias of one recording [SI]."""
THRUST_NOISE = 0.003
"""Noise of the thrust, of its mean."""
RECONSTRUCTION = {"V": 0.05, "alpha": 2e-4, "beta": 2e-4}
"""Standard deviation of the slow errors that a flight-path reconstruction leaves [m/s, rad]."""
TIGHT = {
    "main": 0.01, "secondary": 0.03, "mass": 0.003, "inertia": 0.01, "cg": 0.001, "thrust": 0.01, "vane_scale": 0.005,
    "alignment": 0.002, "delay": 0.002, "lever_arm": 0.05,
}  # fmt: skip
"""Tolerances of a good simulation and good instruments, as `structsel.aircraft.Tolerances`."""
BETWEEN = {
    "main": 0.02, "secondary": 0.06, "mass": 0.005, "inertia": 0.02, "cg": 0.002, "thrust": 0.015, "vane_scale": 0.008,
    "alignment": 0.003, "delay": 0.003, "lever_arm": 0.1,
}  # fmt: skip
"""Tolerances between these and the defaults."""
OFF_BY = (0.0, 0.0, 0.3, 1.0)
"""Fractions of the stated tolerances by which the parameters of a case's simulation and instruments are off."""
SEVERITIES = {"easy": (0.3, 0.7), "medium": (0.15, 0.3), "hard": (0.05, 0.15)}
"""Attainable fraction of the rms in the clearest response."""

EXCLUSIVE = (
    {"static-stall", "stall-hysteresis"}, {"configuration-change", "store-release", "mass-error"},
    {"actuator-lag", "actuator-rate-limit", "actuator-saturation", "backlash", "augmentation"},
    {"sensor-scale", "position-error"}, {"sensor-bias", "structural-mode"}, {"thrust-scale", "thrust-lag"},
    {"compressibility", "flexibility", "control-stretch", "reynolds"},
)  # fmt: skip
"""Effects that enter by the same inputs are not combined in a case of the polynomial plant."""
EXCLUSIVE_JSBSIM = (
    {"static-stall", "stall-hysteresis"}, {"configuration-change", "store-release", "mass-error", "icing"},
    {"actuator-lag", "actuator-rate-limit", "actuator-saturation", "backlash", "augmentation"},
    {"sensor-scale", "sensor-bias", "position-error", "sensor-misalignment", "sensor-delay", "gust"},
    {"thrust-scale", "thrust-lag"}, {"compressibility", "flexibility", "control-stretch", "reynolds"},
)  # fmt: skip
"""The same for JSBSim."""


def may_combine(name: str, others: Iterable[str], exclusive: Sequence[set[str]]) -> bool:
    """Whether an effect may be combined with others in a case."""
    return not any(name == other or any({name, other} <= group for group in exclusive) for other in others)


def severity_of(attainable: float) -> Severity:
    """Severity of a case by the attainable fraction in its clearest response."""
    return cast(Severity, next((s for s, (low, _) in SEVERITIES.items() if attainable >= low), "hard"))
