# %% [markdown]
# # A first model: from recordings to a chosen structure, on flights whose truth is known
#
# Run it whole, or cell by cell. No files are needed, and none are written.

# %% [markdown]
# ## Six manoeuvres, as an aeroplane would record them, in light turbulence

# %%
from structsel import Candidates, select, validate
from structsel.coefficients import compute_all
from structsel.demo import demo_flights

recordings, aircraft, truth = demo_flights(turbulence=0.4)
print(aircraft)
print(recordings[0])

# %% [markdown]
# ## What the air did: coefficients, and the dimensionless channels that terms are made of
#
# One aircraft, one reference airspeed for all.

# %%
flown = compute_all(recordings, aircraft)
used, held_out = flown[:-1], flown[-1]

# %% [markdown]
# ## What might matter: every product up to degree 3 of five channels, and a spline in angle of attack

# %%
pool = Candidates.polynomial(["alpha", "beta", "q_hat", "r_hat", "de"], degree=3)
pool = pool + Candidates.splines("alpha", [0.2])
print(f"{len(pool)} candidates: {pool}")

# %% [markdown]
# ## Choose
#
# The entry threshold fits the size of the pool.

# %%
found = select(used, "Cm", pool, F_in="auto")
chosen = found["Cm"]
print(chosen)

# %% [markdown]
# ## Why: every move of the search

# %%
for step in chosen.trace:
    print(step)

# %% [markdown]
# ## How far to trust it: a flight that was never selected from

# %%
print(validate(found.model, held_out))

# %% [markdown]
# ## The terms the simulation was given were kept, most of them near their value

# %%
kept = {str(term) for term in chosen.terms}
given = set(truth["Cm"]) - {"1"}
print("missed:", sorted(given - kept), " false:", sorted(kept - given))
model = found.model["Cm"]
for term, value in truth["Cm"].items():
    if term in model:
        print(f"{term:8} truth {value:8.4g}   found {model[term]:8.4g}")

assert given <= kept, "a true term was missed"
assert abs(model["de"] / truth["Cm"]["de"] - 1.0) < 0.02, "the elevator's effect is off by more than 2 %"
assert validate(found.model, held_out).score("Cm").r2 > 0.95
