# %% [markdown]
# # Derivatives while a flight is recorded: a loss of elevator effectiveness, seen within seconds
#
# Run the complete file, or cell by cell: figures and tables then appear below the cells. No files are needed, and none
# are written.

# %% [markdown]
# ## A flight of 80 s; after 40 s half of the elevator is lost

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy import signal

import structsel as ss
from structsel.plotting import plot_recursive_estimates

DT, LOST = 0.02, 40.0
citation = ss.published_aircraft("citation")
pitch = citation.linearise(citation.trim(V=120.0, h=7500.0), inputs=["de"], outputs=["alpha", "q"])
t = DT * np.arange(4000)
rng = np.random.default_rng(1)
de = 0.03 * signal.lfilter(*signal.butter(2, 1.0, fs=1.0 / DT), rng.standard_normal(t.size))
motion = pitch.simulate(ss.Recording("flight", t, {"de": np.where(t < LOST, 1.0, 0.5) * de}))
channels = {name: motion[name] + 2e-4 * rng.standard_normal(t.size) for name in ("alpha", "q")}
flight = ss.Recording("flight", t, {**channels, "de": de})

# %% [markdown]
# ## Recursive Fourier transform and equation error: q_dot on alpha, q and de

# %%
MEMORY = 10.0  # s, in which the weight of a sample falls to 1/e
monitor = ss.RecursiveEstimator("q_dot", ["alpha", "q", "de"], forgetting=float(np.exp(-DT / MEMORY)))
estimates = monitor.feed(flight, every=1.0)
print(estimates[-1])

# %% [markdown]
# ## The elevator effectiveness over time, with its 95 % interval

# %%
_, ax = plt.subplots(figsize=(8.0, 3.5), layout="constrained")
plot_recursive_estimates(estimates, "de", ax=ax)
ax.axvline(LOST, color="grey", ls=":")
ax.set_xlabel("time [s]")
ax.set_ylabel(r"$M_{\delta_e}$ [1/s$^2$]")
plt.show()

# %% [markdown]
# ## Half of the effectiveness is left

# %%
before = next(one["de"][0] for one in estimates if one.t >= LOST)
after = estimates[-1]["de"][0]
print(f"M_de {before:.2f} before, {after:.2f} 1/s^2 after")
assert 0.4 < after / before < 0.6
