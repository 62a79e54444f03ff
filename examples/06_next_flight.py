# %% [markdown]
# # Which flight next? What the last one could not tell apart, the input that would, and a proof that it does
#
# Run it whole, or cell by cell, where figures and tables appear below the cells. No files are needed, and none are
# written.

# %% [markdown]
# ## The last flight: a slow elevator doublet, angle of attack and pitch rate measured

# %%
import matplotlib.pyplot as plt
import numpy as np

import structsel as ss
from structsel.inputs import doublet, information, name_derivatives, scatter, with_energy
from structsel.plotting import plot_histories

craft = ss.published_aircraft("citation")
steady = craft.trim(V=120.0, h=7500.0)
pitch = name_derivatives(craft.linearise(steady, inputs=["de"]), outputs=["alpha", "q"])
noise = {"alpha": 0.008, "q": 0.004}
moments = ["mw", "mq", "mde"]
last = doublet("de", 0.02, 2.5, duration=16.0, dt=0.05)
told = information(pitch, last, noise=noise, parameters=moments)
told

# %% [markdown]
# ## Pitch damping and the elevator's effect trade against each other: their errors go together

# %%
print("correlation of the errors of", ", ".join(moments))
print(np.array2string(told.correlation, precision=2, suppress_small=True))

# %% [markdown]
# ## The input that tells most about the three within what may be flown: elevator, its rate, and angle of attack

# %%
limits = {"de": 0.02, "alpha": np.deg2rad(2.0)}
design = ss.design_inputs(
    pitch, noise=noise, parameters=moments, limits=limits, rate_limits={"de": 0.15}, duration=16.0
)
design

# %%
_, (top, bottom) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.0), layout="constrained")
both = {"last": pitch.simulate(last), "designed": pitch.simulate(design.inputs)}
plot_histories(both, "de", ax=top)
plot_histories(both, "alpha", ax=bottom)

# %% [markdown]
# ## Is it the shape, or only the energy? The doublet again, with as much

# %%
strong = with_energy(last, design.energy)
for name, flight in (("doublet", last), ("doublet of as much energy", strong), ("designed", design.inputs)):
    bounds = information(pitch, flight, noise=noise, parameters=moments).crlb
    shares = [f"{p} {100 * s / abs(pitch.parameters[p]):5.2f} %" for p, s in zip(moments, bounds)]
    print(f"{name:26}", "   ".join(shares))

# %% [markdown]
# ## Proof: fly each 200 times with fresh noise, estimate by output error, and see how far the estimates scatter

# %%
flights = {
    name: scatter(pitch, flight, noise=noise, parameters=moments, runs=200, seed=1)
    for name, flight in (("last", last), ("designed", design.inputs))
}
gained = flights["last"].std / flights["designed"].std
print("the designed flight is worth", ", ".join(f"{g**2:.1f} of the last for {p}" for p, g in zip(moments, gained)))
flights["designed"]

# %% [markdown]
# ## To fly it: a table of time and elevator, as `simulate` takes it, and an autopilot

# %%
design.to_recording()

# %%
reached = {one.what: one.reached for one in design.limits}
assert all(reached[name] <= 1.001 * allowed for name, allowed in limits.items()), "a limit is broken"
assert all(abs(one.std / one.crlb - 1.0).max() < 0.2 for one in flights.values()), "the bounds were to be met"
assert gained.min() > 1.5, "the designed input was to tell clearly more"
