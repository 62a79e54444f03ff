"""Ranges of channels over all flights, and construction of signatures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, EffectParameter, Flights, Variant
from structsel.nomenclature import COEFFICIENTS, LATERAL_COEFFICIENTS, LONGITUDINAL_COEFFICIENTS
from structsel.numerics.air_data import body_from_wind_axes, lift_and_drag
from structsel.numerics.arrays import Array, centred, rms_within

CHANNELS_OF = {
    **dict.fromkeys(LONGITUDINAL_COEFFICIENTS, ("alpha", "q_hat", "de", "df", "V")),
    **dict.fromkeys(LATERAL_COEFFICIENTS, ("beta", "p_hat", "r_hat", "da", "dr")),
}
"""Of a coefficient, the channels of its own family that it may be linear in."""
CONTROLS = {"de": ("Cm", "CZ", "CX"), "da": ("Cl", "Cn", "CY"), "dr": ("Cn", "Cl", "CY")}
"""Of a control, the coefficients it moves."""
UNITS = {"alpha": "rad", "beta": "rad", "de": "rad", "da": "rad", "dr": "rad", "df": "rad", "V": "m/s"}
_SOURCE = {"p_hat": "p", "q_hat": "q", "r_hat": "r", "alpha_dot_hat": "alpha", "beta_dot_hat": "beta", "CT": "thrust"}
_TINY = 1e-9

Column = Callable[[Flight], Array]
Parts = Iterable[tuple[str, int, Array]]
"""What one unit of a parameter adds: response, place of the parameter, and how much."""


def available(flights: Flights, channel: str) -> bool:
    """Whether every flight has a channel, or its source."""
    source = _SOURCE.get(channel, channel)
    return all(source in f.recorded or (channel in f and channel not in _SOURCE) for f in flights)


def gathered(flights: Flights, channel: str | Column) -> Array:
    """A channel, or a column, of all flights end to end."""
    return np.concatenate([_column(f, channel) for f in flights])


def spread(flights: Flights, channel: str | Column) -> float:
    """Rms about the mean of each manoeuvre, over all."""
    return rms_within(_column(f, channel) for f in flights)


def variation(flights: Flights, response: str) -> float:
    """Rms of a measured response about the mean of each manoeuvre, over all that have it."""
    return rms_within(f.measured[response] for f in flights if response in f.measured)


def _column(flight: Flight, channel: str | Column) -> Array:
    return flight[channel] if isinstance(channel, str) else channel(flight)


def moves(flights: Flights, channel: str) -> bool:
    """Whether a channel is there and changes within manoeuvres."""
    if not available(flights, channel):
        return False
    size = float(np.abs(gathered(flights, channel)).max())
    return spread(flights, channel) > _TINY * max(1.0, size)


def reach(flights: Flights, channel: str | Column) -> tuple[float, float]:
    """Smallest and largest value that all flights but single samples reach (0.2 and 99.8 per cent)."""
    low, high = np.quantile(gathered(flights, channel), [0.002, 0.998])
    return float(low), float(high)


def held(flights: Flights, wanted: Sequence[str]) -> tuple[str, ...]:
    """Those responses of `wanted` that any flight has."""
    return tuple(r for r in wanted if any(r in f.measured for f in flights))


def coefficients(flights: Flights) -> tuple[str, ...]:
    """Force and moment coefficients that are compared."""
    return held(flights, COEFFICIENTS)


def lacking(flights: Flights, responses: Sequence[str] = COEFFICIENTS, channels: Sequence[str] = ()) -> str:
    """What is missing: any of the responses, or a channel that moves; empty where nothing is."""
    if not held(flights, responses):
        return (
            f"a simulated {' or '.join(responses)}" if len(responses) < len(COEFFICIENTS) else "simulated coefficients"
        )
    gone = [c for c in channels if not available(flights, c)]
    if gone:
        return f"channel {' and '.join(_SOURCE.get(c, c) for c in gone)}"
    still = [c for c in channels if not moves(flights, c)]
    return f"{' and '.join(_SOURCE.get(c, c) for c in still)} that changes" if still else ""


def mean_slope(flights: Flights, response: str, channel: str) -> float:
    """Simulation's derivative, averaged over all flights; zero where it does not ask for the channel."""
    slopes = [f.slope(response, channel).mean() for f in flights if response in f.measured]
    return float(np.mean(slopes)) if slopes else 0.0


