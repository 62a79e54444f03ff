"""The answer key of a case: what the simulation lacks, and which answers are right."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError, field_validator

from structsel.errors import DataError
from structsel.files import write_text

Kind = Literal[
    "static", "memory", "sensor", "actuator", "propulsive", "inertial", "atmospheric", "structural", "parameter",
    "random",
]  # fmt: skip
COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
Verdict = Literal["mismatch", "consistent", "undecidable"]
Form = Literal["forced", "free", "model", "jsbsim", "python"]
Severity = Literal["easy", "medium", "hard", "none"]
Family = Literal["single", "pair", "null", "outside", "clutter"]
Intervals = dict[str, list[tuple[float, float]]]
DECIDABLE = 10.0
"""Log evidence below which an effect cannot be distinguished from what the stated tolerances allow."""
_FROZEN = ConfigDict(extra="forbid", frozen=True)


class EffectKey(BaseModel):
    """One effect that the simulation lacks.

    Attributes
    ----------
    effect : str
        Its name; ``unknown`` for an effect outside the library.
    accept : tuple of str
        Names as right as the first.
    tie : tuple of str
        Names that may be declared ambiguous with it.
    kinds : tuple of str
    axes : tuple of str
        Coefficients (or channels) that it changes, the clearest first.
    region : mapping of channel to (low, high), optional
        Where it acts; None acts everywhere.
    parameters : mapping
        Values of the injected effect; the name gives the unit where it is not SI.
    intervals : mapping of recording to intervals [s], optional
        When it acts; None acts all the time.
    log_evidence : float, optional
        Of an effect of a pair: log Bayes factor of a perfect model of both against one of the other alone.
    """

    model_config = _FROZEN
    effect: str
    accept: tuple[str, ...]
    tie: tuple[str, ...] = ()
    kinds: tuple[Kind, ...]
    axes: tuple[str, ...]
    region: dict[str, tuple[float, float]] | None = None
    parameters: dict[str, float | str] = Field(default_factory=dict)
    intervals: Intervals | None = None
    log_evidence: float | None = None


class Key(BaseModel):
    """Answer key of a case.

    Attributes
    ----------
    verdicts : tuple of str
        Those that are right.
    form : {"forced", "free", "model", "jsbsim", "python"}
        Of the simulation.
    severity : {"easy", "medium", "hard", "none"}
    attainable : mapping of coefficient (or channel) to float
        Fraction by which a perfect model of the effect lowers the rms of measured minus simulated.
    log_evidence : float, optional
        Log Bayes factor of a perfect model of the effects against none, the stated tolerances free in both; None
        where it is not known. Keys of version 0.1.0 call it ``nats``.
    effects : tuple of EffectKey
        The largest first; none in a null.
    source : str
        Plant and aircraft: "polynomial/beaver", "jsbsim/c172p". Keys of version 0.1.0 call the first plant "own".
    family : {"single", "pair", "null", "outside", "clutter"}
    seed : int
    """

    model_config = _FROZEN
    verdicts: tuple[Verdict, ...]
    form: Form
    severity: Severity
    attainable: dict[str, float]
    log_evidence: float | None = Field(default=None, validation_alias=AliasChoices("log_evidence", "nats"))
    effects: tuple[EffectKey, ...] = ()
    source: str = ""
    family: Family = "single"
    seed: int = 0

    @field_validator("source")
    @classmethod
    def _current_name(cls, source: str) -> str:
        return source.replace("own/", "polynomial/") if source.startswith("own/") else source

    def with_log_evidence(self, value: float | None, of_each: Sequence[float] = ()) -> Key:
        """The key with a log evidence, and that of each effect; where the first is too small, "consistent" is right."""
        decidable = value is None or value >= DECIDABLE or "consistent" in self.verdicts
        verdicts = self.verdicts if decidable else (*self.verdicts, "consistent")
        effects = self.effects
        if of_each:
            effects = tuple(e.model_copy(update={"log_evidence": x}) for e, x in zip(effects, of_each, strict=True))
        return self.model_copy(update={"log_evidence": value, "verdicts": verdicts, "effects": effects})

    @property
    def decided(self) -> bool:
        """Whether the data can distinguish the effects from what the stated tolerances allow."""
        if self.log_evidence is None:
            return self.severity in ("easy", "medium")
        return self.log_evidence >= DECIDABLE

    @property
    def each_decided(self) -> bool:
        """Whether the data can distinguish each effect of a pair from the other and the stated tolerances."""
        return all(e.log_evidence is not None and e.log_evidence >= DECIDABLE for e in self.effects)

    def write(self, path: str | Path) -> Path:
        """Write the key as JSON; a key that is there is replaced."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, self.model_dump_json(indent=1) + "\n")
        return path

    @classmethod
    def read(cls, path: str | Path) -> Key:
        """Key from its JSON file.

        Raises
        ------
        DataError
            The file is missing or is no key; the message names it.
        """
        path = Path(path)
        try:
            return cls.model_validate_json(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise DataError(f"key '{path}' cannot be read: {getattr(error, 'strerror', None) or error}.") from error
        except ValidationError as error:
            first: Any = error.errors()[0]
            where = ".".join(map(str, first["loc"])) or "the file"
            raise DataError(f"key '{path}' cannot be used: {where}: {first['msg']}.") from error
