"""What a hypothesis is: physics that a simulation may lack, as a signature over all responses with few parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from structsel.aircraft import Aircraft
from structsel.candidates import Term
from structsel.comparison.flight import Flight
from structsel.effects.truth_case import TruthCase
from structsel.formatting import format_number
from structsel.model import Quantity, ResponseModel, State
from structsel.numerics.arrays import Array

Kind = Literal[
    "static", "memory", "sensor", "actuator", "propulsive", "inertial", "atmospheric", "structural", "parameter",
    "random",
]  # fmt: skip
Flights = Sequence[Flight]
Columns = Mapping[str, Array]
Weights = dict[str, dict[Term, Array]]

_LEAST_LEFT = 0.1  # of what would be without, where an effect is estimated to have taken most of it


@dataclass(frozen=True)
class EffectParameter:
    """One linear parameter of a signature.

    Attributes
    ----------
    name : str
    unit : str
    sd : float
        Prior standard deviation about zero, in its unit: how large it usually is where the effect is real.
    low, high : float
        What is physically plausible; a sign is a limit at zero.
    of_outcome : bool
        The signature is a fraction x of a result with the effect (a reading in error, an acceleration with the wrong
        mass); stated is the fraction of the result without it, x / (1 - x).
    of_beginning : bool
        How one flight begins, which no simulation knows. It is estimated, not stated.
    """

    name: str
    unit: str
    sd: float
    low: float = -float("inf")
    high: float = float("inf")
    of_outcome: bool = False
    of_beginning: bool = False

    def estimate(self, value: float, std: float) -> ParameterEstimate:
        """The parameter as it is stated, from the coefficient of its signature in `unit` and its standard deviation."""
        if not self.of_outcome:
            return ParameterEstimate(value, std, self.unit)
        left = max(1.0 - value, _LEAST_LEFT)
        return ParameterEstimate(value / left, std / left**2, self.unit)


@dataclass(frozen=True)
class Variant:
    """One form an effect may take: its nonlinear parameters given, the rest linear.

    Attributes
    ----------
    parameters : tuple of EffectParameter
    columns : callable
        Flight to mapping of response to (n, k) array: what one unit of each parameter adds to measured less
        simulated, k in the order of `parameters`. A response not in it gets nothing.
    shape : mapping of name to float
        The nonlinear parameters.
    units : mapping of name to str
        Of `shape`.
    about : str
        What sets this form apart, for a reader: the term, the channel, the control.
    terms : tuple of str
        The same as terms of a model, where it has such.
    only_in : tuple of str
        Manoeuvres it is confined to, where these were chosen by the differences; empty for all.
    model : callable, optional
        `ModelCase` to the `ModelForm` that the estimated effect is in a model, or None where it is none there. Where
        it is not given, terms are found whose sums the columns are, if there are any.
    words : mapping of str to str
        Parts of the sentence that states it.
    spread : mapping of name to float
        Standard deviations of those of `shape` that were estimated from the differences.
    times : tuple of str
        Those of `shape` that are times of events, which were searched in the differences.
    again : callable, optional
        Values of `shape`, in its order, to this form with them; see `of_shape`.
    searched : float
        Log of the number of forms that the differences can tell from each other, among which the values of `shape`
        were searched, over those of the effect.
    """

    parameters: tuple[EffectParameter, ...]
    columns: Callable[[Flight], Columns]
    shape: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    about: str = ""
    terms: tuple[str, ...] = ()
    only_in: tuple[str, ...] = ()
    model: Callable[[ModelCase], ModelForm | None] | None = None
    words: Mapping[str, str] = field(default_factory=dict)
    spread: Mapping[str, float] = field(default_factory=dict)
    times: tuple[str, ...] = ()
    again: Callable[..., Variant] | None = None
    searched: float = 0.0

    def stated(self, estimates: Mapping[str, ParameterEstimate]) -> dict[str, ParameterEstimate]:
        """Estimates of the parameters that a reader is told."""
        hidden = {p.name for p in self.parameters if p.of_beginning}
        return {name: e for name, e in estimates.items() if name not in hidden}

    def is_like(self, other: Variant) -> bool:
        """Whether another form differs in the values of its shape at most."""
        return (
            set(self.shape) == set(other.shape)
            and (self.about, self.only_in) == (other.about, other.only_in)
            and [p.name for p in self.parameters] == [p.name for p in other.parameters]
        )


def of_shape(make: Callable[..., Variant], *values: float) -> Variant:
    """The form with some values of its shape, which the differences may refine.

    Parameters
    ----------
    make : callable
        Values of `Variant.shape`, in its order and none of them zero, to the form.
    values : float
    """
    return replace(make(*values), again=make)


@dataclass(frozen=True)
class ParameterEstimate:
    """A parameter as found, linear or of the shape."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelForm:
    """Terms and states of one effect.

    Attributes
    ----------
    terms : mapping of response to mapping of Term to (k,) array
        Value of each term per unit of the effect's k linear parameters. Responses may be CL and CD beside CX and CZ.
    fixed : mapping of response to mapping of Term to float
        Terms whose values do not depend on the parameters.
    states : mapping of name to State
    replaced : mapping of response to mapping of channel to formula
        Replaces a channel in the terms that the simulation has.
    """

    terms: Weights = field(default_factory=dict)
    fixed: Mapping[str, Mapping[Term, float]] = field(default_factory=dict)
    states: Mapping[str, State] = field(default_factory=dict)
    replaced: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ModelCase:
    """An effect with its estimates, and the simulation and flights it was estimated with.

    Attributes
    ----------
    variant : Variant
    estimates : mapping of parameter to ParameterEstimate
    aircraft : Aircraft
    base : mapping of response to ResponseModel
        The simulation.
    flights : sequence of Flight
    """

    variant: Variant
    estimates: Mapping[str, ParameterEstimate]
    aircraft: Aircraft
    base: Mapping[str, ResponseModel]
    flights: Sequence[Flight]

    def quantity(self, name: str, scale: float = 1.0, unit: str | None = None) -> Quantity:
        """A parameter: of the shape as the form has it, else as estimated."""
        e = self.estimates[name]
        value = self.variant.shape.get(name, e.value)
        return Quantity(float(value) * scale, e.std * abs(scale), e.unit if unit is None else unit)

    @property
    def used_channels(self) -> set[str]:
        """Channels that the simulation's terms contain."""
        return {c for model in self.base.values() for c in model.channels}

    def lift(self) -> list[tuple[Term, float]]:
        """Terms of the simulated lift coefficient CL, with their values."""
        if "CL" in self.base:
            return list(zip(self.base["CL"].terms, self.base["CL"].values.tolist()))
        made = []
        for c, turned, sign in (("CX", Term("sin(alpha)"), 1.0), ("CZ", Term("cos(alpha)"), -1.0)):
            if c in self.base:
                made += [(t * turned, sign * v) for t, v in zip(self.base[c].terms, self.base[c].values.tolist())]
        return made


