"""X-Plane's data output to disk (Data.txt): columns such as ``Vtrue,_ktas |``, two words filled up with ``_``.

The second word is mostly the unit. The file does not state signs; these differ from ours: loads count up, aft and
left; sideslip is heading less path, so positive with the nose right; the rudder's trailing edge goes right.
"""

from __future__ import annotations

from dataclasses import replace

from structsel.readers.standard_maps import StandardChannel, with_standard_map
from structsel.readers.table import FileTable

_UNITS = {
    "time": "s", "kias": "kt", "keas": "kt", "ktas": "kt", "ktgs": "kt", "mph": "mph", "mphas": "mph", "mphgs": "mph",
    "fpm": "ft/min", "deg": "deg", "rad/s": "rad/s", "deg/s": "deg/s", "ftmsl": "ft", "ftMSL": "ft", "ftagl": "ft",
    "ftAGL": "ft", "lb": "lbf", "ftlb": "lbf*ft", "lb-ft": "lbf*ft", "true": "deg", "mag": "deg", "ratio": "-",
    "degC": "degC", "inHG": "inHg", "norml": "g", "axial": "g", "side": "g", "engin": "rpm", "prop": "rpm",
}  # fmt: skip
_SIGN = "X-Plane's sign, by its documentation, is converted to that of structsel; the file does not state it"


def _key(column: str) -> str:
    """Words of a header without the filling: ``"   _roll,__deg "`` gives ``"roll,deg"``."""
    return ",".join(word.strip(" _") for word in column.split(","))


_USUAL = (
    StandardChannel("t", ("totl,time", "missn,time", "real,time"), "s"),
    StandardChannel("V", ("Vtrue,ktas",), "kt"),
    StandardChannel("alpha", ("alpha,deg",), "deg"),
    StandardChannel("beta", ("beta,deg",), "deg", sign=-1, assumption=_SIGN),
    StandardChannel("mach", ("Mach,ratio",), "-"),
    StandardChannel("phi", ("roll,deg",), "deg"),
    StandardChannel("theta", ("pitch,deg",), "deg"),
    StandardChannel("psi", ("hding,true",), "deg"),
    *(StandardChannel(name.lower(), (f"{name},rad/s", f"{name},deg/s")) for name in "PQR"),
    StandardChannel("ax", ("Gload,axial",), "g", sign=-1, assumption=_SIGN),
    StandardChannel("ay", ("Gload,side",), "g", sign=-1, assumption=_SIGN),
    StandardChannel("az", ("Gload,norml",), "g", sign=-1),
    StandardChannel("h", ("alt,ftmsl", "alt,ftMSL", "p-alt,ftMSL"), "ft"),
    StandardChannel("h_agl", ("alt,ftagl", "alt,ftAGL"), "ft"),
    StandardChannel("de", ({"elev1,deg": 0.5, "elev2,deg": 0.5}, "elev1,deg"), "deg"),
    StandardChannel("da", ({"Lailn,1,deg": -0.5, "Railn,1,deg": 0.5},), "deg"),
    StandardChannel("dr", ("rudr1,deg",), "deg", sign=-1, assumption=_SIGN),
    StandardChannel("throttle", ("thro1,part",), "-"),
    StandardChannel("thrust", ("thrst,1,lb",), "lbf"),
    StandardChannel("rpm", ("rpm_1,prop", "rpm_1,engin"), "rpm"),
)
_MARKS = {"real,time", "totl,time", "missn,time", "Vtrue,ktas", "alpha,deg", "pitch,deg", "Vind,kias"}


def with_xplane_map(table: FileTable) -> FileTable:
    """Table with units and the standard channel map of X-Plane's output, if it is one; else the table as it is.

    A header that occurs more than once is not used, because its surface is ambiguous.
    """
    keys: dict[str, list[str]] = {}
    for column in table.columns:
        keys.setdefault(_key(column.partition(" (column ")[0]), []).append(column)
    if len(_MARKS & keys.keys()) < 2:
        return table
    once = {key: columns[0] for key, columns in keys.items() if len(columns) == 1}
    stated = {column: _UNITS.get(key.rpartition(",")[2]) for key, columns in keys.items() for column in columns}
    units = {column: unit for column, unit in stated.items() if unit is not None}
    table = replace(table, units={**table.units, **units})
    found = []
    for row in _USUAL:
        columns = [
            once[place] if isinstance(place, str) else {once[key]: weight for key, weight in place.items()}
            for place in row.columns
            if all(key in once for key in ([place] if isinstance(place, str) else place))
        ]
        found.append(replace(row, columns=columns))
    twice = [repr(key) for key, columns in keys.items() if len(columns) > 1]
    if twice:
        note = f"headers that occur more than once and are not used: {', '.join(twice)}"
        table = replace(table, notes=(*table.notes, note))
    return with_standard_map(table, "X-Plane's usual columns", found, others="keep")
