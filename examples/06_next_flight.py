# %% [markdown]
# # Design of the next flight: the derivatives the last one could not separate, and an input that separates them
#
# Run the complete file, or cell by cell: figures and tables then appear below the cells. No files are needed, and none
# are written.

# %% [markdown]
# ## The last flight: a slow elevator doublet, angle of attack and pitch rate measured

# %%
import matplotlib.pyplot as plt
import numpy as np

import structsel as ss
from structsel.inputs import doublet, information, name_derivatives, scatter, with_energy
from structsel.plotting import plot_histories

citation = ss.published_aircraft("citation")
steady = citation.trim(V=120.0, h=7500.0)
pitch = name_derivatives(citation.linearise(steady, inputs=["de"]), outputs=["alpha", "q"])
noise = {"alpha": 0.008, "q": 0.004}
derivatives = ["mw", "mq", "mde"]
last = doublet("de", 0.02, 2.5, duration=16.0, dt=0.05)
accuracy = information(pitch, last, noise=noise, parameters=derivatives)
accuracy

# %% [markdown]
# ## The errors of pitch damping and elevator effectiveness are correlated

# %%
print("correlation of the errors of", ", ".join(derivatives))
print(np.array2string(accuracy.correlation, precision=2, suppress_small=True))

# %% [markdown]
# ## The optimal input within limits on elevator, elevator rate and angle of attack

# %%
limits = {"de": 0.02, "alpha": np.deg2rad(2.0)}
design = ss.design_inputs(
    pitch, noise=noise, parameters=derivatives, limits=limits, rate_limits={"de": 0.15}, duration=16.0
)
design

# %%
_, (top, bottom) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.0), layout="constrained")
both = {"last": pitch.simulate(last), "designed": pitch.simulate(design.inputs)}
plot_histories(both, "de", ax=top)
plot_histories(both, "alpha", ax=bottom)
plt.show()

# %% [markdown]
# ## Shape or energy? The doublet with the energy of the designed input

# %%
strong = with_energy(last, design.energy)
for name, flight in (("doublet", last), ("doublet of equal energy", strong), ("designed", design.inputs)):
    bounds = information(pitch, flight, noise=noise, parameters=derivatives).crlb
    errors = [f"{p} {100 * s / abs(pitch.parameters[p]):5.2f} %" for p, s in zip(derivatives, bounds)]
    print(f"{name:26}", "   ".join(errors))

# %% [markdown]
# ## Check: 200 simulations of each with new noise, estimates by output error, and the scatter of the estimates

# %%
flights = {
    name: scatter(pitch, flight, noise=noise, parameters=derivatives, runs=200, seed=1)
    for name, flight in (("last", last), ("designed", design.inputs))
}
gained = flights["last"].std / flights["designed"].std
print("the designed flight equals", ", ".join(f"{g**2:.1f} of the last for {p}" for p, g in zip(derivatives, gained)))
flights["designed"]

# %% [markdown]
# ## The input as a table of time and elevator, for `simulate` or an autopilot

# %%
design.to_recording()

# %%
reached = {one.what: one.reached for one in design.limits}
assert all(reached[name] <= 1.001 * allowed for name, allowed in limits.items()), "a limit is broken"
assert all(abs(one.std / one.crlb - 1.0).max() < 0.2 for one in flights.values()), "the scatter should equal the bounds"
assert gained.min() > 1.5, "the designed input should be clearly more accurate"
