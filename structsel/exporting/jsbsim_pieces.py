"""Pieces of JSBSim's XML: operations, numbers, properties, comments."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any


def op(kind: str, *of: ET.Element) -> ET.Element:
    """An operation on others."""
    element = ET.Element(kind)
    element.extend(of)
    return element


def joined(kind: str, parts: Sequence[ET.Element]) -> ET.Element:
    """Sum or product; JSBSim complains of those of one part."""
    return op(kind, *parts) if len(parts) > 1 else parts[0] if parts else number(0.0)


def number(value: float) -> ET.Element:
    """A constant, to the last bit."""
    element = ET.Element("value")
    element.text = repr(value)
    return element


def prop(name: str, sign: float = 1.0) -> ET.Element:
    """A property, or minus it."""
    element = ET.Element("property")
    element.text = f"-{name}" if sign < 0 else name
    return element


def comment(text: str) -> ET.Element:
    """A comment of XML, which may not hold two hyphens in a row."""
    while "--" in text:
        text = text.replace("--", "- -")
    made: Any = ET.Comment(f" {text} ")
    return made
