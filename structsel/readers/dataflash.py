"""ArduPilot logs (DataFlash, ``.bin``): every field of every message is a column, ``ATT.Roll``, ``IMU[0].GyrX``.

ArduPilot keeps body axes forward, right, down and earth axes north, east, down, as structsel does. The time of a
message is its ``TimeUS``. Units are those the log itself states (FMTU, UNIT, MULT), where it does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from structsel.errors import DataError
from structsel.numerics.atmosphere import standard_atmosphere
from structsel.readers.channel_map import FileOptions
from structsel.readers.isolated import read_isolated
from structsel.readers.isolated_worker import DATAFLASH_TYPES
from structsel.readers.standard_maps import StandardChannel, densest_time, require_extra, with_standard_map
from structsel.readers.table import FileTable
from structsel.readers.units import is_unit

MAGIC = b"\xa3\x95"
_UNITS = {"degheading": "deg", "deglatitude": "deg", "deglongitude": "deg", "m/s/s": "m/s^2", "rad/s/s": "rad/s^2"}
_UNITS |= {"deg/s/s": "deg/s^2", "UNKNOWN": "", "instance": "", "satellites": ""}
_SERVOS = {70: "throttle", 4: "aileron", 19: "elevator", 21: "rudder", 2: "flap"}
"""What an output drives, by the number of SERVOn_FUNCTION; mixed surfaces (elevons, V-tails) are not here."""

_ESTIMATED = "ArduPilot's estimate, not a reading of an instrument"
_COMMANDED = "a command of ArduPilot, between -1 and 1, not a deflection: see docs/readers.md"


def _of(message: str, field: str) -> tuple[str, str]:
    """Columns a field of a message's first instance may have, later logs first."""
    return f"{message}[0].{field}", f"{message}.{field}"


_USUAL = (
    *(StandardChannel(name, _of("IMU", f"Gyr{axis}"), "rad/s") for name, axis in zip("pqr", "XYZ")),
    *(StandardChannel(f"a{axis.lower()}", _of("IMU", f"Acc{axis}"), "m/s^2") for axis in "XYZ"),
    StandardChannel("phi", ("ATT.Roll",), "deg", assumption=_ESTIMATED),
    StandardChannel("theta", ("ATT.Pitch",), "deg", assumption=_ESTIMATED),
    StandardChannel("psi", ("ATT.Yaw",), "deg", assumption=_ESTIMATED),
    StandardChannel(
        "V",
        _of("ARSP", "TAS"),
        "m/s",
        assumption="the sensor's equivalent airspeed over the root of the standard atmosphere's relative density at "
        "its static pressure: 1.7 % per 10 K the air is off standard",
    ),
    *(
        StandardChannel(
            f"v{to.lower()}", (*_of("XKF1", f"V{to}"), *_of("NKF1", f"V{to}")), "m/s", assumption=_ESTIMATED
        )
        for to in "NED"
    ),
    StandardChannel("x", (*_of("XKF1", "PN"), *_of("NKF1", "PN")), "m", assumption=_ESTIMATED),
    StandardChannel("y", (*_of("XKF1", "PE"), *_of("NKF1", "PE")), "m", assumption=_ESTIMATED),
    StandardChannel("h", ("POS.Alt",), "m", assumption=_ESTIMATED),
    StandardChannel("h_agl", _of("RFND", "Dist"), "m", assumption="along the sensor's beam, not the vertical"),
    StandardChannel("pressure", _of("BARO", "Press"), "Pa"),
    StandardChannel("rpm", (*_of("RPM", "RPM"), "RPM.rpm1"), "rpm"),
    StandardChannel(
        "throttle", ("RCOU.throttle",), "-", hold=True, assumption="the command of the motor, not its speed"
    ),
    *(
        StandardChannel(f"{name}_command", (f"RCOU.{name}",), "-", hold=True, assumption=_COMMANDED)
        for name in _SERVOS.values()
        if name != "throttle"
    ),
)


def read_dataflash(path: Path, options: FileOptions) -> FileTable:
    """Table of a DataFlash log, each message on its own clock, with ArduPilot's usual messages as its standard map.

    Columns are added that other tools compute as well: ``ARSP.TAS``, true airspeed; and, where the log holds the
    parameters of the outputs, ``RCOU.throttle`` (0 to 1) and ``RCOU.elevator``, ``.aileron``, ``.rudder``, ``.flap``
    (-1 to 1 of their travel, in ArduPilot's sense).

    Raises
    ------
    DataError
        pymavlink is not installed, or the file is no DataFlash log, cannot be read, or holds no data.
    """
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise DataError(
                f"'{path}' is no binary DataFlash log: it does not begin as one.\n"
                "Check that it is the right file; a log in text (.log) is read after conversion to .bin or .csv."
            )
    require_extra("pymavlink.DFReader", "dataflash", path, "an ArduPilot log")
    log = read_isolated(path, "bin")
    messages = log.messages
    try:
        columns, units, clocks = _columns(messages)
        notes = [
            *_add_true_airspeed(columns, units, clocks),
            *_add_servos(columns, units, clocks, _parameters(messages)),
        ]
    except Exception as error:  # struct.error, KeyError, UnicodeDecodeError, ... of a broken file
        raise DataError(
            f"'{path}' is no DataFlash log that can be read: {error}\nFetch it from the vehicle again."
        ) from error
    if not columns:
        raise DataError(
            f"'{path}' is a DataFlash log without samples: it has definitions of messages only.\n"
            "Check LOG_BITMASK and LOG_DISARMED, or fetch the log from the vehicle again."
        )
    table = FileTable(str(path), columns, units=units, clocks=clocks, notes=tuple(notes), faults=log.faults)
    measured = [c for row in _USUAL for c in row.columns if isinstance(c, str) and c in columns]
    usual = (StandardChannel("t", (clocks[measured[0]] if measured else densest_time(clocks, columns),)), *_USUAL)
    if "RCOU.throttle" not in columns and "RCOU.elevator" not in columns:
        usual += tuple(StandardChannel(f"pwm{i}", (f"RCOU.C{i}",), hold=True) for i in range(1, 15))
    if "AOA.AOA" in columns:
        table = replace(
            table,
            notes=(*table.notes, "AOA.AOA and AOA.SSA are computed by ArduPilot from its wind estimate, and not used"),
        )
    return with_standard_map(table, "ArduPilot's usual messages", usual)


