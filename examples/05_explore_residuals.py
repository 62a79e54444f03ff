# %% [markdown]
# # What does a model leave? Its residual against any channel, and what adding a term would do
#
# Run it whole, or cell by cell, where figures and tables appear below the cells. No files are needed, and none are
# written.

# %% [markdown]
# ## Five manoeuvres, and a model of the pitching moment that has the usual three derivatives only

# %%
from importlib.util import find_spec

import structsel as ss
from structsel.exploring import try_additions
from structsel.plotting import plot_addition, plot_component, plot_residual_against, plot_residual_with

recordings, aircraft, truth = ss.demo_flights(5, turbulence=0.4)
flown = ss.compute_all(recordings, aircraft)


def fit(terms):
    """A model of these terms, whatever the tests would say of them."""
    pool = ss.Candidates.parse(terms)
    return ss.select(flown, "Cm", pool, include=terms, bootstrap=0).model


terms = ["alpha", "q_hat", "de"]
bare = fit(terms)
bare

# %% [markdown]
# ## Its residual against sideslip, a channel it does not have
#
# Were nothing missing, the means of the bins would be zero within their intervals. They make a parabola.

# %%
plot_residual_against(bare, flown, "Cm", "beta")

# %% [markdown]
# ## What would one more term do?
#
# All products of two channels, each added to the three. R2 grows with any term; what counts is the R2 of manoeuvres
# held out in turn.

# %%
pool = ss.Candidates.polynomial(["alpha", "beta", "q_hat", "r_hat", "de"], degree=2)
offered = try_additions(bare, flown, "Cm", pool)
offered

# %% [markdown]
# ## The best of them: is it a straight line once the model's own terms are taken out of both?

# %%
plot_addition(bare, flown, "Cm", offered.terms[0])
plot_residual_with(bare, flown, "Cm", "beta", offered.terms[0])

# %% [markdown]
# ## Add the best, look again, until no term helps the manoeuvres held out by a tenth of a per cent

# %%
while True:
    offered = try_additions(fit(terms), flown, "Cm", pool)
    best, before = offered.terms[0], offered.before[2]
    after = offered[best][2]
    print(f"{best!s:10} held out: R2 {before:.4f} -> {after:.4f}")
    if after - before < 0.001:
        break
    terms.append(str(best))

# %% [markdown]
# ## What is left now: nothing against sideslip, and what the model has in angle of attack is a curve

# %%
full = fit(terms)
plot_residual_against(full, flown, "Cm", "beta")
plot_component(full, flown, "Cm", "alpha")

# %% [markdown]
# ## The same by `select`, with F-tests that know neighbouring samples to be alike

# %%
chosen = ss.select(flown, "Cm", pool, F_in="auto", bootstrap=0)["Cm"]
print("by hand:  ", ", ".join(sorted(terms)))
print("by select:", ", ".join(sorted(map(str, chosen.terms))))
chosen

# %% [markdown]
# ## To pick channels and terms with the mouse
#
# In a notebook with ipywidgets, which `pip install "structsel[notebooks]"` brings.

# %%
explorer = ss.explore_residuals(bare, flown, candidates=pool) if find_spec("ipywidgets") else "no ipywidgets here"
explorer

# %% [markdown]
# ## The terms the simulation was given were found

# %%
given = set(truth["Cm"]) - {"1"}
print("given:    ", ", ".join(sorted(given)))

assert given <= set(terms), "a term was left in the residual"
assert set(terms) == {str(term) for term in chosen.terms}, "select and the eye were to agree"
