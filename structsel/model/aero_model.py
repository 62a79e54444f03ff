"""AeroModel: several responses, evaluated, saved and shown together."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from structsel.candidates import Term
from structsel.deprecation import renamed_attribute
from structsel.errors import ArgumentError, ModelError, StructselError
from structsel.formatting import count_of, join_names
from structsel.model import files
from structsel.model.dynamics import Quantity, State
from structsel.model.ranges import RangeExcursion, check_outside, find_excursions, report_excursions
from structsel.model.response import ResponseModel, response_rows
from structsel.nomenclature import latex_of
from structsel.provenance import provenance_of
from structsel.recording import Recording
from structsel.results import Result
from structsel.tables import Summary

if TYPE_CHECKING:
    import pandas as pd

_RANGES = "the ranges the model was identified in"
_EACH = 3  # recordings with the same warning that have a line each


@dataclass(frozen=True, eq=False, repr=False)
class AeroModel(Result):
    """A model of one or more responses, normally the aerodynamic coefficients.

    Attributes
    ----------
    responses : mapping of response name to ResponseModel
    name : str
    recordings : tuple of str
        Names of the recordings it was identified from.
    refinement : str
        Verdict of the refinement, as `structsel.refinement.Refinement.statement`; empty for a model that was not
        refined. In model.json it is part of the provenance.
    """

    responses: Mapping[str, ResponseModel]
    name: str = ""
    recordings: tuple[str, ...] = ()
    refinement: str = field(default="", kw_only=True)

    region = renamed_attribute("ranges")
    steady = renamed_attribute("quasi_steady")
    leaves_region = renamed_attribute("range_excursions")

    def __post_init__(self) -> None:
        if not self.responses:
            raise ModelError("A model needs at least one response; it was given none.")
        object.__setattr__(self, "responses", MappingProxyType(dict(self.responses)))
        object.__setattr__(self, "recordings", tuple(self.recordings))
        for name, state in self.states.items():
            if any(m.states.get(name, state) != state for m in self.responses.values()):
                raise ModelError(f"The responses mean different things by the state '{name}'. Rename one.")

    @classmethod
    def from_terms(cls, terms: Mapping[str, Mapping[str, float]], name: str = "", **fields: Any) -> AeroModel:
        """Model of given values, such as published ones.

        Parameters
        ----------
        terms : mapping of response to mapping of term to value
            ``{"CZ": {"1": -0.055, "alpha": -5.6}}``; "1" is the constant.
        name : str
        **fields
            Further fields of every `ResponseModel`.

        Raises
        ------
        TermError
            A term that cannot be read.
        ArgumentError
            The values are not given as mappings.
        """
        if not (isinstance(terms, Mapping) and all(isinstance(held, Mapping) for held in terms.values())):
            raise ArgumentError(
                "from_terms needs the values of terms by response.",
                remedy='Pass such as {"CZ": {"1": -0.055, "alpha": -5.6}}; "1" is the constant.',
            )
        responses = {
            response: ResponseModel(tuple(map(Term, held)), np.array(list(held.values()), dtype=float), **fields)
            for response, held in terms.items()
        }
        return cls(responses, name)

    def __eq__(self, other: object) -> bool:
        return self.to_dict() == other.to_dict() if isinstance(other, AeroModel) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def __getitem__(self, response: str) -> ResponseModel:
        """Model of one response.

        Raises
        ------
        ModelError
            There is none of that name.
        """
        if response not in self.responses:
            raise ModelError(f"The model has no response '{response}'. It has: {', '.join(self.responses)}.")
        return self.responses[response]

    def __contains__(self, response: object) -> bool:
        return response in self.responses

    def __iter__(self) -> Iterator[str]:
        return iter(self.responses)

    def __len__(self) -> int:
        return len(self.responses)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels the model needs, sorted."""
        return tuple(sorted({name for model in self.responses.values() for name in model.channels}))

    @property
    def states(self) -> dict[str, State]:
        """States named by the terms: signals with dynamics of their own."""
        return {name: state for model in self.responses.values() for name, state in model.states.items()}

    def quasi_steady(self) -> AeroModel:
        """The model without dynamics: every state at its steady value."""
        if not self.states:
            return self
        still = {name: m.quasi_steady() for name, m in self.responses.items()}
        return AeroModel(still, self.name, self.recordings, refinement=self.refinement)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Ranges recorded for every response: per channel needed, the part common to those that state one."""
        ranges: dict[str, tuple[float, float]] = {}
        for model in self.responses.values():
            for name in model.channels:
                if name in model.ranges:
                    low, high = model.ranges[name]
                    known = ranges.get(name, (-math.inf, math.inf))
                    ranges[name] = (max(low, known[0]), min(high, known[1]))
        return dict(sorted(ranges.items()))

    def range_excursions(self, source: Any) -> tuple[RangeExcursion, ...]:
        """Channels that a recording takes outside the recorded ranges, and how far."""
        return find_excursions(source, self.ranges)

    def warnings_on(self, recordings: Recording | Sequence[Recording]) -> list[str]:
        """Reasons to doubt the model on recordings: they leave the recorded ranges, or were used to identify it.

        Of many recordings that leave the range of a channel, the one that leaves it farthest is described.
        """
        given = [recordings] if isinstance(recordings, Recording) else list(recordings)
        found = [(recording.name, one) for recording in given for one in self.range_excursions(recording)]
        texts = []
        by_channel = {one.channel: [pair for pair in found if pair[1].channel == one.channel] for _, one in found}
        if max(map(len, by_channel.values()), default=0) <= _EACH:
            texts = [f"'{name}' leaves {_RANGES}: {one}" for name, one in found]
        else:
            for several in by_channel.values():
                name, one = max(several, key=lambda pair: max(pair[1].below, pair[1].above))
                leave = f"{len(several)} of {len(given)} recordings leave {_RANGES}"
                texts.append(f"{leave}, '{name}' farthest: {one}")
        return texts + self.identification_warnings(given)

    def identification_warnings(self, recordings: Sequence[Recording]) -> list[str]:
        """Notes on the recordings that were used to identify the model."""
        used = [f"'{recording.name}'" for recording in recordings if recording.name in self.recordings]
        if len(used) <= _EACH:
            return [f"{name} was used to identify the model: its scores describe the fit." for name in used]
        return [f"{join_names(used)} were used to identify the model: their scores describe the fit."]

    def evaluate(self, source: Any, *, outside: Literal["warn", "ignore", "raise"] = "warn") -> dict[str, np.ndarray]:
        """Every response on a recording or mapping of arrays.

        Parameters
        ----------
        source : Recording or mapping of name to (n,) array [SI]
        outside : {"warn", "ignore", "raise"}
            What to do where the recording leaves the ranges the model was identified in.

        Returns
        -------
        dict of response name to (n,) array

        Raises
        ------
        ChannelError, DataError, TermError
            A channel is missing or not finite, or a formula does not hold.
        ModelError
            A range is left and ``outside`` is ``"raise"``.

        Warns
        -----
        StructselWarning
            A range is left: names each channel, the fraction of the samples and the distance.
        """
        check_outside(outside)
        known: dict[Any, np.ndarray] = {}
        values = {name: model.evaluate(source, known=known) for name, model in self.responses.items()}
        if outside != "ignore":
            whose = repr(source.name) if isinstance(getattr(source, "name", None), str) else "The source"
            report_excursions(whose, self.range_excursions(source), outside, stacklevel=2)
        return values

    def predict(self, recording: Recording, *, outside: Literal["warn", "ignore", "raise"] = "warn") -> Recording:
        """Return the recording with the model's values as its responses; see `evaluate`."""
        note = f"{', '.join(self.responses)} from {f'model {self.name!r}' if self.name else 'a model'}"
        values = self.evaluate(recording, outside=outside)
        return recording.with_channels(note=note, **cast(Any, values))

    # --- files and tables --------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Return the content of model.json, without its provenance."""
        states = {name: state.to_dict() for name, state in self.states.items()}
        return {
            "schema": files.SCHEMA,
            "name": self.name,
            "recordings": list(self.recordings),
            **({"states": states} if states else {}),
            "responses": {name: model.to_dict() for name, model in self.responses.items()},
        }

    def to_json(
        self, path: str | os.PathLike[str], *, overwrite: bool = False, provenance: Mapping[str, Any] | None = None
    ) -> None:
        """Write model.json; numbers read back to the last bit.

        Parameters
        ----------
        path : path
        overwrite : bool
        provenance : mapping, optional
            As `structsel.provenance.provenance_of`, with the files that the model was identified from; versions alone
            if not given.

        Raises
        ------
        ModelError
            The file exists and ``overwrite`` is False, or it cannot be written.
        """
        made = provenance_of() if provenance is None else dict(provenance)
        made |= {"refinement": self.refinement} if self.refinement else {}
        files.write(path, {**self.to_dict(), "provenance": made}, overwrite)

    @classmethod
    def from_json(cls, path: str | os.PathLike[str]) -> AeroModel:
        """Read model.json.

        Only ``schema`` and, per response, ``terms`` and ``values`` are needed, so that a model can be
        written by hand.

        Raises
        ------
        ModelError
            The file is missing or does not fit the schema; names the file and the place in it.
        """
        held = files.read(path)
        states = {name: _state(path, name, fields) for name, fields in held["states"].items()}
        responses = {}
        for name, fields in held["responses"].items():
            fields["ranges"] = fields.pop("region")  # the name in the file's schema
            for unknown in ("s2", "r2"):
                fields[unknown] = math.nan if fields[unknown] is None else fields[unknown]
            if fields["standard_errors"] is not None:
                fields["standard_errors"] = [math.nan if v is None else v for v in fields["standard_errors"]]
            try:
                responses[name] = ResponseModel(**fields, states=states)
            except (StructselError, ValueError) as error:
                raise ModelError(f"Model file '{path}', response '{name}': {error}") from error
        try:
            verdict = held["provenance"].get("refinement", "")
            stated = verdict if isinstance(verdict, str) else ""
            return cls(responses, held["name"], tuple(held["recordings"]), refinement=stated)
        except ModelError as error:
            raise ModelError(f"Model file '{path}': {error}") from error

    def to_frame(self) -> pd.DataFrame:
        """One row per response and term: response, term, value, std_error, t, low and high (95 %), held."""
        import pandas as pd

        rows = [row for name, model in self.responses.items() for row in response_rows(name, model)]
        return pd.DataFrame(rows, columns=["response", "term", "value", "std_error", "t", "low", "high", "held"])

    def latex(self) -> str:
        r"""Return a table in LaTeX, for a document that loads booktabs."""
        lines = [
            r"\begin{tabular}{llrrrrr}",
            r"\toprule",
            r"Response & Term & Value & Std.\ error & $t$ & \multicolumn{2}{c}{95\,\% interval} \\",
        ]
        for name, model in self.responses.items():
            lines.append(r"\midrule")
            shown = f"${latex_of(name)}$"
            for term, row in zip(model.terms, response_rows(name, model)):
                digits = {"value": 5, "std_error": 3, "t": 3, "low": 5, "high": 5}
                figures = [_latex_figure(row[column], d) for column, d in digits.items()]
                name_of_term = f"${term.latex()}$" + r"\,(held)" * row["held"]
                lines.append(" & ".join([shown, name_of_term, *figures]) + r" \\")
                shown = ""
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])

    def summary(self) -> Summary:
        """Verdict of the refinement, every response with its terms and estimates, and the internal states."""
        parts = [model.summary(name) for name, model in self.responses.items()]
        if self.states:
            parts.append(Summary("States", notes=tuple(f"  {name}: {state}" for name, state in self.states.items())))
        if not self.refinement:
            return Summary("", self.heading, parts=tuple(parts))
        return Summary("Refinement", self.refinement, parts=(Summary("", self.heading), *parts))

    @property
    def heading(self) -> str:
        """Name, number of responses, and recordings it was identified from."""
        origin = f", identified from {', '.join(self.recordings)}" if self.recordings else ""
        name = f"Model {self.name!r}" if self.name else "Model"
        return f"{name} of {count_of(len(self.responses), 'response')}{origin}"


def _state(path: Any, name: str, fields: Mapping[str, Any]) -> State:
    try:
        parts = {
            p: Quantity(q["value"], math.nan if q["std"] is None else q["std"], q["unit"])
            for p, q in fields["parameters"].items()
        }
        return State(fields["kind"], fields["input"], parts)
    except ModelError as error:
        raise ModelError(f"Model file '{path}', state '{name}': {error}") from error


def _latex_figure(value: float, digits: int) -> str:
    if not math.isfinite(value):
        return "--"
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    return f"${mantissa}$" if not exponent else rf"${mantissa} \times 10^{{{int(exponent)}}}$"
