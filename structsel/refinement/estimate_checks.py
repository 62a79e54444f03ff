"""Warnings about the estimates of a refinement."""

from __future__ import annotations

import numpy as np

from structsel.formatting import format_number
from structsel.refinement.result import Estimate

CORRELATED = 0.9  # correlation of two estimates above which a warning names them


def check_estimates(
    estimates: tuple[Estimate, ...], correlation: np.ndarray, converged: bool, message: str
) -> tuple[str, ...]:
    """Warnings about estimates and their search."""
    found = [] if converged else [f"the search did not converge: {message}"]
    for e in estimates:
        if e.kind == "process" and e.at_bound:
            state = e.name.rsplit(":", 1)[1]
            found.append(
                f"process noise of {state} at its upper bound: the filter takes {state} from the measurements"
                if e.value > 0.5 * e.high
                else f"process noise of {state} at its lower bound: none is needed there"
            )
    bounded = [e for e in estimates if e.at_bound and e.kind != "process"]
    if bounded:
        named = ", ".join(f"{e.name} = {e.value:.5g}" for e in bounded)
        found.append(f"at a bound, beyond which the cost may be lower: {named}")
    lost = [e.name for e in estimates if np.isinf(e.std) and not (e.kind == "process" and e.at_bound)]
    if lost:
        found.append(f"these recordings do not determine {', '.join(lost)}")
    weak = [e for e in estimates if e.kind == "model" and np.isfinite(e.std) and e.std > 0.5 * abs(e.value)]
    if weak:
        named = ", ".join(f"{e.name} ({format_number(e.value, 3)} +- {format_number(e.std, 2)})" for e in weak)
        found.append(f"the outputs hardly depend on {named}: hold them, or record an input that excites them")
    idle = np.array([e.kind == "process" and e.at_bound for e in estimates])
    strong = np.argwhere(np.triu((np.abs(correlation) > CORRELATED) & ~idle & ~idle[:, None], 1))
    order = sorted(strong.tolist(), key=lambda pair: -abs(correlation[pair[0], pair[1]]))
    for i, j in order[:10]:
        found.append(
            f"{estimates[i].name} and {estimates[j].name} are correlated: {correlation[i, j]:+.3f}; these "
            "recordings hardly distinguish them"
        )
    if len(order) > 10:
        found.append(f"{len(order) - 10} more pairs are correlated above {CORRELATED:g}")
    of_interest = [e for e in estimates if e.kind != "process"]
    ratio = [e.std / e.std_white for e in of_interest if np.isfinite(e.std) and e.std_white > 0.0]
    if ratio and max(ratio) > 2.0:
        found.append(
            f"residuals are coloured: standard deviations are up to {max(ratio):.1f} times the Cramer-Rao bound; "
            "a missing term of the model, or turbulence, is in them"
        )
    return tuple(found)
