"""Proving the diagnosis: concealed cases whose missing physics is known, written with their keys apart."""

from structsel.proving.cases import Case, write_case
from structsel.proving.keys import EffectKey, Key

__all__ = ["Case", "EffectKey", "Key", "write_case"]
