# %% [markdown]
# # A first model: structure selection from recordings of simulated flights whose truth is known
#
# Run the complete file, or cell by cell. No files are needed, and none are written.

# %% [markdown]
# ## Six recorded manoeuvres in light turbulence

# %%
import matplotlib.pyplot as plt

from structsel import Candidates, select, validate
from structsel.coefficients import compute_all
from structsel.demo import demo_flights
from structsel.plotting import plot_fit, plot_search

recordings, aircraft, truth = demo_flights(turbulence=0.4)
print(aircraft)
print(recordings[0])

# %% [markdown]
# ## Aerodynamic coefficients and dimensionless channels
#
# All manoeuvres have the same aircraft and the same reference airspeed.

# %%
with_coefficients = compute_all(recordings, aircraft)
used, held_out = with_coefficients[:-1], with_coefficients[-1]

# %% [markdown]
# ## Candidate terms: every product up to degree 3 of five channels, and a spline in angle of attack

# %%
pool = Candidates.polynomial(["alpha", "beta", "q_hat", "r_hat", "de"], degree=3)
pool = pool + Candidates.splines("alpha", [0.2])
print(f"{len(pool)} candidates: {pool}")

# %% [markdown]
# ## Selection
#
# The entry threshold is set for the size of the pool.

# %%
chosen = select(used, "Cm", pool, F_in="auto")
print(chosen)

# %% [markdown]
# ## Every step of the search

# %%
for step in chosen.trace:
    print(step)

# %%
plot_search(chosen)
plt.show()

# %% [markdown]
# ## Validation with a flight that was not used for the selection

# %%
print(validate(chosen.model, held_out))

# %%
plot_fit(chosen.model, held_out, "Cm")
plt.show()

# %% [markdown]
# ## Comparison with the true terms

# %%
kept = {str(term) for term in chosen.terms}
given = set(truth["Cm"]) - {"1"}
print("missed:", sorted(given - kept), " false:", sorted(kept - given))
model = chosen.model["Cm"]
for term, value in truth["Cm"].items():
    if term in model:
        print(f"{term:8} truth {value:8.4g}   found {model[term]:8.4g}")

assert given <= kept, "a true term was missed"
assert abs(model["de"] / truth["Cm"]["de"] - 1.0) < 0.02, "the elevator's effect is off by more than 2 %"
assert validate(chosen.model, held_out).score("Cm").r2 > 0.95
