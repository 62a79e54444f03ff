"""Cases drawn by seed: the same seed gives the same case."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from structsel.proving.cases import Case, write_case
from structsel.proving.own import families
from structsel.proving.own.flight import Lost

FAMILIES = {"single": 0.54, "null": 0.20, "pair": 0.10, "outside": 0.08, "clutter": 0.08}
"""How often each family is drawn."""
_TRIES = 12


def draw_case(seed: int, family: str | None = None, effect: str | None = None, severity: str | None = None) -> Case:
    """Draw a concealed case.

    Parameters
    ----------
    seed : int
        Settles everything that is not given.
    family : {"single", "pair", "null", "outside", "clutter"}, optional
    effect : str, optional
        Of a single; a name of EFFECTS that can be drawn.
    severity : {"easy", "medium", "hard"}, optional
        Aimed at; the key says what came of it.

    Returns
    -------
    Case

    Raises
    ------
    RuntimeError
        Nothing that can be flown and shows was drawn in a dozen tries.
    """
    for attempt in range(_TRIES):
        rng = np.random.default_rng([seed, attempt, 11])
        drawn = str(rng.choice(list(FAMILIES), p=list(FAMILIES.values())))
        aim = str(rng.choice(["easy", "medium", "hard"], p=[0.35, 0.4, 0.25]))
        chosen = "single" if effect is not None else (family or drawn)
        try:
            return families.make(chosen, rng, seed, attempt, effect, severity or aim)
        except Lost:
            continue
    raise RuntimeError(
        f"seed {seed}: no {family or 'case'} {effect or ''} that can be flown and shows in {_TRIES} tries."
    )


def write_cases(seeds: Iterable[int], folder: str | Path, keys: str | Path, **choice: str) -> list[Path]:
    """Draw and write one case per seed; `choice` as `draw_case` takes it. Returns the cases' folders."""
    return [write_case(draw_case(seed, **choice), folder, keys) for seed in seeds]
