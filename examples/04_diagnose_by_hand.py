# %% [markdown]
# # Which physics does a simulation lack? One case diagnosed from its residuals by hand, then by `diagnose`
#
# Run the whole file, or cell by cell. It needs no files and writes one figure, 04_residuals.png. The case is easy, so
# that a reader can follow it by eye; docs/proof.md reports how often the diagnosis is right.

# %% [markdown]
# ## Six recorded flights, and the coefficients of a simulation along them
#
# The simulation lacks one effect.

# %%
import matplotlib.pyplot as plt
import numpy as np

from structsel import compute_all
from structsel.demo import demo_missing_physics
from structsel.diagnosis import diagnose

case = demo_missing_physics(flights=6)
aircraft, span = case.aircraft, case.aircraft.b
print(aircraft)
print(case.recordings[0])

# %% [markdown]
# ## Measured coefficients less those of the simulation at the same states

# %%
AXES = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
measured = {r.name: r for r in compute_all(case.recordings, aircraft)}
names = list(measured)
difference = {c: {n: measured[n][c] - case.simulated[n][c] for n in names} for c in AXES}


def rms(parts):
    """Root mean square over recordings, each about its own mean: instruments have constant biases."""
    return np.sqrt(np.mean(np.concatenate([(x - x.mean()) ** 2 for x in parts])))


print(f"{'':4}{'measured':>10}{'difference':>12}")
for c in AXES:
    print(f"{c:4}{rms([r[c] for r in measured.values()]):10.4f}{rms(difference[c].values()):12.4f}")

# %% [markdown]
# ## Which axis stands out from its noise?
#
# Second differences leave noise and little else.

# %%
noise = {c: np.median([np.std(np.diff(x, 2)) for x in difference[c].values()]) / np.sqrt(6.0) for c in AXES}
times = {c: rms(difference[c].values()) / noise[c] for c in AXES}
print("difference over noise:", ", ".join(f"{c} {times[c]:.1f}" for c in sorted(times, key=times.get, reverse=True)))

# %% [markdown]
# ## When?
#
# The difference in CZ less its mean over the first two seconds, averaged over half a second

# %%
width = round(0.5 / case.recordings[0].dt)
start = {n: x[measured[n].t < 2.0].mean() for n, x in difference["CZ"].items()}
smooth = {n: np.convolve(x - start[n], np.ones(width) / width, mode="same") for n, x in difference["CZ"].items()}
for n, x in smooth.items():
    t = measured[n].t[np.abs(x) > 4.0 * noise["CZ"]]
    lowest = measured[n]["h_agl"].min() / span
    print(
        f"{n}  lowest at {lowest:5.1f} spans; " + (f"off from {t[0]:.1f} to {t[-1]:.1f} s" if len(t) else "never off")
    )

# %% [markdown]
# ## Where?
#
# The difference against angle of attack, height and time: which part of its variance do the means of 24 bins explain?

# %%
e = np.concatenate(list(smooth.values()))
channels = {
    "alpha [deg]": np.degrees(np.concatenate([r["alpha"] for r in measured.values()])),
    "height / span": np.concatenate([r["h_agl"] for r in measured.values()]) / span,
    "time [s]": np.concatenate([r.t for r in measured.values()]),
}
left = {}
for name, x in channels.items():
    cells = np.digitize(x, np.quantile(x, np.linspace(0.0, 1.0, 25)[1:-1]))
    means = np.array([e[cells == k].mean() for k in range(24)])
    left[name] = float(np.var(e - means[cells]) / np.var(e))
    print(f"{name:14} explains {1.0 - left[name]:4.0%} of CZ's difference as a function, whatever its form")

figure, grid = plt.subplots(3, 1, figsize=(9.0, 6.5), layout="constrained")
for axes, (name, x) in zip(grid, channels.items()):
    axes.plot(x, e, ".", markersize=1.5)
    axes.set_xlabel(name)
    axes.axhline(0.0, color="0.5", linewidth=0.8)
grid[1].set_xlim(0.0, 1.5)  # the other flights were at two hundred spans and more
figure.supylabel("CZ, measured less simulated, from the level of the first two seconds")
figure.savefig("04_residuals.png", dpi=110)