def _columns(
    messages: Mapping[str, tuple[Any, np.ndarray]],
) -> tuple[dict[str, np.ndarray], dict[str, str], dict[str, str]]:
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    for name, (fmt, rows) in sorted(messages.items()):
        if "TimeUS" not in fmt.columns:
            continue
        instance = fmt.instance_field or ("I" if "I" in fmt.columns else None)
        parts = {name: rows}
        if instance is not None:
            parts = {f"{name}[{int(i)}]": rows[rows[instance] == i] for i in np.unique(rows[instance])}
        for part, samples in parts.items():
            for j, (field, kind) in enumerate(zip(fmt.columns, fmt.msg_fmts)):
                divisor = DATAFLASH_TYPES[kind][1]
                values = samples[field]
                if values.dtype.kind == "S" or values.ndim > 1:
                    continue
                column = f"{part}.{field}"
                columns[column] = values / divisor if divisor != 1 else values
                clocks[column] = f"{part}.TimeUS"
                stated = fmt.units[j] if fmt.units else ""
                stated = "us" if field == "TimeUS" else _UNITS.get(stated, stated)
                if stated and is_unit(stated):
                    units[column] = stated
    return columns, units, clocks


def _parameters(messages: Mapping[str, tuple[Any, np.ndarray]]) -> dict[str, float]:
    if "PARM" not in messages:
        return {}
    rows = messages["PARM"][1]
    return {name.decode(errors="replace"): float(value) for name, value in zip(rows["Name"], rows["Value"])}


def _add_true_airspeed(columns: dict[str, np.ndarray], units: dict[str, str], clocks: dict[str, str]) -> list[str]:
    """Add ``.TAS`` to each airspeed sensor; the density ratio, which varies slowly, is interpolated linearly."""
    baro = next((name for name in _of("BARO", "Press") if name in columns), None)
    notes = []
    for name in [name for name in columns if name.startswith("ARSP") and name.endswith(".Airspeed")]:
        if baro is None:
            notes.append(f"'{name}' is equivalent airspeed; V is not computed, because the log has no static pressure")
            continue
        sigma = _density_ratio(columns[baro].astype(np.float64))
        seen = np.isfinite(sigma)
        if not seen.any():
            continue
        at = columns[clocks[name]].astype(np.float64)
        sigma = np.interp(at, columns[clocks[baro]].astype(np.float64)[seen], sigma[seen])
        made = name.replace(".Airspeed", ".TAS")
        columns[made], units[made], clocks[made] = columns[name] / np.sqrt(sigma), "m/s", clocks[name]
        notes.append(f"'{made}': '{name}' over the root of the relative density at '{baro}'")
    return notes


def _density_ratio(pressure: np.ndarray) -> np.ndarray:
    """Density of the standard atmosphere at a static pressure [Pa], over that at sea level."""
    h = np.arange(-1000.0, 20_001.0, 50.0)
    _, p, rho, _ = standard_atmosphere(h)
    rho0 = standard_atmosphere(0.0)[2]
    return np.interp(pressure, p[::-1], rho[::-1] / rho0, left=np.nan, right=np.nan)


def _add_servos(
    columns: dict[str, np.ndarray], units: dict[str, str], clocks: dict[str, str], parameters: Mapping[str, float]
) -> list[str]:
    """Add the outputs as fractions of their travel, by the parameters SERVOn_FUNCTION, _MIN, _TRIM, _MAX."""
    notes = []
    for i in range(1, 15):
        function = _SERVOS.get(int(np.nan_to_num(parameters.get(f"SERVO{i}_FUNCTION", -1))))
        needed = [f"SERVO{i}_{part}" for part in ("MIN", "TRIM", "MAX", "REVERSED")]
        column, made = f"RCOU.C{i}", f"RCOU.{function}"
        if function is None or column not in columns or made in columns or not set(needed) <= parameters.keys():
            continue
        low, trim, high, turned = (parameters[name] for name in needed)
        pwm = columns[column].astype(np.float64)
        if not low < trim < high and function not in ("throttle", "flap"):
            continue
        if function in ("throttle", "flap"):
            fraction = (pwm - low) / (high - low)
            fraction = 1.0 - fraction if turned else fraction
        else:
            fraction = np.where(pwm >= trim, (pwm - trim) / (high - trim), (pwm - trim) / (trim - low))
            fraction = -fraction if turned else fraction
        fraction[pwm == 0.0] = np.nan  # no pulse is sent, as when disarmed
        columns[made], units[made], clocks[made] = fraction, "-", clocks[column]
        notes.append(f"'{made}': '{column}' by {', '.join(needed)} ({low:g}, {trim:g}, {high:g}, {turned:g})")
    return notes
