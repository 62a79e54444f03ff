"""The simulation flown again in short windows, as delivered, refitted and with the physics, on flights held out.

What the differences of coefficients are worth is seen in what they do to the motion. Each manoeuvre is cut into windows
that start from the recorded state, and the rigid body is flown through all of them at once with the coefficients that
each stage tells along the recorded path. Where the flight leaves that path the coefficients follow by the simulation's
slopes: without them an aircraft has neither stiffness nor damping, and drifts off within a second.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp

from structsel.aircraft import Aircraft, Inertia
from structsel.comparison.flight import AIRFRAME, Flight
from structsel.comparison.noise import edge_of
from structsel.comparison.responses import COEFFICIENTS, respond
from structsel.diagnosis import judging
from structsel.diagnosis.assembling import contribution
from structsel.diagnosis.bench import Bench
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.replayed import Near, Replay, ReplayRow, Stretch
from structsel.errors import DomainError
from structsel.nomenclature import unit_of
from structsel.numerics import rigid_body as rb
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import fading
from structsel.validation import BANDS

_FLOWN = {"V": "CX", "alpha": "CZ", "beta": "CY", "p": "Cl", "q": "Cm", "r": "Cn", "phi": "Cl", "theta": "Cm"}
"""Channels that are flown, in the order of the state, and the coefficient without which each is as recorded."""
_AIR = tuple(_FLOWN)[:6]
_KINEMATIC = ("k_V", "k_alpha", "k_beta", "k_phi", "k_theta")
_RATES = (*COEFFICIENTS, *_KINEMATIC)
_PERIODS, _SHORTEST, _USUAL, _LONGEST = 2.0, 1.0, 2.0, 3.0  # short periods; s
_SIGMAS = 2.0
_FINEST = 0.01  # of the proof-of-match band, below which no band lies
_DRAWN = 600  # samples


@dataclass(frozen=True, eq=False)
class Told:
    """What each stage tells along one flight.

    Attributes
    ----------
    flight : Flight
    stages : mapping of stage to mapping of response to (n,) array
        Coefficients, and kinematic responses; those that are missing are taken as measured.
    """

    flight: Flight
    stages: Mapping[str, Mapping[str, Array]]


def replay_windows(ranking: Ranking) -> Replay:
    """Fly the flights held out in short windows, at all three stages.

    Parameters
    ----------
    ranking : Ranking

    Returns
    -------
    Replay
        Without rows, and with the reason, where there is nothing to fly.
    """
    flights = ranking.bench.flights
    if not set(AIRFRAME) <= set(flights[0].channels) or not set(flights[0].simulated) & set(COEFFICIENTS):
        return Replay(reason="the simulation tells no aerodynamic coefficient, and nothing else flies")
    told = list(told_by_stage(ranking))
    return fly_windows(told, window_of([one.flight for one in told]))


def told_by_stage(ranking: Ranking) -> Iterator[Told]:
    """What each stage tells along the flights held out, its parameters found on the other flights.

    As with the bars, what the other flights say of a response is taken where it foretells that better than the
    simulation as delivered does. Levels are those measured, at all stages: constant biases differ in each recording.
    Where no effect was taken in there are two stages.
    """
    bench = ranking.bench
    plain, tuned = bench.as_delivered, bench.keeping([])
    refitted = _better(judging.as_delivered(bench), judging.held_out(tuned))
    with_it = _better(judging.held_out(plain), judging.held_out(bench))
    for g, group in enumerate(bench.base.groups):
        for m in group:
            f = bench.flights[m]
            tuning = foretold(tuned, g, m)
            added: dict[str, Mapping[str, Array]] = {
                "delivered": {},
                "refitted": {c: x for c, x in tuning.items() if c in refitted},
            }
            if bench.accepted:
                alone, whole = foretold(plain, g, m), foretold(bench, g, m)
                added["physics"] = alone | {c: x for c, x in whole.items() if c in with_it}
            yield Told(f, {stage: _levelled(f, more) for stage, more in added.items()})


def _better(one: judging.Residuals, other: judging.Residuals) -> set[str]:
    """Responses of which the other leaves less."""
    return {c for c in other[0] if judging.rms(other, c) < judging.rms(one, c)}


def foretold(bench: Bench, g: int, m: int) -> dict[str, Array]:
    """What tolerances and effects add to each response of flight m, as the flights outside group g have it."""
    f = bench.flights[m]
    known = bench.base.scales[bench.base.chosen] * bench.base.solved[g + 1]
    parts = [{c: x * n.sd * column for c, column in n.columns[m].items()} for n, x in zip(bench.nuisances, known)]
    for k, s in enumerate(bench.accepted):
        theta = known[bench.place(k)] * np.array([p.sd for p in s.variant.parameters])
        parts.append(contribution(f, s.variant, theta))
    made: dict[str, Array] = {}
    for part in parts:
        for c, x in part.items():
            made[c] = made.get(c, 0.0) + x
    return made


def _levelled(flight: Flight, more: Mapping[str, Array]) -> dict[str, Array]:
    """Responses with something added, moved to the level measured as it is compared: the ends count little."""
    weight = fading(len(flight), edge_of(flight)) ** 2
    weight = weight / weight.sum()
    none = np.zeros(len(flight))
    told = {c: flight.simulated.get(c, none) + more.get(c, none) for c in flight.measured}
    return {c: x + weight @ (flight.measured[c] - x) for c, x in told.items()}


def window_of(flights: Sequence[Flight]) -> float:
    """Length of the windows [s]: two short periods of the simulation, no less than 1 s and no more than 3 s.

    The short period is that of incidence alone, 2 pi (-qbar S cbar Cm_alpha / Iy)^-1/2 with the median of qbar
    Cm_alpha; where that is not to be had, or not stable, windows take 2 s.
    """
    craft = flights[0].craft
    if craft.inertia is None:
        return _USUAL
    moment = np.concatenate([f["qbar"] * f.slope("Cm", "alpha") for f in flights])
    stiffness = -float(np.median(moment)) * craft.S * craft.cbar / craft.inertia.Iy
    if not stiffness > 0.0:
        return _USUAL
    return float(np.clip(_PERIODS * 2.0 * np.pi / np.sqrt(stiffness), _SHORTEST, _LONGEST))


def fly_windows(told: Sequence[Told], seconds: float) -> Replay:
    """Fly what each stage tells through windows of all flights at once, each from the smoothed state recorded there.

    Parameters
    ----------
    told : sequence of Told
        With the same stages and responses in all flights.
    seconds : float
        Length of a window; each flight is cut into even ones of about that.

    Returns
    -------
    Replay
        Without rows, and with the reason, where a window cannot be flown to its end.
    """
    table = _Table.of(told, seconds)
    try:
        flown = table.fly()
    except DomainError as error:
        return Replay(reason=f"a window flies where the equations of motion do not hold: {error}")
    if flown is None:
        return Replay(reason="the simulation flies off within a window: its slopes make the motion explode")
    stages = list(told[0].stages)
    seen = np.arange(len(flown)) <= table.length[:, None]  # (windows, samples)
    seen[:, 0] = False
    responses = set.intersection(*(set(one) for held in told for one in held.stages.values()))
    rows, errors = [], {}
    for j, (channel, own) in enumerate(_FLOWN.items()):
        if own not in responses or not all(channel in one.flight.recorded for one in told):
            continue
        path, read = table.path[j, table.sample], table.read[j, table.sample]
        noise = _rms(table.read[j] - table.path[j])
        band = max(_SIGMAS * noise, _FINEST * BANDS[channel])
        begun = flown[0, j, 0][:, None]
        near = {}
        for k, stage in enumerate(stages):
            got = flown[:, j, k].T
            errors[channel, stage] = np.where(seen, (got - path) ** 2, 0.0).sum(axis=1)
            rms, moved, went = (_rms(x[seen]) for x in (got - path, path - begun, got - begun))
            tic = rms / (moved + went) if moved + went > 0.0 else np.nan
            near[stage] = Near(rms, tic, float(np.mean(np.abs((got - read)[seen]) <= band)))
        rows.append(ReplayRow(channel, unit_of(channel), noise, band, near))
    made = Replay(tuple(rows), seconds, len(table.start))
    if made.gained is None:
        return made
    best = made.gained.channel
    fallen = errors[best, stages[0]] - errors[best, stages[-1]]
    return replace(made, stretch=_stretch(told, table, flown, best, fallen))


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


@dataclass(frozen=True, eq=False)
class _Table:
    """All flights behind one another, and where the windows lie in them.

    Attributes
    ----------
    craft : Aircraft
    rates : (11, stages, n) array
        Coefficients, and rates that readings have beyond what the motion gives them.
    given : (9, n) array
        Density, mass and thrust; and V, alpha, beta, p, q, r at the centre of gravity, along the recorded path.
    slopes : (6, 6, n) array
        Of the coefficients with those six.
    path, read : (8, n) array
        Smoothed state, as the instruments have it; and the readings as they are.
    start, length, owner : (w,) int array
        First sample of each window, samples after it, and its flight.
    dt : (w,) array [s]
    """

    craft: Aircraft
    rates: Array
    given: Array
    slopes: Array
    path: Array
    read: Array
    start: np.ndarray
    length: np.ndarray
    owner: np.ndarray
    dt: Array

    @classmethod
    def of(cls, told: Sequence[Told], seconds: float) -> _Table:
        """Table of flights and windows."""
        craft = _with_inertia(told[0].flight)
        parts = [_columns(one, craft) for one in told]
        edges, first = [], 0
        for one in told:
            n = len(one.flight)
            count = max(1, round((n - 1) * one.flight.dt / seconds))
            edges.append(first + np.linspace(0, n - 1, count + 1).astype(int))
            first += n
        owner = np.repeat(np.arange(len(told)), [len(e) - 1 for e in edges])
        dt = np.array([one.flight.dt for one in told])[owner]
        start = np.concatenate([e[:-1] for e in edges])
        length = np.concatenate([np.diff(e) for e in edges])
        rates, given, slopes, path, read = (np.concatenate(each, axis=-1) for each in zip(*parts))
        return cls(craft, rates, given, slopes, path, read, start, length, owner, dt)

    @property
    def sample(self) -> Array:
        """(w, samples) index of each window's samples; the last again where others are longer."""
        steps = np.arange(self.length.max() + 1)
        return self.start[:, None] + np.minimum(steps, self.length[:, None])

    def fly(self) -> Array | None:
        """(samples, 8, stages, w) channels as the instruments would read them; None where a flight explodes."""
        stages, windows, steps = self.rates.shape[1], len(self.start), int(self.length.max())
        V, alpha, beta = self.given[3:6, self.start]
        state = np.stack([*rb.body_velocity(V, alpha, beta), *self.path[3:, self.start]])
        shape = (8, stages, windows)

        def slope(step: float, x: Array) -> Array:
            return (self._slope(step, x.reshape(shape)) * self.dt).ravel()

        # One step a sample, whatever its error: what is told between samples is not known better than that.
        one_a_sample = {"first_step": 1.0, "max_step": 1.0, "rtol": 1.0, "atol": np.inf}
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            whole = np.repeat(state[:, None], stages, axis=1)
            found = solve_ivp(slope, (0.0, steps), whole.ravel(), method="RK23", **one_a_sample)
        x = found.y.T.reshape(-1, *shape)
        if len(x) != steps + 1 or not np.isfinite(x).all():
            return None
        V, alpha, beta = rb.air_data(x[:, 0], x[:, 1], x[:, 2])
        seen = rb.air_data_at_cg(V, alpha, beta, x[:, 3], x[:, 4], x[:, 5], tuple(-self.craft.position("vane")))
        return np.stack([*seen, *np.moveaxis(x[:, 3:], 1, 0)], axis=1)

    def _slope(self, step: float, x: Array) -> Array:
        """(8, stages, w) rates of u, v, w, p, q, r, phi, theta, so many samples after each window's start."""
        k = min(int(step), int(self.length.max()) - 1)
        here, then = (self.start + np.minimum(i, self.length) for i in (k, k + 1))

        def now(held: Array) -> Array:
            return (k + 1 - step) * held[..., here] + (step - k) * held[..., then]

        rho, mass, thrust, *path = now(self.given)
        rates, craft = now(self.rates), self.craft
        u, v, w = x[:3]
        off = np.stack([*rb.air_data(u, v, w), *x[3:6]]) - np.stack(path)[:, None]
        coefficients = rates[:6] + np.einsum("cxw,xsw->csw", now(self.slopes), off)
        assert craft.inertia is not None
        made = rb.state_derivative(
            np.concatenate([x, np.zeros((4, *x.shape[1:]))]), coefficients, rho, mass, craft.inertia.tensor,  # type: ignore[arg-type]
            craft.S, craft.b, craft.cbar, thrust, craft.thrust.offset, craft.thrust.inclination,
            craft.engine.angular_momentum,
        )[:8]  # fmt: skip
        V_more, alpha_more, beta_more, phi_more, theta_more = rates[6:]
        level = np.hypot(u, w)
        faster = V_more / np.hypot(level, v)
        made[0] += faster * u - alpha_more * w - beta_more * u * v / level
        made[1] += faster * v + beta_more * level
        made[2] += faster * w + alpha_more * u - beta_more * w * v / level
        made[6] += phi_more
        made[7] += theta_more
        return made


