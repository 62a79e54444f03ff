"""Coefficients that a simulated model lacks although the motion depends on them."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable

from structsel.errors import StructselWarning
from structsel.formatting import join_names
from structsel.model import AeroModel
from structsel.nomenclature import COEFFICIENTS, LATERAL_COEFFICIENTS, LONGITUDINAL_COEFFICIENTS, WIND_AXIS_COEFFICIENTS

_MEANING = {
    "CX": "axial force", "CD": "drag", "CY": "side force", "CZ": "normal force", "CL": "lift", "Cl": "rolling moment",
    "Cm": "pitching moment", "Cn": "yawing moment",
}  # fmt: skip


def missing_responses(model: AeroModel, *, lateral: bool = False) -> tuple[str, ...]:
    """Coefficients that the model lacks although its motion depends on them, in the axes of the model.

    Parameters
    ----------
    model : AeroModel
    lateral : bool
        The motion is not symmetric. Otherwise CY, Cl and Cn count only for a model that has one of them: a model
        without any is simulated in its plane of symmetry.
    """
    both = dict(zip(COEFFICIENTS, WIND_AXIS_COEFFICIENTS))
    wind = any(name in model for name in ("CL", "CD"))
    lateral = lateral or any(name in model for name in LATERAL_COEFFICIENTS)
    needed = (*LONGITUDINAL_COEFFICIENTS, *(LATERAL_COEFFICIENTS if lateral else ()))
    return tuple(both[name] if wind else name for name in COEFFICIENTS if name in needed and not _has(model, name))


def _has(model: AeroModel, name: str) -> bool:
    return name in model or WIND_AXIS_COEFFICIENTS[COEFFICIENTS.index(name)] in model


def describe_missing(model: AeroModel, missing: Collection[str]) -> str:
    """What is missing, what is assumed, and what to do; empty if nothing is missing."""
    if not missing:
        return ""
    names, meanings = join_names(missing), join_names(_MEANING[name] for name in missing)
    who = f"Model '{model.name}'" if model.name else "The model"
    return (
        f"{who} has no {names}: its motion is computed with zero {meanings}, so trim and flight are not those of the "
        f"aircraft. Select {names} too, or add {'it' if len(missing) == 1 else 'them'} to the model."
    )


def warn_missing(
    model: AeroModel, *, lateral: bool = False, among: Iterable[str] = COEFFICIENTS, stacklevel: int = 3
) -> None:
    """Warn of coefficients that the caller of a verb would need; the same words for each verb, so that one is shown."""
    names = {*among}
    names |= {w for b, w in zip(COEFFICIENTS, WIND_AXIS_COEFFICIENTS) if b in names}
    missing = [name for name in missing_responses(model, lateral=lateral) if name in names]
    if missing:
        warnings.warn(describe_missing(model, missing), StructselWarning, stacklevel=stacklevel)
