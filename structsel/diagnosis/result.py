"""What a diagnosis says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from structsel.diagnosis.held_out_result import HeldOutSimulation
from structsel.diagnosis.judging import ResponseFit
from structsel.effects.base import ParameterEstimate
from structsel.model import AeroModel
from structsel.numerics.arrays import Array
from structsel.recording import Recording
from structsel.results import Result
from structsel.tables import Column, Summary, Table, text_column

Verdict = Literal["mismatch", "consistent", "undecidable"]
SCHEMA = "structsel.diagnosis/2"
UNNAMED = "unknown"
LISTED = 0.005
"""Probability from which an effect is listed beside the likeliest."""
"""Name of physics that no hypothesis carries."""
_STRAINED = 4.0  # stated standard deviations of a tolerance, beyond which it is none


_COLUMNS = (
    text_column("effect"),
    Column("probability", "2f"),
    text_column("axes"),
    Column("explained", "%"),
    text_column("description"),
)


@dataclass(frozen=True)
class Physics:
    """One explanation of a finding.

    Attributes
    ----------
    effect : str
    probability : float
    says : str
        One plain sentence with numbers and units.
    parameters : mapping of name to ParameterEstimate
    terms : tuple of str
    plausible : str
        Empty, or what is implausible about the parameters.
    check : str
        What to look at on the aircraft or in the simulation.
    """

    effect: str
    probability: float
    says: str
    parameters: Mapping[str, ParameterEstimate] = field(default_factory=dict)
    terms: tuple[str, ...] = ()
    plausible: str = ""
    check: str = ""


@dataclass(frozen=True)
class Bars:
    """One response on flights not used for fitting, three times.

    Attributes
    ----------
    delivered, refitted, physics : ResponseFit
        The simulation as it came, refitted within tolerances, and with the physics found.
    """

    delivered: ResponseFit
    refitted: ResponseFit
    physics: ResponseFit


@dataclass(frozen=True)
class Event:
    """A change at one moment of a recording.

    Attributes
    ----------
    recording : str
    t, std : float [s]
        When, and its standard deviation.
    shape : str
        "step", "ramp" or "pulse".
    """

    recording: str
    t: float
    std: float
    shape: str


@dataclass(frozen=True)
class EffectFinding:
    """One effect that the simulation lacks.

    Attributes
    ----------
    axes : tuple of str
        Responses it shows in, the clearest first.
    kind : str
    physics : tuple of Physics
        Likeliest first.
    intervals : mapping of recording to stretches [s]
        When it acts; empty where it acts all the time.
    region : mapping of channel to (low, high)
        Channels that bound it; empty where it acts everywhere flown.
    ambiguous_with : tuple of str
        Effects that these recordings cannot tell from the first, likeliest first; "unknown" last, where all that was
        found leaves too much.
    to_separate : str
        What would: in words, and of manoeuvres tried with the simulation the best.
    manoeuvre : Recording, optional
        That one's inputs, departures from trim; with a tie only, where one tells the two apart.
    events : tuple of Event
        Moments at which the differences change, where that is what was detected.
    bars : mapping of response to Bars
        After this finding and those before it.
    explainable, explained : float
        Shares of the mismatch variance: by any function of the channels; by this physics (and those before).
    share : float
        Of the explained mismatch, that this effect carries.
    """

    axes: tuple[str, ...]
    kind: str
    physics: tuple[Physics, ...]
    intervals: Mapping[str, list[tuple[float, float]]]
    region: Mapping[str, tuple[float, float]]
    ambiguous_with: tuple[str, ...]
    to_separate: str
    bars: Mapping[str, Bars]
    explainable: float
    explained: float
    share: float
    manoeuvre: Recording | None = None
    events: tuple[Event, ...] = ()

    @property
    def effect(self) -> str:
        """Name of the likeliest."""
        return self.physics[0].effect

    @property
    def probability(self) -> float:
        """Probability that this mismatch is there, whatever its name: the names share it."""
        return min(1.0, sum(p.probability for p in self.physics))

    def to_dict(self) -> dict[str, Any]:
        """For diagnosis.json."""
        where: dict[str, Any] = {}
        if self.intervals:
            where["intervals"] = {name: [list(s) for s in each] for name, each in self.intervals.items()}
        if self.events:
            where["events"] = [asdict(e) for e in self.events]
        if self.region:
            where["region"] = {name: list(limits) for name, limits in self.region.items()}
        return {
            "probability": round(self.probability, 4),
            "axes": list(self.axes),
            "kind": self.kind,
            "where": where,
            "physics": [
                {
                    "effect": p.effect,
                    "probability": round(p.probability, 4),
                    "says": p.says,
                    "parameters": {
                        n: {"value": e.value, "std": e.std, "unit": e.unit} for n, e in p.parameters.items()
                    },
                    "terms": list(p.terms),
                }
                for p in self.physics
            ],
            "ambiguous_with": list(self.ambiguous_with),
            "to_separate": self.to_separate,
            "fit": {
                "held_out": {
                    "before": {c: b.delivered.to_dict() for c, b in self.bars.items()},
                    "refitted": {c: b.refitted.to_dict() for c, b in self.bars.items()},
                    "after": {c: b.physics.to_dict() for c, b in self.bars.items()},
                },
                "explainable": self.explainable,
                "explained": self.explained,
            },
            "share": self.share,
        }


@dataclass(frozen=True)
class Pull:
    """How hard one tolerance was pulled.

    Attributes
    ----------
    name : str
    deviations : float
        In its stated standard deviations.
    value, std : float
    unit : str
    """

    name: str
    deviations: float
    value: float
    std: float
    unit: str

    @property
    def is_strained(self) -> bool:
        """Whether it is pulled further than any tolerance is."""
        return abs(self.deviations) > _STRAINED


@dataclass(frozen=True, eq=False)
class Trace:
    """Time histories for the plots of one recording.

    Attributes
    ----------
    t : (n,) array [s]
    measured, simulated, refitted, explained : mapping of response to (n,) array
        In the compared band: as measured, as delivered, refitted within tolerances, and with the physics.
    channels : mapping of channel to (n,) array
        Smoothed.
    """

    t: Array
    measured: Mapping[str, Array]
    simulated: Mapping[str, Array]
    refitted: Mapping[str, Array]
    explained: Mapping[str, Array]
    channels: Mapping[str, Array]


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Result):
    """What the simulation leaves out, as far as the recordings can say.

    Attributes
    ----------
    verdict : {"mismatch", "consistent", "undecidable"}
    findings : tuple of EffectFinding
        Largest share of the mismatch first.
    not_testable : mapping of effect to what it needs
    remaining : mapping of response to (rrmse, white)
        What is left after the last finding.
    pulls : tuple of Pull
        Tolerances pulled hardest, first.
    remarks : tuple of str
        Doubts, and what was noticed.
    form : str
        Of the simulation.
    responses : tuple of str
    recordings : tuple of str
    held_out : tuple of str
        Recordings that were held out by name; empty where each was, in turn.
    model : AeroModel or None
        The simulation plus what was missing.
    traces : mapping of recording to Trace
    detects : mapping of effect to mapping of str to float
        The self-test: ``size`` (smallest share of the rms, in its clearest response, at which it would be named) and,
        per rival, nats that tell them apart at the size found or usual.
    seconds : float
    replayed : HeldOutSimulation or None
        The simulation flown again in short windows, on recordings not used for fitting.
    considered : float
        Probability of a mismatch where none is found.
    levels : mapping of response to float
        Constant part of what is left, in the response's unit: mean over the recordings.
    """

    verdict: Verdict
    findings: tuple[EffectFinding, ...]
    not_testable: Mapping[str, str]
    remaining: Mapping[str, tuple[float, bool]]
    pulls: tuple[Pull, ...]
    remarks: tuple[str, ...]
    form: str
    responses: tuple[str, ...]
    recordings: tuple[str, ...]
    held_out: tuple[str, ...] = ()
    model: AeroModel | None = None
    traces: Mapping[str, Trace] = field(default_factory=dict)
    detects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    seconds: float = 0.0
    replayed: HeldOutSimulation | None = None
    considered: float = 0.0
    levels: Mapping[str, float] = field(default_factory=dict)

    @property
    def probability(self) -> float:
        """Probability that anything beyond the stated tolerances and instruments is there; turbulence is not."""
        return max([self.considered, *(f.probability for f in self.findings if f.kind != "random")])

    @property
    def within_tolerances(self) -> bool:
        """Whether no parameter had to leave its stated tolerance for recordings and simulation to agree."""
        return not any(pull.is_strained for pull in self.pulls)

    def to_dict(self) -> dict[str, Any]:
        """Content of diagnosis.json."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "probability": round(self.probability, 4),
            "within_tolerances": self.within_tolerances,
            "findings": [f.to_dict() for f in self.findings],
            "not_testable": [{"effect": e, "needs": n} for e, n in self.not_testable.items()],
            "remaining": {
                c: {"rrmse": r, "level": self.levels.get(c, 0.0), "white": w} for c, (r, w) in self.remaining.items()
            },
            "tolerances": [
                {"name": p.name, "deviations": p.deviations, "value": p.value, "std": p.std, "unit": p.unit}
                for p in self.pulls
            ],
            "remarks": list(self.remarks),
            "form": self.form,
            "responses": list(self.responses),
            "recordings": list(self.recordings),
            "held_out": list(self.held_out),
            "detects": {e: dict(d) for e, d in self.detects.items()},
            "replayed": None if self.replayed is None else self.replayed.to_dict(),
        }

    def summary(self) -> Summary:
        """The verdict and the effects found; ``str`` is the full report."""
        from structsel.diagnosis.story import headline  # the text report imports the results, not the reverse

        rows = tuple(
            (f.effect, f.physics[0].probability, ", ".join(f.axes), f.explained, f.physics[0].says)
            for f in self.findings
        )
        return Summary("", headline(self), tables=(Table(_COLUMNS, rows),), warnings=self.remarks)

    def __str__(self) -> str:
        from structsel.diagnosis.story import tell

        return tell(self)
