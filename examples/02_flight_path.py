# %% [markdown]
# # The first of two steps: one flight path that all instruments can have seen, and what is wrong with each of them
#
# Run it whole, or cell by cell. No files are needed, and none are written.

# %% [markdown]
# ## A flight in wind, seen by instruments with biases, a crooked vane, and noise
#
# All of it is known.

# %%
from structsel import Candidates, select
from structsel.coefficients import compute_coefficients
from structsel.demo import TRUTH, demo_instruments
from structsel.reconstruction import reconstruct

flight = demo_instruments("all-axes", seed=1)
print(flight)

# %% [markdown]
# ## Reconstruct: accelerometers and gyros, less biases, drive the kinematics; everything else corrects them

# %%
found = reconstruct(flight.measured, flight.aircraft)
print(found)

# %% [markdown]
# ## What was found, beside what was set

# %%
print(f"{'':8}{'set':>11}{'found':>11}{'std':>10}  off, in std")
off = {}
for c in found.constants:
    off[c.name] = (c.value - flight.errors[c.name]) / c.std
    print(f"{c.name:8}{flight.errors[c.name]:11.4g}{c.value:11.4g}{c.std:10.2g}{off[c.name]:9.1f}   {c.unit}")

# %% [markdown]
# ## What it is for: a side-force model of given structure, from the readings and from the reconstructed flight

# %%
terms = ["beta", "p_hat", "r_hat", "da", "dr", "alpha*dr"]


def side_force(recording):
    flown = compute_coefficients(recording, flight.aircraft)
    return select(flown, "CY", Candidates.parse(terms), include=terms, bootstrap=0).model["CY"]


before, after, truth = side_force(flight.measured), side_force(found.recording), TRUTH["CY"]
print(f"{'':8}{'truth':>9}{'before':>9}{'after':>9}")
for term in terms:
    print(f"{term:8}{truth[term]:9.4f}{before[term]:9.4f}{after[term]:9.4f}")
wrong = {name: abs(model["beta"] / truth["beta"] - 1.0) for name, model in (("before", before), ("after", after))}
print("sideslip derivative off by", ", ".join(f"{100 * share:.1f} % {name}" for name, share in wrong.items()))

assert found.trusted, found.distrust
assert max(map(abs, off.values())) < 3.5, "an instrument's error is not what was set"
assert wrong["after"] < 0.01 < wrong["before"], "the sideslip derivative was to get better"
