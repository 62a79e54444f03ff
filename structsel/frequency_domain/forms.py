"""Forms of transfer functions: factors with named parameters, read from the shorthand of handling qualities."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from structsel.errors import ModelError
from structsel.nomenclature import suggest
from structsel.numerics.transfer_functions import FactorKind

FORMS: Mapping[str, str] = {
    "short-period": "(1/Ttheta2) / [zeta, omega]",
    "pitch-attitude": "(1/Ttheta2) / s [zeta, omega]",
    "second-order": "/ [zeta, omega]",
    "roll": "/ (1/TR)",
    "bank-angle": "/ s (1/TR)",
    "roll-with-dutch-roll": "[zeta_phi, omega_phi] / (1/TR) [zeta, omega]",
    "dutch-roll": "/ [zeta, omega]",
}
"""Low-order equivalent systems by name [MIL1797], [H79]; each has a gain K and a delay tau."""

_TOKEN = re.compile(r"\s*(?:\(([^()]+)\)|\[([^\[\]]+)\]|\{([^{}]+)\}|(s)(?![A-Za-z0-9_])|(/))")
_GRAMMAR = "(a) is s + a, [zeta, omega] is s^2 + 2 zeta omega s + omega^2, {c1, c0} is s^2 + c1 s + c0, s is s."


@dataclass(frozen=True)
class FormFactor:
    """One factor: its kind, the names of its parameters, and 1 above the line or -1 below it."""

    kind: FactorKind
    names: tuple[str, ...]
    power: int


@dataclass(frozen=True)
class TransferForm:
    """Form of a transfer function, as text and as factors."""

    text: str
    factors: tuple[FormFactor, ...]


def read_form(given: str | tuple[int, int]) -> TransferForm:
    """Form of a name in `FORMS`, of a text in shorthand, or of (zeros, poles).

    ``"(1/Ttheta2) / [zeta, omega]"`` is K (s + 1/Ttheta2) / (s^2 + 2 zeta omega s + omega^2) exp(-tau s).

    Raises
    ------
    ModelError
        It cannot be read, has no pole, or names a parameter twice.
    """
    text = _general(given) if isinstance(given, tuple) else FORMS.get(given, given)
    factors: list[FormFactor] = []
    power, at = 1, 0
    while text[at:].strip():
        match = _TOKEN.match(text, at)
        if match is None:
            near = suggest(text, FORMS) if text == given else ""
            raise ModelError(
                f"the form {given!r} cannot be read at {text[at:]!r}.{near}\nGive one of {', '.join(FORMS)}, or "
                f"factors: {_GRAMMAR}"
            )
        first, second, quadratic, integrator, line = match.groups()
        if line:
            power = -1
        elif integrator:
            factors.append(FormFactor("integrator", (), power))
        else:
            kinds: dict[FactorKind, str | None] = {"first": first, "second": second, "quadratic": quadratic}
            kind, inside = next((kind, inside) for kind, inside in kinds.items() if inside)
            names = tuple(name.strip() for name in inside.split(","))
            if len(names) != (1 if kind == "first" else 2) or not all(names):
                raise ModelError(f"the form {given!r} has a factor with wrong parameters, '{inside}'.\n{_GRAMMAR}")
            factors.append(FormFactor(kind, names, power))
        at = match.end()
    all_names = [name for factor in factors for name in factor.names]
    if not any(factor.power < 0 for factor in factors):
        raise ModelError(f"the form {given!r} has no pole. Write '/' and the factors of the denominator.")
    if len(set(all_names)) < len(all_names):
        raise ModelError(f"the form {given!r} names a parameter twice. Each parameter of a form has its own name.")
    return TransferForm(text, tuple(factors))


def _general(orders: tuple[int, int]) -> str:
    """Shorthand of a rational function of (zeros, poles), as quadratics and at most one first-order factor."""
    if not (len(orders) == 2 and all(isinstance(n, int) for n in orders) and 0 <= orders[0] <= orders[1] >= 1):
        raise ModelError(f"a form of {orders!r} is not (zeros, poles) with poles >= 1 and not more zeros than poles.")
    parts = []
    for letter, order in zip("ba", orders):
        quadratics = [f"{{{letter}{2 * j + 1}, {letter}{2 * j}}}" for j in range(order // 2)]
        parts.append(" ".join(quadratics + ([f"({letter}{order - 1})"] if order % 2 else [])))
    return " / ".join(parts)
