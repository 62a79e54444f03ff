# %% [markdown]
# # Validation by simulation: input design, output error, and a simulation with the recorded inputs
#
# Run the complete file, or cell by cell. No files are needed, and none are written.

# %% [markdown]
# ## A published aircraft: its trim, and its response to disturbances

# %%
import matplotlib.pyplot as plt

import structsel as ss
from structsel.inputs import combine, name_derivatives, three_two_one_one
from structsel.plotting import plot_comparison, plot_cramer_rao, plot_resimulation

citation = ss.published_aircraft("citation")
steady = citation.trim(V=120.0, h=7500.0)
print(steady)
small = citation.linearise(steady, inputs=["de"])
print(small.modes())

# %% [markdown]
# ## Which input of equal energy gives the most accurate derivatives of pitch?
#
# Cramer-Rao bounds in per cent of each derivative

# %%
vanes = {"alpha": 0.008, "q": 0.004}
pitch = name_derivatives(small, outputs=list(vanes))
kinds = ss.compare_inputs(pitch, noise=vanes, parameters=["mw", "mq", "mde"], energy=0.004, duration=16.0)
print(kinds)
best = next(u for u in kinds.inputs if u.name == "optimal A")

# %%
plot_cramer_rao(kinds)
plt.show()

# %% [markdown]
# ## Recordings with this input, and with two classical ones, from trim; instruments have noise

# %%
noise = {**vanes, "V": 0.2, "theta": 0.002, "ax": 0.02, "az": 0.1}


def record(name, inputs, seed):
    """One recorded manoeuvre; inputs are departures from trim."""
    schedule = ss.Recording(name, inputs.t, {"de": steady["de"] + inputs["de"]})
    return citation.simulate(schedule, start=steady, instruments=ss.Instruments(noise=noise, seed=seed))


classical = combine(
    three_two_one_one("de", 0.02, 0.6, duration=16.0, dt=0.05),
    three_two_one_one("de", -0.02, 0.4, start=8.0, duration=16.0, dt=0.05),
)
manoeuvres = [record("optimal", best, 1), record("classical", classical, 2)]
held_out = record("held-out", three_two_one_one("de", -0.025, 0.5, duration=16.0, dt=0.05), 3)

# %% [markdown]
# ## Equation error: regression of the pitching moment on measured channels
#
# Noise of the regressors biases it.

# %%
terms = ["alpha", "q_hat", "de"]
chosen = ss.select(
    ss.compute_all(manoeuvres, citation.aircraft), "Cm", ss.Candidates.parse(terms), include=terms, bootstrap=0
)
first = ss.AeroModel({**citation.model.responses, "Cm": chosen.model["Cm"]}, "Citation")

# %% [markdown]
# ## Output error: the same structure, simulated over the complete length and fitted to the recorded outputs
#
# The manoeuvre that is held out decides whether the refined model predicts better. Each window starts from the recorded
# state, whose noise hides small differences: here the verdict is "no better", although the estimates are nearer the
# truth.

# %%
found = ss.refine(
    first, citation.aircraft, manoeuvres, free=["Cm:1", "Cm:alpha", "Cm:q_hat", "Cm:de"],
    outputs=["alpha", "q", "theta", "az"], starts=["u", "w", "q", "theta"], held_out=[held_out],
)  # fmt: skip
print(found)

# %% [markdown]
# ## Side by side

# %%
truth = {f"Cm:{term}": citation.model["Cm"][term] for term in ("1", *terms)}
table = ss.compare_estimates({"equation error": chosen.model, "output error": found}, truth=truth)
print(table)

# %%
plot_comparison(table)
plt.show()

# %% [markdown]
# ## Validation
#
# A manoeuvre that was not used, simulated with the recorded inputs from the recorded initial state

# %%
after = ss.resimulate(found.model, citation.aircraft, held_out, outputs=["alpha", "q", "theta", "az"])
print(after)

# %%
plot_resimulation(after, "held-out", "q")
plt.show()

by_regression, by_output_error = (abs(table.values / table.truth[:, None] - 1.0)).T
assert found.converged
assert found.verdict != "worse", "output error should not predict the manoeuvre worse than equation error"
assert by_output_error.max() < 0.01 < by_regression.max(), "output error should be within 1 %, equation error not"
assert (abs(found.values[:4] - table.truth) < 3.0 * found.std[:4]).all(), "the truth is outside three standard errors"
assert after.score("q").r2 > 0.97, "the refined model should reproduce the manoeuvre"
