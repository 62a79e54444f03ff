# %% [markdown]
# # What did the simulation leave out? One concealed case diagnosed by hand, by looking at residuals; then by `diagnose`
#
# Run it whole, or cell by cell. No files are needed; one figure is written, 04_residuals.png. The case is an easy one,
# chosen because a reader can see in it what is going on; how often the diagnosis is right is another question
# (docs/proof.md).

# %% [markdown]
# ## Eight recorded manoeuvres, and what a simulation says along them
#
# Something is missing in it; the key stays shut.

# %%
import matplotlib.pyplot as plt
import numpy as np

from structsel import Recording, compute_all
from structsel.diagnosis import diagnose
from structsel.proving.drawing import draw_case

SEED = 218
case = draw_case(SEED, effect="ground-effect", severity="easy")
aircraft, span = case.aircraft, case.aircraft.b
print(aircraft)
print(case.recordings[0])

# %% [markdown]
# ## Forces, not flight paths: coefficients of what was flown, less those the simulation gives for the same states

# %%
AXES = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
flown = {r.name: r for r in compute_all(case.recordings, aircraft)}
names = list(flown)
difference = {c: {n: flown[n][c] - case.simulated[n][c] for n in names} for c in AXES}


def rms(parts):
    """Root mean square over recordings, each about its own mean: instruments have constant biases."""
    return np.sqrt(np.mean(np.concatenate([(x - x.mean()) ** 2 for x in parts])))


print(f"{'':4}{'measured':>10}{'difference':>12}")
for c in AXES:
    print(f"{c:4}{rms([r[c] for r in flown.values()]):10.4f}{rms(difference[c].values()):12.4f}")

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
# CZ's difference from that of the first two seconds, averaged over half a second

# %%
width = round(0.5 / case.recordings[0].dt)
start = {n: x[flown[n].t < 2.0].mean() for n, x in difference["CZ"].items()}
smooth = {n: np.convolve(x - start[n], np.ones(width) / width, mode="same") for n, x in difference["CZ"].items()}
for n, x in smooth.items():
    t = flown[n].t[np.abs(x) > 4.0 * noise["CZ"]]
    lowest = flown[n]["h_agl"].min() / span
    print(
        f"{n}  lowest at {lowest:5.1f} spans; " + (f"off from {t[0]:.1f} to {t[-1]:.1f} s" if len(t) else "never off")
    )

# %% [markdown]
# ## Where?
#
# Against incidence, height and time: what spread is left about the means of two dozen bins?

# %%
e = np.concatenate(list(smooth.values()))
channels = {
    "alpha [deg]": np.degrees(np.concatenate([r["alpha"] for r in flown.values()])),
    "height / span": np.concatenate([r["h_agl"] for r in flown.values()]) / span,
    "time [s]": np.concatenate([r.t for r in flown.values()]),
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
# Something that acts near the ground only. Three accounts of it, fitted without one low pass: tuning of what the
# simulation has; a switch (flap or gear, forgotten); ground effect, which fades with height. That pass was looked at
# above, so it judges what is fitted, not whether low flight is where to look.

# %%
TUNED = ("alpha", "q_hat", "de")
low = [n for n in names if flown[n]["h_agl"].min() < span]
held_out = low[-1]


def columns(n, account, decay):
    """Columns that may explain the difference of one recording."""
    r, near = flown[n], np.exp(-decay * flown[n]["h_agl"] / span)
    lift = case.simulated[n]["CX"] * np.sin(r["alpha"]) - case.simulated[n]["CZ"] * np.cos(r["alpha"])
    made = [r[c] for c in TUNED]
    made += {"tuning": [], "switch": [1.0 * (r["h_agl"] < 0.5 * span)], "ground": [near * lift]}[account]
    return np.column_stack([x - x.mean() for x in made])  # constant biases differ in each recording


def fit(c, account, decay=1.0):
    """Parameters from all recordings but one, and the share of that one's difference they foretell."""
    used = [n for n in names if n != held_out]
    y = {n: difference[c][n] - difference[c][n].mean() for n in names}
    X = np.vstack([columns(n, account, decay) for n in used])
    theta = np.linalg.lstsq(X, np.concatenate([y[n] for n in used]), rcond=None)[0]
    within = np.mean((np.concatenate([y[n] for n in used]) - X @ theta) ** 2)
    ahead = y[held_out] - columns(held_out, account, decay) @ theta
    return theta, within, 1.0 - np.mean(ahead**2) / np.mean(y[held_out] ** 2)


decays = np.arange(1.0, 7.01, 0.25)
decay = decays[np.argmin([fit("CZ", "ground", d)[1] for d in decays])]
print(f"share of the difference in {held_out} foretold by the others; height fades with {decay:.2f} per span")
print(f"{'':4}{'tuning':>9}{'switch':>9}{'ground effect':>15}")
foretold = {c: {a: fit(c, a, decay)[2] for a in ("tuning", "switch", "ground")} for c in ("CZ", "Cm")}
for c, share in foretold.items():
    print(f"{c:4}{share['tuning']:9.2f}{share['switch']:9.2f}{share['ground']:15.2f}")
lift_gain, moment = -fit("CZ", "ground", decay)[0][-1], fit("Cm", "ground", decay)[0][-1]
print(f"at the ground: {lift_gain:.0%} more lift, and {moment:.3f} of the lift as pitching moment, nose down")

# %% [markdown]
# ## The same by the tool: every hypothesis it has, all responses at once, tolerances, each recording held out in turn

# %%
simulated = {n: Recording(n, channels["t"], {c: channels[c] for c in AXES}) for n, channels in case.simulated.items()}
found = diagnose(simulated, case.recordings, aircraft)
print(found)

# %% [markdown]
# ## And the key
#
# The tool tries a few rates of decay, and takes the gain at the likeliest. Its +- leaves that out.

# %%
truth = case.key.effects[0]
print(f"concealed: {truth.effect}, decay {truth.parameters['ground_rate']:.2f},", dict(truth.parameters))
gain = -truth.parameters["CZ:ground*CL"]
first = found.findings[0]
told = first.physics[0].parameters
print(f"{'':18}{'truth':>7}{'by hand':>9}{'diagnose':>10}")
print(f"{'lift gained':18}{gain:7.3f}{lift_gain:9.3f}{told['lift'].value:10.3f}")
print(f"{'decay per span':18}{truth.parameters['ground_rate']:7.2f}{decay:9.2f}{told['decay'].value:10.2f}")

assert times["CZ"] == max(times.values()), "the lift was to stand out"
assert left["height / span"] < 0.5 < left["alpha [deg]"], "height was to explain it, incidence not"
assert foretold["CZ"]["ground"] > max(0.9, foretold["CZ"]["tuning"] + 0.3, foretold["CZ"]["switch"])
assert (found.verdict, first.effect) == ("mismatch", truth.effect)
assert max(abs(lift_gain / gain - 1.0), abs(told["lift"].value / gain - 1.0)) < 0.2, "the gain of lift is off"