# %% [markdown]
# ## What could it be?
#
# An effect that acts near the ground only. Three explanations are fitted to all recordings but one low pass: changed
# derivatives of the simulation; a switch (flap or gear, forgotten); ground effect, which decays with height. The low
# pass that was left out tests the fit. It does not test the choice of low flight: the figure above shows that pass too.

# %%
DERIVATIVES = ("alpha", "q_hat", "de")
low = [n for n in names if measured[n]["h_agl"].min() < span]
held_out = low[-1]


def columns(n, explanation, decay):
    """Columns that may explain the difference of one recording."""
    r, near = measured[n], np.exp(-decay * measured[n]["h_agl"] / span)
    lift = case.simulated[n]["CX"] * np.sin(r["alpha"]) - case.simulated[n]["CZ"] * np.cos(r["alpha"])
    made = [r[c] for c in DERIVATIVES]
    made += {"derivatives": [], "switch": [1.0 * (r["h_agl"] < 0.5 * span)], "ground": [near * lift]}[explanation]
    return np.column_stack([x - x.mean() for x in made])  # each recording has its own constant biases


def fit(c, explanation, decay=1.0):
    """Parameters from all recordings but one, and the fraction of that one's variance that they predict."""
    used = [n for n in names if n != held_out]
    y = {n: difference[c][n] - difference[c][n].mean() for n in names}
    X = np.vstack([columns(n, explanation, decay) for n in used])
    theta = np.linalg.lstsq(X, np.concatenate([y[n] for n in used]), rcond=None)[0]
    within = np.mean((np.concatenate([y[n] for n in used]) - X @ theta) ** 2)
    ahead = y[held_out] - columns(held_out, explanation, decay) @ theta
    return theta, within, 1.0 - np.mean(ahead**2) / np.mean(y[held_out] ** 2)


decays = np.arange(1.0, 7.01, 0.25)
decay = decays[np.argmin([fit("CZ", "ground", d)[1] for d in decays])]
print(f"fraction of the difference in {held_out} predicted from the others; decay {decay:.2f} per span of height")
print(f"{'':4}{'derivatives':>13}{'switch':>9}{'ground effect':>15}")
predicted = {c: {a: fit(c, a, decay)[2] for a in ("derivatives", "switch", "ground")} for c in ("CZ", "Cm")}
for c, fraction in predicted.items():
    print(f"{c:4}{fraction['derivatives']:13.2f}{fraction['switch']:9.2f}{fraction['ground']:15.2f}")
lift_gain, moment = -fit("CZ", "ground", decay)[0][-1], fit("Cm", "ground", decay)[0][-1]
print(f"at the ground: {lift_gain:.0%} more lift, and {moment:.3f} of the lift as pitching moment, nose down")

# %% [markdown]
# ## The same by the tool: all effects, all responses together, tolerances, each recording held out in turn

# %%
found = diagnose(case.simulated, case.recordings, aircraft)
print(found)

# %% [markdown]
# ## The truth
#
# The tool tries a few decays and estimates the gain of lift at the most probable one. Its +- does not contain the
# uncertainty of the decay.

# %%
print(f"missing: {case.effect}", dict(case.terms["CZ"]))
gain, truth = 0.20, 4.0  # of the lift, and per span of height: see demo_missing_physics
first = found.findings[0]
estimates = first.physics[0].parameters
print(f"{'':18}{'truth':>7}{'by hand':>9}{'diagnose':>10}")
print(f"{'lift gained':18}{gain:7.3f}{lift_gain:9.3f}{estimates['lift'].value:10.3f}")
print(f"{'decay per span':18}{truth:7.2f}{decay:9.2f}{estimates['decay'].value:10.2f}")

assert times["CZ"] == max(times.values()), "CZ should exceed its noise most"
assert left["height / span"] < 0.5 < left["alpha [deg]"], "height should explain the difference, alpha should not"
assert predicted["CZ"]["ground"] > max(0.9, predicted["CZ"]["derivatives"] + 0.3, predicted["CZ"]["switch"])
assert (found.verdict, first.effect) == ("mismatch", case.effect)
assert max(abs(lift_gain / gain - 1.0), abs(estimates["lift"].value / gain - 1.0)) < 0.2, "the gain of lift is off"
