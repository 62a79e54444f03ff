"""Every exception and warning structsel raises, in one tree.

::

    StructselError
    ├── ChannelError (ValueError)        a channel is missing, misnamed or of the wrong unit
    ├── DataError (ValueError)           a file or its samples cannot be used
    ├── DomainError (ValueError)         a quantity is outside where the formula holds
    ├── AircraftError (ValueError)       aircraft.toml is incomplete or contradicts itself
    ├── MapError (ValueError)            a channel map does not fit the file
    ├── TermError (ValueError)           a candidate term cannot be read
    ├── ArgumentError (TypeError)        a function was given an object of the wrong type
    ├── ModelError (ValueError)          a model file or a model's use is wrong
    ├── SelectionError (ValueError)      a selection that cannot be made
    └── UnfinishedError (RuntimeError)   a run stopped early; has the partial result
        ├── SimulationError              a flight could not be simulated to its end
        ├── ReconstructionError          a flight path could not be estimated
        └── RefinementError              parameters could not be estimated from flights

    StructselWarning (UserWarning)       the result is valid, but should be checked
"""

from __future__ import annotations

import re

_LONG_WORD, _LONG_LINE = re.compile(r"\S{401,}"), re.compile(r".{2001,}")


class StructselError(Exception):
    """Base of every error structsel raises on purpose.

    Parameters
    ----------
    message : str
        What failed and where, and what is needed.
    remedy : str
        What to do about it, in the library's terms; the last line of the error.
    cli_remedy : str
        The same in terms of the command line, if that is different.
    """

    def __init__(self, message: str = "", *, remedy: str = "", cli_remedy: str = ""):
        super().__init__(f"{message}\n{remedy}" if remedy else message)
        self.cli_text = f"{message}\n{cli_remedy}" if cli_remedy else ""

    def __str__(self) -> str:
        """The message; very long names and lines, as in damaged files, are shortened to both ends."""
        return _shortened(super().__str__())

    @property
    def cli_message(self) -> str:
        """The error with the remedy that a user of the command line can follow."""
        return _shortened(self.cli_text) if self.cli_text else str(self)


def _shortened(text: str) -> str:
    return _LONG_LINE.sub(_ends, _LONG_WORD.sub(_ends, text))


def _ends(found: re.Match[str]) -> str:
    text = found.group()
    return f"{text[:200]}... ({len(text)} characters) ...{text[-40:]}"


class ChannelError(StructselError, ValueError):
    """A channel is missing, misnamed or carries the wrong unit."""


class DataError(StructselError, ValueError):
    """A file, or samples in it, cannot be used as they are."""


class DomainError(StructselError, ValueError):
    """A quantity lies outside the domain of a formula (dynamic pressure at zero, ...)."""


class AircraftError(StructselError, ValueError):
    """An aircraft description is incomplete or contradicts itself."""


class MapError(StructselError, ValueError):
    """A channel map does not fit the file it is used on."""


class TermError(StructselError, ValueError):
    """A candidate term cannot be read or evaluated."""


class ArgumentError(StructselError, TypeError):
    """A function was given an object of a type that it cannot use; the message states the type."""


class ModelError(StructselError, ValueError):
    """A model file, or the use of a model, is wrong."""


class SelectionError(StructselError, ValueError):
    """A selection that cannot be made with these data or options."""


class UnfinishedError(StructselError, RuntimeError):
    """Base of the errors that have the partial result of a run.

    Attributes
    ----------
    partial : object
        Partial result; None if there is none.
    """

    def __init__(self, message: str, partial: object = None, *, remedy: str = "", cli_remedy: str = ""):
        super().__init__(message, remedy=remedy, cli_remedy=cli_remedy)
        self.partial = partial

    def __reduce__(self) -> tuple[type, tuple[str, object], dict[str, object]]:  # for errors of worker processes
        return type(self), (str(self), self.partial), {"cli_text": self.cli_text}


class SimulationError(UnfinishedError):
    """A flight could not be simulated to its end, or there is no trim.

    Attributes
    ----------
    partial : object
        Partial result: a `structsel.recording.Recording` to that sample, or None.
    """


class ReconstructionError(UnfinishedError):
    """A flight path could not be reconstructed.

    Attributes
    ----------
    partial : object
        Partial result: a `structsel.reconstruction.ukf.FilterResult`, or None.
    """


class RefinementError(UnfinishedError):
    """Parameters could not be estimated from complete manoeuvres.

    Attributes
    ----------
    partial : object
        Partial result: a `structsel.refinement.Refinement`, or None.
    """


class StructselWarning(UserWarning):
    """A result is valid, but should be checked."""
