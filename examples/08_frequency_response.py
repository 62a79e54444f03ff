# %% [markdown]
# # Frequency response of an elevator sweep, and the low-order equivalent system with its delay
#
# Run the complete file, or cell by cell: figures and tables then appear below the cells. No files are needed, and none
# are written.

# %% [markdown]
# ## Three sweeps of an aircraft whose short period is known; the elevator acts 0.06 s late

# %%
import matplotlib.pyplot as plt
import numpy as np

import structsel as ss
from structsel.plotting import plot_bode

DT, DURATION, DELAY = 0.02, 80.0, 0.06
citation = ss.published_aircraft("citation")
pitch = citation.linearise(citation.trim(V=120.0, h=7500.0), inputs=["de"], outputs=["alpha", "q"])
t = DT * np.arange(round(DURATION / DT))
rate = 0.3 * (12.0 / 0.3) ** np.clip((t - 3.0) / (DURATION - 6.0), 0.0, 1.0)  # rad/s
ends = np.clip(t / 3.0, 0.0, 1.0) * np.clip((DURATION - t) / 3.0, 0.0, 1.0)
sweeps = []
for k in range(3):
    rng = np.random.default_rng(k)
    stick = 0.02 * np.sin(DT * np.cumsum(rate)) * ends
    acting = np.interp(t - DELAY, t, stick)
    motion = pitch.simulate(ss.Recording(f"sweep {k + 1}", t, {"de": acting}))
    q = motion["q"] + 0.001 * rng.standard_normal(t.size)
    sweeps.append(ss.Recording(f"sweep {k + 1}", t, {"de": stick, "q": q}))

# %% [markdown]
# ## Magnitude, phase and coherence, with random errors

# %%
response = ss.frequency_response(sweeps, "q", "de", band=(0.6, 12.0))
response

# %% [markdown]
# ## The short period: K (s + 1/Ttheta2) exp(-tau s) over s^2 + 2 zeta omega s + omega^2

# %%
fit = ss.fit_transfer_function(response, "short-period")
print(fit)

# %%
plot_bode(response, fit=fit)
plt.show()

# %% [markdown]
# ## The same pole and delay as those of the aircraft

# %%
poles = np.linalg.eigvals(pitch.system.A)
true = poles[np.argmax(np.abs(poles) * (poles.imag > 0.0))]
print(f"short period of the aircraft: omega {abs(true):.3f} rad/s, zeta {-true.real / abs(true):.3f}, delay {DELAY} s")
truth = {"omega": abs(true), "zeta": -true.real / abs(true), "tau": DELAY + DT / 2}  # inputs are held over a sample
assert all(abs(fit[name][0] - value) < 3.0 * fit[name][1] for name, value in truth.items())
