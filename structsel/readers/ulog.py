"""PX4 logs (ULog, ``.ulg``): every field of every topic is a column, ``vehicle_attitude.q[0]``.

PX4 keeps body axes forward, right, down and earth axes north, east, down, as structsel does. The time of a topic is
that at which its raw data was sampled, if stated; it is published later, after the computation. The time of a command
is that of its publication. The second instance of a topic is ``vehicle_imu(1)``, and so on.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from structsel.errors import DataError
from structsel.nomenclature import EULER_ANGLES
from structsel.readers.channel_map import FileOptions
from structsel.readers.isolated import read_isolated
from structsel.readers.standard_maps import StandardChannel, densest_time, require_extra, with_standard_map
from structsel.readers.table import FileTable

MAGIC = b"ULog\x01\x12\x35"
_COMMANDS = ("actuator_", "vehicle_torque_setpoint", "vehicle_thrust_setpoint")

_ESTIMATED = "PX4's estimate, not a reading of an instrument"
_COMMANDED = "a command of PX4, between -1 and 1, not a deflection: see docs/readers.md"
_USUAL = (
    *(
        StandardChannel(name, (f"vehicle_angular_velocity.xyz[{i}]", f"sensor_combined.gyro_rad[{i}]"), "rad/s")
        for i, name in enumerate("pqr")
    ),
    *(
        StandardChannel(
            f"a{axis}", (f"vehicle_acceleration.xyz[{i}]", f"sensor_combined.accelerometer_m_s2[{i}]"), "m/s^2"
        )
        for i, axis in enumerate("xyz")
    ),
    *(StandardChannel(name, (f"vehicle_attitude.{name}",), "rad", assumption=_ESTIMATED) for name in EULER_ANGLES),
    StandardChannel(
        "V",
        ("airspeed_validated.true_airspeed_m_s", "airspeed.true_airspeed_m_s"),
        "m/s",
        assumption="true airspeed as PX4 computes it from the pitot tube, perhaps filtered",
    ),
    *(
        StandardChannel(f"v{to}", (f"vehicle_local_position.v{axis}",), "m/s", assumption=_ESTIMATED)
        for to, axis in zip("ned", "xyz")
    ),
    *(StandardChannel(axis, (f"vehicle_local_position.{axis}",), "m", assumption=_ESTIMATED) for axis in "xy"),
    StandardChannel("h", ("vehicle_air_data.baro_alt_meter", "vehicle_global_position.alt"), "m"),
    StandardChannel(
        "h_agl", ("distance_sensor.current_distance",), "m", assumption="along the sensor's beam, not the vertical"
    ),
    StandardChannel("rho", ("vehicle_air_data.rho",), "kg/m^3"),
    StandardChannel("pressure", ("vehicle_air_data.baro_pressure_pa",), "Pa"),
)


def _commands(columns: Mapping[str, np.ndarray]) -> list[StandardChannel]:
    """Standard channels of the commands: those of PX4 1.14 and later, else the earlier ones."""
    motors = [c for i in range(12) if np.isfinite(columns.get(c := f"actuator_motors.control[{i}]", np.nan)).any()]
    throttle = (*motors[: len(motors) == 1], "vehicle_thrust_setpoint.xyz[0]", "actuator_controls_0.control[3]")
    rows = [StandardChannel("throttle", throttle, "-", hold=True, assumption="the command of the motor, not its speed")]
    for i, axis in enumerate(("roll", "pitch", "yaw")):
        places = (f"vehicle_torque_setpoint.xyz[{i}]", f"actuator_controls_0.control[{i}]")
        rows.append(StandardChannel(f"{axis}_command", places, "-", hold=True, assumption=_COMMANDED))
    if len(motors) > 1:
        rows += [StandardChannel(f"motor{i}", (column,), "-", hold=True) for i, column in enumerate(motors, 1)]
    for i in range(15):
        rows.append(
            StandardChannel(f"servo{i + 1}", (f"actuator_servos.control[{i}]",), "-", hold=True, assumption=_COMMANDED)
        )
    if "actuator_servos.control[0]" not in columns:
        used = int(np.max(columns.get("actuator_outputs.noutputs", 0)))
        rows += [StandardChannel(f"output{i + 1}", (f"actuator_outputs.output[{i}]",), hold=True) for i in range(used)]
    return rows


def read_ulog(path: Path, options: FileOptions) -> FileTable:
    """Table of a ULog, each topic on its own clock, with PX4's usual topics as its standard channel map.

    To each topic with an attitude quaternion ``q`` (body to north-east-down, scalar first) the Euler angles are
    added as columns ``.phi``, ``.theta`` and ``.psi`` [rad].

    Raises
    ------
    DataError
        pyulog is not installed, or the file is no ULog, is of a kind pyulog cannot read, or holds no data.
    """
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise DataError(f"'{path}' is no ULog: it does not begin as one.\nCheck that it is the right file.")
    require_extra("pyulog", "ulog", path, "a ULog")
    log = read_isolated(path, "ulg")
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    for topic in sorted(log.data_list, key=lambda topic: (topic.name, topic.multi_id)):
        name = topic.name + (f"({topic.multi_id})" if topic.multi_id else "")
        if topic.timestamp_idx < 0 or not len(topic.data["timestamp"]):
            continue
        fields = {**topic.data, **_euler(topic.data)}
        clock = f"{name}.{_clock(topic.name, fields)}"
        for field, values in fields.items():
            columns[f"{name}.{field}"] = values
            clocks[f"{name}.{field}"] = clock
            if field.startswith("timestamp"):
                units[f"{name}.{field}"] = "us"
    if not columns:
        raise DataError(
            f"'{path}' is a ULog without samples: logging stopped before it began, or the file was cut off.\n"
            "Fetch it from the vehicle again, or log another flight."
        )
    table = FileTable(str(path), columns, units=units, clocks=clocks, notes=_dropouts(log), faults=_faults(path, log))
    measured = [c for row in _USUAL for c in row.columns if isinstance(c, str) and c in columns]
    clock = clocks[measured[0]] if measured else densest_time(clocks, columns)
    return with_standard_map(
        table, "PX4's usual topics", (StandardChannel("t", (clock,)), *_USUAL, *_commands(columns))
    )


def _clock(topic: str, fields: dict[str, np.ndarray]) -> str:
    sampled = fields.get("timestamp_sample")
    if topic.startswith(_COMMANDS) or sampled is None or not np.asarray(sampled).all():
        return "timestamp"
    return "timestamp_sample"


def _euler(fields: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Euler angles [rad] of a quaternion (w, x, y, z) that turns body axes to north, east, down."""
    if "q[3]" not in fields:
        return {}
    q = np.array([fields[f"q[{i}]"] for i in range(4)], dtype=np.float64)
    length = np.sqrt((q**2).sum(axis=0))
    w, x, y, z = np.divide(q, length, out=np.full_like(q, np.nan), where=length > 0.0)
    return {
        "phi": np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        "theta": np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),  # rounding can exceed 1 straight up
        "psi": np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    }


def _dropouts(log: Any) -> tuple[str, ...]:
    if not log.dropouts:
        return ()
    lost = sum(log.dropouts)
    return (f"the log itself counts {len(log.dropouts)} dropouts, {lost} ms in all",)


def _faults(path: Path, log: Any) -> tuple[str, ...]:
    if log.file_corruption:
        return ("the log is damaged; what could be read of it is here",)
    if not log.has_data_appended and _is_cut_off(path.read_bytes()):
        return ("the log ends within a message, as when power was lost; it is read up to there",)
    return ()


def _is_cut_off(content: bytes) -> bool:
    """Whether the last message is longer than the rest of the file; pyulog reads such a file without a warning."""
    at = 16  # the header
    while at + 3 <= len(content):
        at += 3 + int.from_bytes(content[at : at + 2], "little")
    return at != len(content)
