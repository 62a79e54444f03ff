# %% [markdown]
# # Flight-path reconstruction: one flight path consistent with all instruments, and the errors of each instrument
#
# Run the complete file, or cell by cell. No files are needed, and none are written.

# %% [markdown]
# ## A flight in wind, recorded by instruments with biases, a vane with scale error, and noise
#
# All errors are known.

# %%
import matplotlib.pyplot as plt

from structsel import Candidates, select
from structsel.coefficients import compute_coefficients
from structsel.demo import TRUTH, demo_instruments
from structsel.plotting import plot_innovations, plot_readings
from structsel.reconstruction import reconstruct

flight = demo_instruments("all-axes", seed=1)
print(flight)

# %% [markdown]
# ## Reconstruction: accelerometers and gyros, less biases, are integrated; all other measurements correct the states

# %%
found = reconstruct(flight.measured, flight.aircraft)
print(found)

# %% [markdown]
# ## Sideslip: the vane, the reconstructed path, and the innovations

# %%
plot_readings(found, "beta")
plot_innovations(found, "beta")
plt.show()

# %% [markdown]
# ## Estimated and true instrument errors

# %%
print(f"{'':8}{'set':>11}{'found':>11}{'std':>10}  off, in std")
off = {}
for c in found.constants:
    off[c.name] = (c.value - flight.errors[c.name]) / c.std
    print(f"{c.name:8}{flight.errors[c.name]:11.4g}{c.value:11.4g}{c.std:10.2g}{off[c.name]:9.1f}   {c.unit}")

# %% [markdown]
# ## A side-force model of given structure, from the measurements and from the reconstructed flight

# %%
terms = ["beta", "p_hat", "r_hat", "da", "dr", "alpha*dr"]


def side_force(recording):
    with_coefficients = compute_coefficients(recording, flight.aircraft)
    return select(with_coefficients, "CY", Candidates.parse(terms), include=terms, bootstrap=0).model["CY"]


before, after, truth = side_force(flight.measured), side_force(found.recording), TRUTH["CY"]
print(f"{'':8}{'truth':>9}{'before':>9}{'after':>9}")
for term in terms:
    print(f"{term:8}{truth[term]:9.4f}{before[term]:9.4f}{after[term]:9.4f}")
wrong = {name: abs(model["beta"] / truth["beta"] - 1.0) for name, model in (("before", before), ("after", after))}
print("error of the sideslip derivative:", ", ".join(f"{100 * error:.1f} % {name}" for name, error in wrong.items()))

assert found.trusted, found.distrust
assert max(map(abs, off.values())) < 3.5, "an instrument's error is not what was set"
assert wrong["after"] < 0.01 < wrong["before"], "the sideslip derivative should improve"