def _with_inertia(flight: Flight) -> Aircraft:
    """The aircraft; without moments of inertia it has some, as moments then are those that turn it as recorded."""
    if flight.craft.inertia is not None:
        return flight.craft
    some = float(flight["mass"][0]) * flight.craft.b**2
    return flight.craft.model_copy(update={"inertia": Inertia(Ix=some, Iy=some, Iz=some)})


def _columns(told: Told, craft: Aircraft) -> tuple[Array, ...]:
    """Rates, what is given, slopes, path and readings of one flight, as `_Table` has them."""
    f, ch = told.flight, told.flight.channels
    missing = tuple(c for c in _RATES if not all(c in one for one in told.stages.values()))
    measured: dict[str, Array] = {}
    if missing:
        plain = {**ch, **f.raw, **{c: ch[c] for c in ("V", "alpha", "beta")}}
        plain |= {f"{c}_dot": f.rate(plain[c]) for c in "pqr"}
        measured = respond(plain, craft, f.dt, missing)
    rates = np.array([[measured.get(c, one.get(c)) for one in told.stages.values()] for c in _RATES])
    path = np.array([ch[c] for c in _FLOWN])
    read = np.array([f.raw.get(c, ch[c]) for c in _FLOWN])
    at_centre = rb.air_data_at_cg(path[0], path[1], path[2], path[3], path[4], path[5], tuple(craft.position("vane")))
    given = np.array([ch["rho"] * ch["qbar_ratio"], ch["mass"], ch["thrust"], *at_centre, *path[3:6]])
    slopes = np.array([[np.broadcast_to(f.slope(c, x), len(f)) for x in _AIR] for c in COEFFICIENTS])
    return rates, given, slopes, path, read


