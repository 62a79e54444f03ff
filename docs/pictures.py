"""A picture of each effect: its contribution to the differences, over time and over the channel that drives it."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from structsel import AeroModel, Recording, simulate, trim
from structsel.coefficients import compute_coefficients
from structsel.comparison.flight import Flight, prepare_flight
from structsel.comparison.responses import KINEMATIC
from structsel.comparison.surrogate import identify
from structsel.demo.aircraft import TRUTH, demo_aircraft
from structsel.diagnosis.switch_search import On
from structsel.diagnosis.switching import switched_form
from structsel.effects import EFFECTS, Variant
from structsel.effects.base import Effect
from structsel.nomenclature import unit_of

_DT, _SECONDS = 0.04, 24.0
_T = np.arange(0.0, _SECONDS, _DT)
_INK, _GREY = "#00838f", "#888888"
_DRIVERS = (
    *("alpha", "beta", "p", "q", "r", "de", "da", "dr", "V", "mach", "h_agl", "thrust", "y"),
    *("alpha_dot", "q_dot", "p_dot", "r_dot"),
)
_FEW = 12  # bins
_CLEAR = 0.2  # fraction of a signature's variance that the bin means of a channel explain if it is the driver
_SLOW = {"h_agl": 0.9}  # the same for what itself moves as slowly as time
_TIME = 0.8  # the same, over time: then no channel drives it


def pictures() -> Iterator[tuple[str, bytes]]:
    """Each effect with its picture, SVG."""
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "structsel", "font.size": 9}):
        for hypothesis in EFFECTS:
            yield hypothesis.name, _draw(hypothesis)


def _pulses(*at: tuple[float, float, float]) -> np.ndarray:
    """Doublets of (start, length of a side, size), rounded as a hand does."""
    made = np.zeros_like(_T)
    for start, side, size in at:
        made += size * (((start <= _T) & (start + side > _T)) * 1.0 - ((start + side <= _T) & (start + 2 * side > _T)))
    window = np.hanning(13) / np.hanning(13).sum()
    return np.convolve(np.pad(made, 6, mode="edge"), window, mode="valid")


@cache
def _aircraft(speeds: tuple[float, ...]) -> tuple[Flight, ...]:
    """Flights that move every control and the thrust, low over the ground, flaps and gear moving."""
    aircraft = demo_aircraft()
    model = AeroModel.from_terms(TRUTH)
    recordings, simulated = [], []
    for k, V in enumerate(speeds):
        start = trim(model, aircraft, V, 500.0)
        moves = {
            "de": _pulses((1.0, 0.9, 0.05), (13.0 - k, 0.6, -0.06)),
            "dr": _pulses((6.0 + k, 0.9, 0.06), (19.0, 0.7, -0.05)),
            "da": _pulses((9.5, 0.7, 0.06), (16.0 + k, 0.7, -0.05)),
        }
        thrust = 900.0 * (((_T >= 3.0) & (_T < 9.0)) * 1.0 - ((_T >= 15.0) & (_T < 20.0)))
        flight = simulate(model, aircraft, start.inputs(_T, **moves, thrust=thrust), start=start, outside="ignore")
        extra = {
            "df": 0.35 * np.clip((_T - 10.0) / 3.0, 0.0, 1.0),
            "gear": 1.0 * (_T > 12.0),
            "h_agl": 25.0 - 23.0 * np.sin(np.pi * _T / _SECONDS),
            "collective": _pulses((4.0, 1.5, 0.1), (17.0, 1.0, 0.15)),
        }
        recording = Recording(f"m{k + 1:02d}", flight.t, {**flight.channels, **extra}, units={"collective": "rad"})
        recordings.append(recording)
        simulated.append(dict(model.evaluate(compute_coefficients(recording, aircraft), outside="ignore")))
    flights = [prepare_flight(r, aircraft, s) for r, s in zip(recordings, simulated)]
    stand_in = identify(flights, simulated, list(simulated[0]))
    return tuple(replace(f, surrogate=stand_in) for f in flights)


@cache
def _rig() -> tuple[Flight, ...]:
    """A mass on a spring, pushed."""
    u = _pulses((1.0, 1.5, 1.0), (7.0, 0.8, 1.5), (11.0, 2.5, 0.7), (18.0, 1.2, 1.3))
    y, rate, made = 0.0, 0.0, []
    for push in u:
        rate += _DT * (push - 0.5 * rate - 2.0 * y)
        y += _DT * rate
        made.append(y)
    recording = Recording("rig", _T, {"push": u, "y": np.array(made)}, units={"push": "N", "y": "m"})
    return (prepare_flight(recording, demo_aircraft(), {"y": np.array(made)}),)


def _scene(hypothesis: Effect) -> tuple[tuple[Flight, ...], Variant]:
    """Flights on which it can be tried, and one of its forms."""
    for flights in (_aircraft((40.0, 52.0)), _aircraft((95.0, 110.0)), _rig()):
        if not hypothesis.needs(flights):
            middle = {f.name: On(float(f.t.mean())) for f in flights}
            begun = [switched_form(v, middle) for v in hypothesis.switched(flights)] if hypothesis.switched else []
            if forms := [*hypothesis.variants(flights)] or begun:
                return flights, forms[len(forms) // 2]
    raise LookupError(f"no flight here shows '{hypothesis.name}'")


def _clearest(flights: tuple[Flight, ...], form: Variant) -> tuple[Flight, str, int, np.ndarray]:
    """Flight, response and parameter in which one usual size of the effect stands out most."""
    found = []
    for flight in flights:
        for response, columns in form.columns(flight).items():
            spread = float(np.std(flight.measured[response])) or 1.0
            for k, parameter in enumerate(form.parameters):
                left = parameter.sd * columns[:, k]
                found.append((float(np.sqrt(np.mean(left**2))) / spread, flight, response, k, left))
    # What contradicts between instruments (k_...) is shown only where no coefficient tells.
    return max(found, key=lambda one: (one[2] not in KINEMATIC and one[0] > 0.0, one[0]))[1:]


def _driver(flight: Flight, left: np.ndarray) -> str:
    """Channel whose bins explain most of a signature; empty where time alone does, or none."""
    moving = [name for name in _DRIVERS if (name in flight or name in flight.simulated) and np.ptp(_seen(flight, name))]
    fractions = {name: _fraction(_seen(flight, name), left) for name in moving}
    clear = {name: x for name, x in fractions.items() if x > _SLOW.get(name, _CLEAR)}
    best = max(clear, key=lambda name: clear[name], default="")
    over_time = _fraction(flight.t, left)
    return best if best and (over_time < _TIME or clear[best] > over_time) else ""


def _seen(flight: Flight, name: str) -> np.ndarray:
    """A channel, or what is simulated where the response is none of the coefficients."""
    return flight.simulated[name] if name in flight.simulated else flight[name]


def _fraction(x: np.ndarray, left: np.ndarray) -> float:
    edges = np.quantile(x, np.linspace(0.0, 1.0, _FEW + 1)[1:-1])
    place = np.searchsorted(edges, x)
    means = np.bincount(place, left, minlength=_FEW) / np.maximum(np.bincount(place, minlength=_FEW), 1)
    return 1.0 - float(np.var(left - means[place])) / (float(np.var(left)) or 1.0)


def _draw(hypothesis: Effect) -> bytes:
    flights, form = _scene(hypothesis)
    flight, response, k, left = _clearest(flights, form)
    parameter = form.parameters[k]
    name = _driver(flight, left)
    figure = Figure(figsize=(7.6, 2.5), layout="constrained")
    over_time, *others = np.atleast_1d(figure.subplots(1, 2 if name else 1, width_ratios=(3, 2) if name else None))
    over_time.plot(flight.t, left, color=_INK, lw=1.3)
    over_time.set_xlabel("t [s]")
    over_time.set_ylabel(f"left of {response}")
    if name:
        others[0].plot(_seen(flight, name), left, color=_INK, lw=0.8, alpha=0.7)
        others[0].set_xlabel(_axis(name))
        others.append(over_time.twinx())
        others[1].plot(flight.t, _seen(flight, name), color=_GREY, lw=0.8, ls="--")
        others[1].set_ylabel(_axis(name))
    size = f"{parameter.sd:.2g} {parameter.unit}".rstrip(" -")
    figure.suptitle(f"{form.about + ': ' if form.about else ''}{parameter.name} of {size}", fontsize=9, color=_GREY)
    for axes in (over_time, *others):
        axes.tick_params(colors=_GREY, labelsize=8)
        axes.xaxis.label.set_color(_GREY)
        axes.yaxis.label.set_color(_GREY)
        axes.locator_params(nbins=5)
        for spine in axes.spines.values():
            spine.set_color(_GREY)
    held = io.BytesIO()
    figure.savefig(held, format="svg", transparent=True, metadata={"Date": None})
    return held.getvalue()


def _axis(name: str) -> str:
    unit = unit_of(name, {})
    return f"{name} [{unit}]" if unit not in ("", "?") else name
