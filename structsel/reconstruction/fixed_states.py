"""Reasons why a state of the flight path is fixed, with the sensor or the manoeuvre that would determine it."""

from __future__ import annotations

from collections.abc import Sequence

CBETA0_REASON = (
    "never observable in flight [M86]: an offset of the sideslip vane has the same effect as a steady sideslip and "
    "a side force bias; set it on the ground"
)
# State: channels that depend on it, the reason if none of them was sampled, and what separates it from other states.
_ADVICE: dict[str, tuple[tuple[str, ...], str, str]] = {
    "KV": (("V",), "no airspeed was sampled", "record vn, ve (or x, y) and turn through all headings"),
    "wd": (
        ("h", "vd"),
        "height or vertical ground velocity is needed to determine a vertical wind; record h or vd",
        "a steady vertical wind has the same effect as an offset of the angle of attack; set Calpha0, or fly at "
        "different speeds",
    ),
    "Csi": (("beta",), "no sideslip vane was sampled", "fly rudder doublets and steady sideslips; record phi"),
    "Calpha0": (
        ("alpha",),
        "no angle-of-attack vane was sampled",
        "record theta and h (or vd), and fly at different speeds and load factors",
    ),
    "Cup": (
        ("alpha",),
        "no angle-of-attack vane was sampled",
        "fly over a wider range of angle of attack, at different speeds",
    ),
    **dict.fromkeys(
        ("wn", "we"),
        (
            ("x", "y", "vn", "ve"),
            "position or ground velocity is needed to separate wind from airspeed; record x, y or vn, ve",
            "record x and y, or vn and ve, and psi; turn through all headings",
        ),
    ),
    "psi": (
        ("psi", "x", "y", "vn", "ve"),
        "heading, position or ground velocity is needed to determine it; record psi",
        "without a heading measurement it affects only the ground track; record psi, or turn",
    ),
    **{name: ((name,), f"no position was sampled; record {name}", f"record {name}") for name in ("x", "y")},
    "br": ((), "", "record psi, or beta and ground velocity; turn"),
    "bp": ((), "", "record phi"),
    "bq": ((), "", "record theta, or alpha and h"),
    "bay": ((), "", "record phi and beta; fly steady sideslips"),
    **{f"K{name}": ((), "", f"record {name} in larger manoeuvres") for name in ("ax", "ay", "az", "p", "q", "r")},
    **{
        f"K{name}": ((name,), f"{name} was not sampled", f"record larger changes of {name}")
        for name in ("phi", "theta")
    },
    "bax": ((), "", "record theta and V"),
    "baz": ((), "", "record theta, alpha and h; fly at different load factors"),
}


def reason_for_fixing(name: str, partners: Sequence[str], sampled: set[str]) -> str:
    """Reason why a state is fixed, and a remedy."""
    channels, reason, remedy = _ADVICE[name]
    if channels and not sampled & set(channels):
        return reason
    if partners:
        return f"cannot be separated from {', '.join(partners)} in this flight; {remedy}"
    return f"has almost no effect in this flight; {remedy}"
