"""Known errors put into real manoeuvres: which of them a diagnosis names first.

A model with fixed linear terms is fitted to all manoeuvres, and its coefficients are given as the simulation of the
same manoeuvres. One error is put into the simulation, the readings or the constants of the aircraft.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from real_recordings import DATA, HFB_PARTS, attas_records, cut, fitted, hfb320_record

import structsel as ss
from structsel.coefficients import compute_all
from structsel.numerics.arrays import Array
from structsel.recording import Recording

LATERAL = ["beta", "p_hat", "r_hat", "dr"]
TERMS = {
    "CX": ["alpha", "alpha^2"], "CZ": ["alpha", "q_hat", "de"], "Cm": ["alpha", "q_hat", "de"],
    "CY": LATERAL, "Cl": [*LATERAL, "da"], "Cn": [*LATERAL, "da"],
}  # fmt: skip
HFB_DELAY = 0.21  # s, of the vane of the HFB-320 by a diagnosis of the plain model
TWIN_OTTER = ("020213f1_017", "020213f1_018", "020213f1_019_oe_lon_example")


@dataclass(frozen=True)
class Flown:
    """Manoeuvres, the aircraft, and the coefficients of the fitted model."""

    recordings: Sequence[Recording]
    aircraft: ss.Aircraft
    model: ss.AeroModel

    def simulated(self) -> dict[str, Recording]:
        """Coefficients along the recordings as they are read."""
        along = compute_all(self.recordings, self.aircraft)
        return {r.name: Recording(r.name, r.t, dict(self.model.evaluate(r, outside="ignore"))) for r in along}

    def read(self, **wrong: Callable[[Recording], Array]) -> Flown:
        """With wrong readings of some channels."""
        return replace(
            self, recordings=[r.with_channels(**{c: of(r) for c, of in wrong.items()}) for r in self.recordings]
        )

    def with_value(self, term: str, factor: float) -> Flown:
        """With the value of a term of Cm times a factor."""
        one = self.model.responses["Cm"]
        values = np.array([v * (factor if str(t) == term else 1.0) for t, v in zip(one.terms, one.values)])
        wrong = ss.AeroModel(dict(self.model.responses) | {"Cm": ss.ResponseModel(one.terms, values)})
        return replace(self, model=wrong)

    def heavier(self, factor: float) -> Flown:
        """With a mass that is too large."""
        heavy = self.aircraft.to_dict() | {"mass": factor * self.aircraft.mass}
        weighed = [r.with_channels(mass=factor * r["mass"]) if "mass" in r.names else r for r in self.recordings]
        return replace(self, aircraft=ss.Aircraft.from_dict(heavy), recordings=weighed)

    def about_another_point(self, chords: float) -> Flown:
        """With Cm about another point."""
        lift, moment = (self.model.responses[c] for c in ("CZ", "Cm"))
        total = dict(zip(map(str, moment.terms), moment.values))
        for term, value in zip(map(str, lift.terms), lift.values):
            total[term] = total.get(term, 0.0) + chords * value
        moved = ss.ResponseModel(tuple(map(ss.Term, total)), np.array([*total.values()]))
        return replace(self, model=ss.AeroModel(dict(self.model.responses) | {"Cm": moved}))


def flown(recordings: Sequence[Recording], aircraft: ss.Aircraft, responses: Sequence[str]) -> Flown:
    """Manoeuvres with the model that is fitted to them."""
    terms = {c: TERMS[c] for c in responses}
    return Flown(recordings, aircraft, ss.AeroModel(fitted(compute_all(recordings, aircraft), terms)))


def attas() -> Flown:
    """Six manoeuvres about all axes."""
    return flown(*attas_records(), list(TERMS))


def twin_otter() -> Flown:
    """Three longitudinal manoeuvres."""
    folder = DATA / "twin-otter"
    read = [ss.read_recording(folder / f"totter_lon_{name}.mat", folder / "map.toml") for name in TWIN_OTTER]
    return flown(read, ss.Aircraft.from_toml(folder / "aircraft.toml"), ["CX", "CZ", "Cm"])


def hfb320() -> Flown:
    """Four parts of one record, less the delay of its vane; all coefficients depend on the airspeed."""
    record, aircraft = hfb320_record()
    early = np.interp(record.t + HFB_DELAY, record.t, record["alpha"])
    parts = cut(record.with_channels(alpha=early), HFB_PARTS)
    terms = {"CX": ["V_ratio", *TERMS["CX"]], "CZ": ["V_ratio", "alpha"], "Cm": ["V_ratio", *TERMS["Cm"]]}
    return Flown(parts, aircraft, ss.AeroModel(fitted(compute_all(parts, aircraft), terms)))


def citation() -> Flown:
    """Eleven minutes of quasi-steady flight, as the script beside the record cuts them; the trim tab is a control."""
    script = DATA / "citation-flight" / "make_case.py"
    with tempfile.TemporaryDirectory() as made:
        subprocess.run([sys.executable, str(script), made], check=True, stdout=subprocess.DEVNULL)
        folder = Path(made) / "control-60s"
        read = [ss.read_recording(path) for path in sorted((folder / "recordings").iterdir())]
        aircraft = ss.Aircraft.from_toml(folder / "aircraft.toml")
    terms = {"CX": TERMS["CX"], "CZ": ["alpha"], "Cm": [*TERMS["Cm"], "trim"]}
    return Flown(read, aircraft, ss.AeroModel(fitted(compute_all(read, aircraft), terms)))


def times(channel: str, factor: float) -> Callable[[Flown], Flown]:
    """A reading times a factor."""
    return lambda f: f.read(**{channel: lambda r: factor * r[channel]})


ERRORS: Mapping[str, tuple[Callable[[Flown], Flown], frozenset[str]]] = {
    "none": (lambda f: f, frozenset()),
    "Cm_de halved": (lambda f: f.with_value("de", 0.5), frozenset({"wrong-derivative", "control-nonlinearity"})),
    "no Cm_q": (
        lambda f: f.with_value("q_hat", 0.0),
        frozenset({"wrong-derivative", "missing-term", "augmentation", "downwash-lag"}),
    ),
    "alpha 0.2 s late": (
        lambda f: f.read(alpha=lambda r: np.interp(r.t - 0.2, r.t, r["alpha"])),
        frozenset({"sensor-delay"}),
    ),
    "q times 1.25": (times("q", 1.25), frozenset({"sensor-scale"})),
    "alpha times 1.3": (times("alpha", 1.3), frozenset({"sensor-scale"})),
    "mass times 1.25": (lambda f: f.heavier(1.25), frozenset({"mass-error"})),
    "elevator lags by 0.15 s": (  # the reading is the command
        lambda f: f.read(de=lambda r: r["de"] + 0.15 * np.gradient(r["de"], r.t)),
        frozenset({"actuator-lag", "sensor-delay"}),
    ),
    "centre of gravity off by 0.15 chords": (lambda f: f.about_another_point(0.15), frozenset({"cg-shift"})),
    "thrust times 0.7": (times("thrust", 0.7), frozenset({"thrust-scale"})),
    "V times 1.12": (
        times("V", 1.12),
        frozenset({"sensor-scale", "sensor-bias", "position-error", "mass-error"}),
    ),
}
"""What is done, and the names that are right."""


def judge(found: ss.Diagnosis, accept: frozenset[str]) -> tuple[str, str]:
    """Whether a diagnosis is right, and its first two findings in words."""
    named = [f for f in found.findings if f.kind != "random"]
    said = "; then ".join(
        f"{' or '.join(f'{p.effect} {p.probability:.2f}' for p in f.physics[:2])} in {' '.join(f.axes[:3])}"
        for f in named[:2]
    )
    if not accept:
        return "yes" if not named else "no", said or found.verdict
    if named and named[0].effect in accept:
        return "yes", said
    if named and accept & set(named[0].ambiguous_with):
        return "tie", said
    return "later" if any(f.effect in accept for f in named[1:]) else "no", said or found.verdict


def main() -> None:
    """Run every error in both sets and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("errors", nargs="*", default=list(ERRORS), help="by default all")
    stated = parser.parse_args()
    print("| recordings | error | right | findings |\n|---|---|---|---|")
    for make in (attas, twin_otter, hfb320, citation):
        plain = make()
        for name in stated.errors:
            change, accept = ERRORS[name]
            wrong = change(plain)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = ss.diagnose(wrong.simulated(), wrong.recordings, wrong.aircraft)
            print(f"| {make.__name__} | {name} | {' | '.join(judge(found, accept))} |")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