def _stretch(told: Sequence[Told], table: _Table, flown: Array, channel: str, fallen: Array) -> Stretch:
    """Windows of the flight in which a channel gained most, a few about the one that gained most if it has many."""
    owner = int(np.argmax(np.bincount(table.owner, fallen)))
    mine = np.flatnonzero(table.owner == owner)
    few = max(1, _DRAWN // int(table.length.max()))
    first = int(np.argmax(fallen[mine])) - few // 2
    mine = mine[max(0, min(first, len(mine) - few)) :][:few]
    f = told[owner].flight
    j = tuple(_FLOWN).index(channel)
    before = int(table.start[table.owner == owner][0])

    def joined(each: Sequence[Array], gap: bool = True) -> Array:
        return np.concatenate([np.append(x, np.nan if gap else x[-1]) for x in each])

    spans = [slice(table.start[w], table.start[w] + table.length[w] + 1) for w in mine]
    return Stretch(
        f.name,
        channel,
        joined([f.t[s.start - before : s.stop - before] for s in spans], gap=False),
        joined([table.read[j, s] for s in spans]),
        joined([table.path[j, s] for s in spans]),
        {stage: joined([flown[: table.length[w] + 1, j, k, w] for w in mine])
         for k, stage in enumerate(told[0].stages)},
    )  # fmt: skip
