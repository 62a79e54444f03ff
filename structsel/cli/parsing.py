"""Parsing of option values: names, numbers by name, ranges."""

from __future__ import annotations

from collections.abc import Iterable

import typer


def split_names(text: str) -> list[str]:
    """Names separated by commas; empty names are left out."""
    return [name.strip() for name in text.split(",") if name.strip()]


def read_texts(option: str, texts: Iterable[str], form: str) -> dict[str, str]:
    """Texts by name, from texts such as ``m01=phugoid``; `form` is their form in the message.

    Raises
    ------
    BadParameter
        One has no name or no value.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value:
            raise typer.BadParameter(f"{option} '{text}' is not {form}.")
        found[name] = value
    return found


def read_numbers(name: str, text: str, example: str = "alpha=0.002,q=0.001") -> dict[str, float]:
    """Numbers by name, ``alpha=0.002,q=0.001``.

    Raises
    ------
    BadParameter
        It is not of that form.
    """
    found: dict[str, float] = {}
    for part in split_names(text):
        key, equals, value = part.partition("=")
        try:
            if not equals:
                raise ValueError
            found[key.strip()] = float(value)
        except ValueError:
            raise typer.BadParameter(f"{name} '{text}' is not NAME=NUMBER,... as {example}.") from None
    return found


def read_pair(name: str, text: str, example: str = "0.05,2") -> tuple[float, float]:
    """Two numbers, ``0.05,2``.

    Raises
    ------
    BadParameter
        It is not of that form.
    """
    try:
        low, high = (float(value) for value in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{name} '{text}' is not LOW,HIGH as {example}.") from None
    return low, high


def read_pairs(name: str, texts: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Two numbers by name, from texts such as ``Cm:alpha=-3,0``.

    Raises
    ------
    BadParameter
        One is not of that form.
    """
    parts = (text.partition("=") for text in texts)
    return {key.strip(): read_pair(f"{name} {key}=", pair, "Cm:alpha=-3,0") for key, _, pair in parts}
