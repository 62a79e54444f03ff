# %% [markdown]
# # Residuals of a model against any channel, and the gain of one more term
#
# Run the complete file, or cell by cell: figures and tables then appear below the cells. No files are needed, and none
# are written.

# %% [markdown]
# ## Five manoeuvres, and a model of the pitching moment with three derivatives only

# %%
from importlib.util import find_spec

import matplotlib.pyplot as plt

import structsel as ss
from structsel.exploring import try_additions
from structsel.plotting import plot_addition, plot_component, plot_residual_against, plot_residual_with

recordings, aircraft, truth = ss.demo_flights(5, turbulence=0.4)
manoeuvres = ss.compute_all(recordings, aircraft)


def fit(terms):
    """A model of these terms, without a selection."""
    pool = ss.Candidates.parse(terms)
    return ss.select(manoeuvres, "Cm", pool, include=terms, bootstrap=0).model


terms = ["alpha", "q_hat", "de"]
bare = fit(terms)
bare

# %% [markdown]
# ## Its residual against sideslip, which is not in the model
#
# For a complete model the bin means would be zero within their intervals. Here they form a parabola.

# %%
plot_residual_against(bare, manoeuvres, "Cm", "beta")
plt.show()

# %% [markdown]
# ## The gain of one more term
#
# All products of two channels, each added to the three terms. R2 grows with any term; the criterion is the R2 of
# manoeuvres held out in turn.

# %%
pool = ss.Candidates.polynomial(["alpha", "beta", "q_hat", "r_hat", "de"], degree=2)
offered = try_additions(bare, manoeuvres, "Cm", pool)
offered

# %% [markdown]
# ## Added-variable plot of the best term: is the relation linear after regression on the model's own terms?

# %%
plot_addition(bare, manoeuvres, "Cm", offered.terms[0])
plot_residual_with(bare, manoeuvres, "Cm", "beta", offered.terms[0])
plt.show()

# %% [markdown]
# ## Add the best term, and repeat until no term raises the held-out R2 by 0.001

# %%
while True:
    offered = try_additions(fit(terms), manoeuvres, "Cm", pool)
    best, before = offered.terms[0], offered.before[2]
    after = offered[best][2]
    print(f"{best!s:10} held out: R2 {before:.4f} -> {after:.4f}")
    if after - before < 0.001:
        break
    terms.append(str(best))

# %% [markdown]
# ## The residual of the larger model against sideslip, and its component in angle of attack, which is a curve

# %%
full = fit(terms)
plot_residual_against(full, manoeuvres, "Cm", "beta")
plot_component(full, manoeuvres, "Cm", "alpha")
plt.show()

# %% [markdown]
# ## The same by `select`, whose F-tests account for the residual autocorrelation

# %%
chosen = ss.select(manoeuvres, "Cm", pool, F_in="auto", bootstrap=0)
print("by hand:  ", ", ".join(sorted(terms)))
print("by select:", ", ".join(sorted(map(str, chosen.terms))))
chosen

# %% [markdown]
# ## Channels and terms chosen with the mouse
#
# In a notebook with ipywidgets (`pip install "structsel[notebooks]"`).

# %%
explorer = ss.explore_residuals(bare, manoeuvres, candidates=pool) if find_spec("ipywidgets") else "no ipywidgets here"
explorer

# %% [markdown]
# ## Comparison with the true terms

# %%
given = set(truth["Cm"]) - {"1"}
print("given:    ", ", ".join(sorted(given)))

assert given <= set(terms), "a term was left in the residual"
assert set(terms) == {str(term) for term in chosen.terms}, "select and the residuals should agree"