def term_sd(flights: Flights, response: str, column: str | Column, fraction: float) -> float:
    """Coefficient with which a column makes up `fraction` of a response's variation."""
    size = spread(flights, column)
    return fraction * variation(flights, response) / size if size > 0.0 else 0.0


def signature(flight: Flight, k: int, parts: Parts) -> dict[str, Array]:
    """(n, k) arrays by response from (response, parameter, what one unit of it adds); parts of one place add up."""
    made: dict[str, Array] = {}
    for response, j, x in parts:
        if response in flight.measured:
            made.setdefault(response, np.zeros((k, len(flight))).T)[:, j] += x
    return made


def of_parts(
    parameters: tuple[EffectParameter, ...],
    parts: Callable[[Flight], Parts],
    about: str = "",
    terms: tuple[str, ...] = (),
    shape: Mapping[str, float] | None = None,
    units: Mapping[str, str] | None = None,
) -> Variant:
    """A form of stated parts; see `signature`."""

    def columns(flight: Flight) -> Columns:
        return signature(flight, len(parameters), parts(flight))

    return Variant(parameters, columns, dict(shape or {}), dict(units or {}), about, terms)


def from_lift_and_drag(
    flight: Flight, j: int, CL: Array | float = 0.0, CD: Array | float = 0.0
) -> list[tuple[str, int, Array]]:
    """Parts of `signature` for an increment of lift and drag."""
    CX, CZ = body_from_wind_axes(CL, CD, flight["alpha"])
    return [("CX", j, CX), ("CZ", j, CZ)]


def lift(flight: Flight) -> Array:
    """Lift coefficient as simulated; where it is not simulated, as measured."""
    CZ = flight.predicted("CZ")
    CX = flight.predicted("CX")
    return lift_and_drag(CX, 0.0, CZ, flight["alpha"])[0]


def lift_line(flights: Flights) -> tuple[float, float]:
    """Slope of the simulated lift [1/rad] and angle of attack of none [rad]."""
    slope = -mean_slope(flights, "CZ", "alpha")
    if slope <= 0.5:
        slope = 5.0
    return slope, float(gathered(flights, "alpha").mean() - gathered(flights, lift).mean() / slope)


def without_linear_part(flights: Flights, column: Column, channels: Sequence[str]) -> Column:
    """The column minus its projection on linear terms, as for a simulation that was fitted without it."""
    used = [c for c in channels if moves(flights, c)]
    if not used:
        return column
    X = np.concatenate([np.column_stack([f[c] - f[c].mean() for c in used]) for f in flights])
    y = centred(column(f) for f in flights)
    scale = X.std(axis=0)
    weights = np.linalg.lstsq(X / scale, y, rcond=None)[0] / scale
    return lambda f: column(f) - sum(w * f[c] for w, c in zip(weights, used))


def product(channels: Sequence[str]) -> Column:
    """Product of channels; ``|beta|`` is the size of one."""

    def column(flight: Flight) -> Array:
        made = np.ones(len(flight))
        for c in channels:
            made = made * (np.abs(flight[c[1:-1]]) if c.startswith("|") else flight[c])
        return made

    return column


def term_text(channels: Sequence[str]) -> str:
    """Term of a model: ("alpha", "alpha", "de") as ``alpha^2*de``, ("beta", "|beta|") as ``beta*abs(beta)``."""
    named = [f"abs({c[1:-1]})" if c.startswith("|") else c for c in channels]
    counted = {c: named.count(c) for c in dict.fromkeys(named)}
    return "*".join(c if n == 1 else f"{c}^{n}" for c, n in counted.items())


