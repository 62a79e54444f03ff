"""Steps from measured motion to coefficients: air data, forces, moments, dimensionless channels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import AircraftError, ChannelError, DataError, DomainError
from structsel.nomenclature import AIR_DATA, ANGULAR_ACCELERATIONS, BODY_RATES
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data_at_cg, lift_and_drag
from structsel.numerics.atmosphere import speed_of_sound, standard_atmosphere
from structsel.readers.table import MOVED_TO_CG
from structsel.recording import Finding, Recording, with_entry_findings

WHO = "compute_coefficients"
"""Function that messages name."""
_OPTIONAL = (
    *BODY_RATES, *ANGULAR_ACCELERATIONS, "alpha_dot", "beta_dot", "beta", "ay", "thrust", "mass", "qbar", "rho", "h",
    "temperature",
)  # fmt: skip
_KINDS = ("left-out", "assumed")


class CoefficientComputation:
    """Coefficients of one recording; each step adds channels, notes and findings."""

    def __init__(self, recording: Recording, aircraft: Aircraft, method: str, order: int):
        recording.require("V", "alpha", "ax", "az", finite=True, by=WHO)
        recording.require(*(name for name in _OPTIONAL if name in recording), finite=True, by=WHO)
        self.aircraft, self.method, self.order = aircraft, method, order
        recording = with_entry_findings(recording)
        # Findings of an earlier run would speak of channels that are computed again.
        old = tuple(f for f in recording.findings if f.kind not in _KINDS)
        self.recording = replace(recording, findings=old)
        self.findings: list[Finding] = []
        self.at_cg = recording.at_cg
        self.recording.require_above_zero("V", by=WHO)
        self._differentiate(*(rate for rate in BODY_RATES if rate in recording))
        self._carry_vanes()

    def mean_airspeed(self) -> float:
        """Mean V [m/s] of the recording."""
        return float(self.recording["V"].mean())

    def run(self, V0: float | None, source: str = "") -> Recording:
        """Recording with the coefficients; `source` states where the reference airspeed V0 [m/s] is from."""
        self._add_air_data()
        self._add_forces()
        self._add_moments()
        self._add_candidate_channels(V0, source)
        return replace(self.recording, findings=self.recording.findings + tuple(self.findings))

    # ------------------------------------------------------------ what every step uses

    def _add(self, note: str, at_cg: Iterable[str] = (), **arrays: np.ndarray) -> None:
        self.recording = self.recording.with_channels(note=note, units=None, at_cg=at_cg, **arrays)

    def _say(self, kind: str, channel: str, message: str, severity: str = "note", remedy: str = "") -> None:
        self.findings.append(Finding(kind, channel, message, severity, remedy, count=len(self.recording)))

    def _differentiate(self, *names: str, anew: bool = False) -> None:
        """Add derivatives that were not recorded (or all, where the channels were carried elsewhere)."""
        wanted = [name for name in names if anew or f"{name}_dot" not in self.recording]
        if not wanted:
            return
        try:
            self.recording = self.recording.differentiate(*wanted, method=self.method, order=self.order)
        except DataError as error:
            if self.recording.name in str(error):
                raise
            raise DataError(f"'{self.recording.name}': {error}") from error

    def _or_zero(self, names: tuple[str, ...], use: str) -> list[np.ndarray]:
        """Channels, zero where there is none; a finding says for what."""
        missing = [name for name in names if name not in self.recording]
        measured = [name for name in missing if not name.endswith("_dot")]
        if measured:
            listed = " and ".join(measured)
            self._say("assumed", measured[0], f"no {listed} recorded; taken as zero in {use}")
        zero = np.zeros(len(self.recording))
        return [self.recording.channels.get(name, zero) for name in names]

    # ------------------------------------------------------------ the steps

    def _carry_vanes(self) -> None:
        place = self.aircraft.position("vane")
        if not place.any() or {"V", "alpha"} <= self.at_cg:
            return
        if "q" not in self.recording:
            message = f"without q they stay as read {_metres(place)} from the centre of gravity"
            self._say("left-out", "alpha", message, "warning", "map the pitch rate")
            return
        beta, p, r = self._or_zero(("beta", "p", "r"), "carrying V and alpha to the centre of gravity")
        made = air_data_at_cg(self.recording["V"], self.recording["alpha"], beta, p, self.recording["q"], r, place)
        named = dict(zip(AIR_DATA, made))
        if "beta" not in self.recording:
            del named["beta"]
        self._add(f"{MOVED_TO_CG}{', '.join(named)}; vanes at {_metres(place)}", named, **named)
        self._differentiate(*(name for name in named if name != "V" and f"{name}_dot" in self.recording), anew=True)

    def _add_air_data(self) -> None:
        record = self.recording
        if "qbar" not in record:
            if "rho" in record:
                rho, source = record["rho"], "rho as recorded"
            elif "h" in record:
                rho, source = standard_atmosphere(record["h"])[2], "rho of the standard atmosphere at h"
            else:
                raise ChannelError(
                    f"{WHO} needs channel 'qbar' [Pa], or 'rho' [kg/m^3] or 'h' [m] to make it from; "
                    f"'{record.name}' has none.\nIt has: {', '.join(('t', *record.names))}.\n"
                    "If the file has one under another name, state it in a channel map."
                )
            self._add(f"qbar: 0.5 rho V^2 with {source}", qbar=0.5 * rho * record["V"] ** 2)
        self.recording.require_above_zero("qbar", by=WHO)
        if "mach" not in record:
            if "temperature" in record:
                record.require_above_zero("temperature", by=WHO)
                sound, source = speed_of_sound(record["temperature"]), "the recorded temperature"
            elif "h" in record:
                sound, source = standard_atmosphere(record["h"])[3], "the standard atmosphere at h"
            else:
                self._say("left-out", "mach", "not made: it needs h or temperature")
                return
            self._add(f"mach: V over the speed of sound of {source}", mach=record["V"] / sound)

    def _force_at_cg(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Specific force at the centre of gravity; the lateral one is zero where ay is missing."""
        record = self.recording
        ay = record.channels.get("ay", np.zeros(len(record)))
        place = self.aircraft.position("accelerometer")
        if not place.any() or {"ax", "az"} <= self.at_cg:
            return record["ax"], ay, record["az"]
        if not any(rate in record for rate in BODY_RATES):
            message = f"without rates the readings stay as taken {_metres(place)} from the centre of gravity"
            self._say("left-out", "ax", message, "warning", "map p, q and r")
            return record["ax"], ay, record["az"]
        use = "carrying accelerations to the centre of gravity"
        turning = self._or_zero((*BODY_RATES, *ANGULAR_ACCELERATIONS), use)
        moved = rb.acceleration_at_cg(record["ax"], ay, record["az"], turning[:3], turning[3:], place)
        self.recording = record.with_channels(note=f"forces: accelerometer at {_metres(place)} allowed for")
        return moved

    def _add_forces(self) -> None:
        record, thrust_line = self.recording, self.aircraft.thrust
        if "mass" in record:
            mass: float | np.ndarray = record["mass"]
            record.require_above_zero("mass", by=WHO)
        elif self.aircraft.mass is not None:
            mass = self.aircraft.mass
        else:
            raise AircraftError(
                f"{WHO} needs a mass; aircraft '{self.aircraft.name}' has none and '{record.name}' has no "
                "channel 'mass' [kg].\nAdd mass [kg] to aircraft.toml, or map the channel."
            )
        thrust = self._thrust()
        CX, CY, CZ = rb.force_coefficients(
            *self._force_at_cg(), record["qbar"], mass, self.aircraft.S, thrust, thrust_line.inclination
        )
        forces = {"CX": CX, "CY": CY, "CZ": CZ}
        if "ay" not in record:
            del forces["CY"]
            self._say("left-out", "CY", "not made: no ay recorded")
        made_with = "thrust taken out" if "thrust" in record else "thrust inside"
        mass_source = "recorded mass" if "mass" in record else f"mass {self.aircraft.mass:g} kg"
        self._add(f"{', '.join(forces)}: {mass_source}, {made_with}", **forces)
        beta = record.channels.get("beta", np.zeros(len(record)))
        if "beta" not in record or "ay" not in record:
            missing = " and ".join(name for name in ("beta", "ay") if name not in record)
            self._say("assumed", "CD", f"no {missing} recorded; their part of the drag is taken as zero")
        CL, CD = lift_and_drag(CX, CY, CZ, record["alpha"], beta)
        self._add("CL, CD: from the body-axis coefficients", CL=CL, CD=CD)

    def _thrust(self) -> np.ndarray:
        record = self.recording
        if "thrust" in record:
            self._add("CT: thrust / (qbar S)", CT=record["thrust"] / (record["qbar"] * self.aircraft.S))
            return record["thrust"]
        inside = "CX, CD"
        if self.aircraft.thrust.inclination:
            inside += ", CZ, CL"
        if np.any(self.aircraft.thrust.arm):
            inside += " and the moments"
        message = f"not recorded, so {inside} hold the propulsive part as well; CT is not made"
        self._say("left-out", "thrust", message, "warning", "map the thrust, or read CX as thrust less drag")
        return np.zeros(len(record))

    def _add_moments(self) -> None:
        record, aircraft = self.recording, self.aircraft
        if "q" not in record:
            self._say("left-out", "Cm", "not made: no q recorded")
        lacking = [rate for rate in BODY_RATES if rate not in record]
        if lacking:
            for name in ("Cl", "Cn"):
                self._say("left-out", name, f"not made: no {' and '.join(lacking)} recorded")
        if "q" not in record and lacking:
            return
        if aircraft.inertia is None:
            message = f"Cl, Cm and Cn are not made: aircraft '{aircraft.name}' has no inertia"
            self._say("left-out", "Cm", message, "warning", "add an [inertia] table to aircraft.toml")
            return
        turning = self._or_zero((*BODY_RATES, *ANGULAR_ACCELERATIONS), "the inertial coupling in Cm")
        Cl, Cm, Cn = rb.moment_coefficients(
            turning[:3],
            turning[3:],
            record["qbar"],
            aircraft.inertia.tensor,
            aircraft.S,
            aircraft.b,
            aircraft.cbar,
            record.channels.get("thrust", 0.0),
            aircraft.thrust.offset,
            aircraft.thrust.inclination,
            aircraft.engine.angular_momentum,
        )
        moments = {"Cm": Cm} if lacking else {"Cl": Cl, "Cm": Cm, "Cn": Cn}
        rotor = ", rotor allowed for" if aircraft.engine.angular_momentum else ""
        self._add(f"{', '.join(moments)}: Euler's equations{rotor}", **moments)

    def _add_candidate_channels(self, V0: float | None, source: str) -> None:
        aircraft = self.aircraft
        self._differentiate(*(name for name in ("alpha", "beta") if name in self.recording))
        record = self.recording
        lengths = {"p": aircraft.b, "q": aircraft.cbar, "r": aircraft.b}
        lengths |= {"alpha_dot": aircraft.cbar, "beta_dot": aircraft.b}
        twice = 2.0 * record["V"]
        hats = {f"{n}_hat": record[n] * size / twice for n, size in lengths.items() if n in record}
        self._add(f"{', '.join(hats)}: times b/2V (lateral) or cbar/2V (longitudinal)", **hats)
        if "beta" not in record:
            self._say("left-out", "beta", "not recorded, so no term in it can be a candidate")
        if V0 is None:
            V0 = aircraft.V0
        if V0 is None:
            V0, source = self.mean_airspeed(), f"the mean V of '{record.name}'"
        if not V0 > 0.0:
            raise DomainError(f"{WHO} needs a reference airspeed V0 [m/s] above zero; it is {V0:g}.")
        if source:
            message = f"V0 = {V0:.4f} m/s is {source}; models of other recordings must use the same"
            self._say("assumed", "V_ratio", message, "note", "give V0 in aircraft.toml")
        self._add(f"V_ratio: V / {V0:.10g} m/s", V_ratio=record["V"] / V0)


def _metres(place: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:g}" for x in place) + ") m"