@dataclass(frozen=True)
class FittedEffect:
    """An effect with its estimated parameters.

    Attributes
    ----------
    variant : Variant
        The best of its forms.
    estimates : mapping of name to ParameterEstimate
    size : mapping of response to float
        Rms of the signature over all flights, in the response's unit; responses it does not touch are left out.
    """

    variant: Variant
    estimates: Mapping[str, ParameterEstimate]
    size: Mapping[str, float]

    def __getitem__(self, name: str) -> float:
        return self.estimates[name].value

    def text(self, name: str, scale: float = 1.0, unit: str | None = None) -> str:
        """Parameter as "0.31 +- 0.04 s", without a standard error that is not known; `scale` to another unit."""
        e = self.estimates[name]
        shown = e.unit if unit is None else unit
        error = f" +- {format_number(e.std * scale, 1)}" if e.std > 0.0 else ""
        return f"{format_number(e.value * scale, 3)}{error} {shown}".rstrip(" -")


@dataclass(frozen=True)
class Effect:
    """Physics that a simulation may lack.

    Attributes
    ----------
    name : str
        As in the table of effects.
    kind : str
    what : str
        One sentence: the physics.
    needs : callable
        Flights to what is lacking for it to be tried ("height below one span"); empty where it can be.
    variants : callable
        Flights to the forms it may take.
    says : callable
        FittedEffect to one plain sentence with numbers and units.
    look_alikes : tuple of str
        Effects that the same data may also say.
    separated_by : str
        The manoeuvre or measurement that tells them apart.
    check : str
        What to look at on the aircraft or in the simulation.
    log_prior : float
        Of the effect as against the others.
    event : bool
        True where it acts at times sought in the differences, so that other manoeuvres cannot predict it.
    switched : callable, optional
        Flights to the forms, as they are when they are on, that may be on in some manoeuvres or parts of them only.
    may_end : bool
        Whether such a form may end in a manoeuvre.
    durations : tuple of float [s]
        Of its beginning and end.
    truth : TruthCase, optional
        Its case in the proof. None where ``proof`` has a generator of its own for it, or no case.
    """

    name: str
    kind: Kind
    what: str
    needs: Callable[[Flights], str]
    variants: Callable[[Flights], Sequence[Variant]]
    says: Callable[[FittedEffect], str]
    look_alikes: tuple[str, ...] = ()
    separated_by: str = ""
    check: str = ""
    log_prior: float = 0.0
    event: bool = False
    switched: Callable[[Flights], Sequence[Variant]] | None = None
    may_end: bool = True
    durations: tuple[float, ...] = (0.0,)
    truth: TruthCase | None = None
