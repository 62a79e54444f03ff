"""Errors about channels that a recording lacks, or that are not finite or not above zero, with the likely remedy."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from structsel.errors import ChannelError, DataError, DomainError
from structsel.nomenclature import close_names, find_channel, is_known

_COMMANDS = {
    "reconstruct": "Run structsel reconstruct first, or give --reconstruct, which adds it.",
    "compute_coefficients": "Give --aircraft, and the coefficients are computed first.",
}


def missing_channels_error(
    text: str, recording: str, missing: Sequence[str], available: Collection[str]
) -> ChannelError:
    """Error that begins with `text`, then lists the channels that a recording has, and a remedy.

    Parameters
    ----------
    text : str
        What was requested, such as "select needs channel 'CZ' [-]".
    recording : str
        Name of the recording.
    missing, available : sequence of str
        Channels; `available` without ``t``.
    """
    return ChannelError(
        f"{text}; '{recording}' has none.\nIt has: {', '.join(('t', *available))}.",
        remedy=_remedy(missing, available),
        cli_remedy=_remedy(missing, available, cli=True),
    )


def not_finite_error(text: str, recording: str, t: np.ndarray, values: np.ndarray) -> DataError:
    """Error that begins with `text`, then has the first sample of a channel that is not finite, and their number."""
    bad = np.flatnonzero(~np.isfinite(values))
    i = int(bad[0])
    return DataError(
        f"{text}; in '{recording}' it is {values[i]} at sample {i} (t = {t[i]:g} s), {bad.size} in all.",
        remedy="Take a part without them with recording.between(), or correct the file.",
        cli_remedy="Take a part without them with [file] rows = [first, last] in a channel map.",
    )


def not_above_zero_error(text: str, recording: str, t: np.ndarray, values: np.ndarray) -> DomainError:
    """Error that begins with `text`, then has the first sample that is not above zero, and the longest part that is."""
    bad = np.flatnonzero(~(values > 0.0))
    i = int(bad[0])
    # The longest part in flight is most likely what the user wants.
    edges = np.concatenate(([-1], bad, [len(values)]))
    k = int(np.argmax(np.diff(edges)))
    first, last = int(edges[k]) + 1, int(edges[k + 1]) - 1
    remedy, cli_remedy = "Check the unit and the sign in the channel map.", ""
    if last > first:
        part = f"{t[first]:g}, {t[last]:g}"
        remedy = f"Take the part in flight: recording.between({part}) is the longest."
        cli_remedy = (
            f"Take the part in flight with [file] rows = [first, last] in a channel map; t = {part} s is the longest."
        )
    return DomainError(
        f"{text}; in '{recording}' it is {values[i]:g} at sample {i} (t = {t[i]:g} s), {bad.size} such samples in all.",
        remedy=remedy,
        cli_remedy=cli_remedy,
    )


def _remedy(missing: Sequence[str], available: Collection[str], *, cli: bool = False) -> str:
    """Functions, or commands, that add the missing channels; else similar names; else the channel map."""
    remedies: dict[str, None] = {}
    to_differentiate = []
    for name in missing:
        source = find_channel(name).source if is_known(name) else ""
        if source == "differentiate":
            if name.removesuffix("_dot") in available:
                to_differentiate.append(name.removesuffix("_dot"))
        elif source:
            remedies[_COMMANDS.get(source, "") if cli else f"Run {source}() first, which adds it."] = None
    if to_differentiate:
        quoted = ", ".join(f'"{name}"' for name in to_differentiate)
        calls = f"Run reconstruct() first, which adds it, or recording.differentiate({quoted})."
        remedies[_COMMANDS["reconstruct"] if cli else calls] = None
    for name in missing:
        similar = [other for other in close_names(name, available) if not is_known(other) or not is_known(name)]
        if similar:
            remedies[f"Did you mean {' or '.join(repr(other) for other in similar)} for '{name}'?"] = None
    if not remedies:
        remedies["If the file has it under another name, map it in a channel map."] = None
    return " ".join(remedy for remedy in remedies if remedy)
