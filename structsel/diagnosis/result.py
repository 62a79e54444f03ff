"""Result of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from structsel.deprecation import renamed_attribute
from structsel.diagnosis.event import Event
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
"""Name of an effect that is not in the library."""
LISTED = 0.005
"""Probability from which an effect is listed after the most probable one."""
_EXCEEDED = 4.0  # standard deviations from which a tolerance is exceeded


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
        Reason why the parameters are implausible; empty if they are plausible.
    check : str
        Recommended check of the aircraft or the simulation.
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
    """Errors of one response on held-out flights, at three stages.

    Attributes
    ----------
    delivered, refitted, physics : ResponseFit
        The simulation as given, retuned within tolerances, and with the effects found.
    """

    delivered: ResponseFit
    refitted: ResponseFit
    physics: ResponseFit


@dataclass(frozen=True)
class EffectFinding:
    """One effect that the simulation lacks.

    Attributes
    ----------
    axes : tuple of str
        Responses in which it shows, the clearest first.
    kind : str
    physics : tuple of Physics
        The most probable first.
    intervals : mapping of recording to intervals [s]
        Times at which it acts; empty if it acts all the time.
    region : mapping of channel to (low, high)
        Ranges of channels in which it acts; empty if it acts in all recorded conditions.
    ambiguous_with : tuple of str
        Effects that these recordings cannot distinguish from the first, the most probable first; "unknown" last, if
        the residual of all effects is too large.
    to_separate : str
        Manoeuvre that would distinguish them: in words, and the best of those that were simulated.
    manoeuvre : Recording, optional
        Inputs of that manoeuvre, deviations from trim; only for ambiguous effects that one distinguishes.
    events : tuple of Event
        Times at which the differences change, if such a change was detected.
    is_fitted : bool
        Whether the effect was added to the simulation; a mismatch that was only detected has no errors with it.
    bars : mapping of response to Bars
        After this finding and those before it.
    explainable, explained : float
        Fractions of the variance of the differences: by a regression on all channels; by this effect and those before.
    fraction : float
        Of the gain of all findings: the decrease of the logarithm of the residual power.
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
    fraction: float
    manoeuvre: Recording | None = None
    events: tuple[Event, ...] = ()
    is_fitted: bool = True

    share = renamed_attribute("fraction")

    @property
    def effect(self) -> str:
        """Name of the most probable effect."""
        return self.physics[0].effect

    @property
    def probability(self) -> float:
        """Probability of this mismatch: the sum over the effects that may cause it."""
        return min(1.0, sum(p.probability for p in self.physics))

    def to_dict(self) -> dict[str, Any]:
        """For diagnosis.json."""
        where: dict[str, Any] = {}
        if self.intervals:
            where["intervals"] = {name: [list(s) for s in each] for name, each in self.intervals.items()}
        if self.events:
            where["events"] = [e.to_dict() for e in self.events]
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
            "share": self.fraction,
        }


@dataclass(frozen=True)
class ToleranceDeviation:
    """Estimated deviation of one parameter from its stated value.

    Attributes
    ----------
    name : str
    deviations : float
        In stated standard deviations, the tolerance of the parameter.
    value, std : float
    unit : str
    """

    name: str
    deviations: float
    value: float
    std: float
    unit: str

    is_strained = renamed_attribute("is_exceeded")

    @property
    def is_exceeded(self) -> bool:
        """Whether the deviation exceeds the tolerance beyond doubt."""
        return abs(self.deviations) > _EXCEEDED


@dataclass(frozen=True, eq=False)
class Trace:
    """Time histories for the plots of one recording.

    Attributes
    ----------
    t : (n,) array [s]
    measured, simulated, refitted, explained : mapping of response to (n,) array
        In the compared band: measured, simulated as given, retuned within tolerances, and with the effects.
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
    """Effects that the simulation lacks, and the evidence for them.

    Attributes
    ----------
    verdict : {"mismatch", "consistent", "undecidable"}
    findings : tuple of EffectFinding
        The one that explains most first.
    not_testable : mapping of effect to what it needs
    remaining : mapping of response to (rrmse, white)
        Residual after the last finding.
    deviations : tuple of ToleranceDeviation
        Deviations from the stated values, the largest first.
    remarks : tuple of str
        Warnings and notes.
    form : str
        Form of the simulation.
    responses : tuple of str
    recordings : tuple of str
    held_out : tuple of str
        Recordings that were held out by name; empty if each was held out in turn.
    model : AeroModel or None
        The simulation with the missing effects.
    traces : mapping of recording to Trace
    detects : mapping of effect to mapping of str to float
        The self-test: ``size`` (smallest fraction of the rms, in its clearest response, at which it would be named),
        and for similar effects the log Bayes factor that separates them from it.
    seconds : float
    replayed : HeldOutSimulation or None
        Simulation of held-out recordings in short windows.
    considered : float
        Probability of a mismatch if none is found.
    levels : mapping of response to float
        Constant part of the residual in the unit of the response: mean over the recordings.
    """

    verdict: Verdict
    findings: tuple[EffectFinding, ...]
    not_testable: Mapping[str, str]
    remaining: Mapping[str, tuple[float, bool]]
    deviations: tuple[ToleranceDeviation, ...]
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
        """Probability of any mismatch beyond the stated tolerances, except turbulence."""
        return max([self.considered, *(f.probability for f in self.findings if f.kind != "random")])

    pulls = renamed_attribute("deviations")

    @property
    def within_tolerances(self) -> bool:
        """Whether no parameter had to leave its stated tolerance for recordings and simulation to agree."""
        return not any(one.is_exceeded for one in self.deviations)

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
                for p in self.deviations
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
        from structsel.diagnosis.text_report import headline  # the text report imports the results, not the reverse

        rows = tuple(
            (f.effect, f.physics[0].probability, ", ".join(f.axes), f.explained, f.physics[0].says)
            for f in self.findings
        )
        return Summary("", headline(self), tables=(Table(_COLUMNS, rows),), warnings=self.remarks)

    def __str__(self) -> str:
        from structsel.diagnosis.text_report import text_report

        return text_report(self)