def per_unit(channels: Sequence[str]) -> str:
    """Unit of a dimensionless coefficient per product of channels."""
    units = [UNITS[c.strip("|")] for c in channels if c.strip("|") in UNITS]
    if not units:
        return "-"
    counted = {u: units.count(u) for u in dict.fromkeys(units)}
    return "1/" + "/".join(u if n == 1 else f"{u}^{n}" for u, n in counted.items())


def scaled_slopes(
    flights: Flights,
    responses: Sequence[str],
    channels: Sequence[str] | None,
    factor: Column,
    parameter: EffectParameter,
    about: str,
    zero: float = 0.0,
    law: str = "",
) -> Variant | None:
    """The simulation's slopes times `factor` by one ratio; None where it has none of them.

    `channels` are those of each response's own family where None; alpha counts from `zero`; `law` is the factor as
    a term of a model, except for a constant.
    """
    slopes = {
        (r, c): s
        for r in responses
        for c in channels or tuple(c for c in CHANNELS_OF[r] if c not in ("V", "df"))
        if moves(flights, c) and (s := mean_slope(flights, r, c)) != 0.0
    }
    return slopes_by_ratios([(parameter, slopes)], factor, about, zero, law) if slopes else None


def scaled_coefficients(
    flights: Flights, responses: Sequence[str], factor: Column, parameter: EffectParameter, about: str
) -> Variant:
    """Coefficients times `factor` by one ratio; never that along the body, which is drag and thrust first."""
    moved = [r for r in responses if r != "CX"]

    def columns(flight: Flight) -> Columns:
        x = factor(flight)
        return signature(flight, 1, [(r, 0, x * flight.predicted(r)) for r in moved])

    return Variant((parameter,), columns, about=about)


def slopes_by_ratios(
    groups: Sequence[tuple[EffectParameter, Mapping[tuple[str, str], float]]],
    factor: Column,
    about: str,
    zero: float = 0.0,
    law: str = "",
) -> Variant:
    """Groups of slopes by (response, channel), each times `factor` by a ratio of its own; others as `scaled_slopes`."""
    channels = dict.fromkeys(c for _, slopes in groups for _, c in slopes)

    def columns(flight: Flight) -> Columns:
        x = factor(flight)
        used = {c: x * (flight[c] - zero if c == "alpha" else flight[c]) for c in channels}
        parts = [(r, j, s * used[c]) for j, (_, slopes) in enumerate(groups) for (r, c), s in slopes.items()]
        return signature(flight, len(groups), parts)

    terms = (*(f"{c}*{law}" for c in channels), law) if law else ()
    return Variant(tuple(p for p, _ in groups), columns, about=about, terms=terms)


def each_slope(
    flights: Flights,
    factor: Column,
    ratio: Callable[[str], EffectParameter],
    about: str,
    zero: float = 0.0,
    law: str = "",
) -> Variant | None:
    """Lift slope, stability and the controls each times `factor` by a ratio of its own; None where there is but one.

    Parameters
    ----------
    flights : sequence of Flight
    factor : Column
    ratio : callable
        EffectParameter of the slopes of a name: "lift slope", "stability", or that of a control.
    about : str
    zero : float [rad]
        Angle of attack from which that of the aircraft counts.
    law : str
        The factor as a term.
    """
    used = {c: held(flights, responses) for c, responses in CONTROLS.items() if moves(flights, c)}
    named = {"lift slope": ("alpha", ("CZ",)), "stability": ("alpha", ("Cm",)), **{c: (c, used[c]) for c in used}}
    groups = []
    for name, (channel, responses) in named.items():
        slopes = {(r, channel): s for r in responses if (s := mean_slope(flights, r, channel)) != 0.0}
        if slopes:
            groups.append((ratio(name), slopes))
    return slopes_by_ratios(groups, factor, about, zero, law) if len(groups) > 1 else None
