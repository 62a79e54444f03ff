"""The proof of the diagnosis: synthetic cases with a known error, diagnosed by a process that does not see the key.

The proof imports structsel, never the reverse, and it is not in the wheel: run ``python -m proof`` from a clone.
Three things are independent of what they prove, and must stay so:

- the formulas of the injected effects (`proof.polynomial`, `proof.jsbsim`, `proof.scenario`): written from the
  literature, with separation and wake states of their own; they may import nothing of `structsel.effects`,
  `structsel.comparison` or `structsel.diagnosis`, which import-linter checks;
- JSBSim as a plant: equations, integrator, atmosphere and tables of its own, none of them structsel's;
- the errors of instruments, the delays and the backlash of the truth.

Everything else may be shared: geometry, published coefficients, atmosphere, the Dryden spectrum and the coefficients
computed from readings have tests of their own against the literature.
"""

from proof.case_files import Case, write_case
from proof.keys import EffectKey, Key

__all__ = ["Case", "EffectKey", "Key", "write_case"]
