# %% [markdown]
# # A chosen structure is believed when it flies: inputs worth flying, output error, and the proof of match
#
# Run it whole, or cell by cell. No files are needed, and none are written.

# %% [markdown]
# ## An aircraft of which everything is known: its steady flight, and how it answers when disturbed

# %%
import structsel as ss
from structsel.inputs import combine, name_derivatives, three_two_one_one

craft = ss.published_aircraft("citation")
steady = craft.trim(V=120.0, h=7500.0)
print(steady)
small = craft.linearise(steady, inputs=["de"])
print(small.modes())

# %% [markdown]
# ## Which input of equal energy tells most about the derivatives of pitch?
#
# Bounds in per cent of each

# %%
vanes = {"alpha": 0.008, "q": 0.004}
pitch = name_derivatives(small, outputs=list(vanes))
kinds = ss.compare_inputs(pitch, noise=vanes, parameters=["mw", "mq", "mde"], energy=0.004, duration=16.0)
print(kinds)
best = next(u for u in kinds.inputs if u.name == "optimal A")

# %% [markdown]
# ## Fly it, and two classical ones, from trim; instruments have noise

# %%
noise = {**vanes, "V": 0.2, "theta": 0.002, "ax": 0.02, "az": 0.1}


def fly(name, inputs, seed):
    """One recorded manoeuvre; inputs are departures from trim."""
    schedule = ss.Recording(name, inputs.t, {"de": steady["de"] + inputs["de"]})
    return craft.simulate(schedule, start=steady, instruments=ss.Instruments(noise=noise, seed=seed))


classical = combine(
    three_two_one_one("de", 0.02, 0.6, duration=16.0, dt=0.05),
    three_two_one_one("de", -0.02, 0.4, start=8.0, duration=16.0, dt=0.05),
)
flown = [fly("optimal", best, 1), fly("classical", classical, 2)]
held_out = fly("held-out", three_two_one_one("de", -0.025, 0.5, duration=16.0, dt=0.05), 3)

# %% [markdown]
# ## Equation error: the moment sample by sample, on measured channels
#
# Their noise biases it.

# %%
terms = ["alpha", "q_hat", "de"]
chosen = ss.select(ss.compute_all(flown, craft.aircraft), "Cm", ss.Candidates.parse(terms), include=terms, bootstrap=0)
first = ss.AeroModel({**craft.model.responses, "Cm": chosen.model["Cm"]}, "Citation")

# %% [markdown]
# ## Output error: the same structure, flown whole; the flights are to come nearest those recorded

# %%
found = ss.refine(
    first, craft.aircraft, flown, free=["Cm:1", "Cm:alpha", "Cm:q_hat", "Cm:de"], outputs=["alpha", "q", "theta", "az"],
    starts=["u", "w", "q", "theta"],
)  # fmt: skip
print(found)

# %% [markdown]
# ## Side by side

# %%
truth = {f"Cm:{term}": craft.model["Cm"][term] for term in ("1", *terms)}
table = ss.compare_estimates({"equation error": chosen.model, "output error": found}, truth=truth)
print(table)

# %% [markdown]
# ## Does it fly?
#
# A manoeuvre that was never used, with the recorded inputs from the recorded start

# %%
after = ss.resimulate(found.model, craft.aircraft, held_out, outputs=["alpha", "q", "theta", "az"])
print(after)

by_regression, by_flights = (abs(table.values / table.truth[:, None] - 1.0)).T
assert found.converged
assert by_flights.max() < 0.01 < by_regression.max(), "output error was to come within 1 %, equation error not"
assert (abs(found.values[:4] - table.truth) < 3.0 * found.std[:4]).all(), "the truth is outside three standard errors"
assert after.score("q").r2 > 0.97, "the refined model was to fly"
