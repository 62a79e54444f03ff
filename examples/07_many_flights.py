# %% [markdown]
# # A campaign in a folder: many manoeuvres as Parquet files, read once
#
# Run the complete file, or cell by cell. It writes about 11 MB of files into the current folder.

# %% [markdown]
# ## Forty manoeuvres, one Parquet file each

# %%
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import structsel as ss
from structsel.plotting import plot_inclusion, plot_intervals

folder = Path("07_campaign")
folder.mkdir(exist_ok=True)
made, aircraft, truth = ss.demo_flights(40, turbulence=0.4)
for recording in made:
    ss.write_recording(recording, folder / f"{recording.name}.parquet", overwrite=True)
size = sum(path.stat().st_size for path in folder.iterdir()) / 1e6
print(f"{len(made)} files, {size:.0f} MB, {sum(map(len, made))} samples of {len(made[0].names)} channels")


# %% [markdown]
# ## Timing
#
# A first call also compiles its loops, so it is made on a small problem.


# %%
def timed(what, work):
    start = time.perf_counter()
    done = work()
    print(f"{what:58}{time.perf_counter() - start:7.2f} s")
    return done


pool = ss.Candidates.polynomial(["alpha", "beta", "q_hat", "r_hat", "de"], degree=3)
responses = ["CZ", "Cm"]
small = ss.select(ss.compute_all(made[:2], aircraft), "Cm", pool, bootstrap=0)

# %% [markdown]
# ## Read the files, compute coefficients, select among all candidates for two responses
#
# The recordings are held in memory. The matrix of all candidates is not: it is computed in blocks, whose cross-products
# are summed.

# %%
read = timed("read the folder", lambda: ss.read_recordings(folder))
manoeuvres = timed("coefficients of every manoeuvre", lambda: ss.compute_all(read, aircraft))
chosen = timed(
    f"select among {len(pool)} candidates for {len(responses)} responses",
    lambda: ss.select(manoeuvres, responses, pool, F_in="auto", bootstrap=0),
)
chosen["Cm"]

# %% [markdown]
# ## Stability of the structure
#
# Sixty selections from resampled manoeuvres, and cross-validation over the manoeuvres, take little more time, because
# the cross-products of each manoeuvre are kept and add up.

# %%
resampled = timed("the same with 60 selections from resampled manoeuvres",
             lambda: ss.select(manoeuvres, responses, pool, F_in="auto", bootstrap=60))  # fmt: skip
kept = [str(term) for term in resampled["Cm"].terms]
print({term: round(resampled["Cm"].inclusion[term], 2) for term in kept})
print(f"held out, manoeuvre by manoeuvre: R2 {resampled['Cm'].held_out_r2:.4f}")

# %%
plot_inclusion(resampled["Cm"])
plot_intervals(resampled["Cm"])
plt.show()

# %% [markdown]
# ## Comparison with one least-squares problem over all samples

# %%
matrix = np.concatenate([np.column_stack([np.ones(len(r)), ss.Candidates.parse(kept).evaluate(r)]) for r in manoeuvres])
names = ["1", *map(str, ss.Candidates.parse(kept))]
direct = dict(zip(names, np.linalg.lstsq(matrix, np.concatenate([r["Cm"] for r in manoeuvres]), rcond=None)[0]))
model = ss.select(manoeuvres, "Cm", ss.Candidates.parse(kept), include=kept, noise="white", bootstrap=0).model["Cm"]
difference = max(abs(model[name] / direct[name] - 1.0) for name in names)
print(f"parameters differ from one large least-squares problem by {difference:.1e} at most")

assert difference < 1e-8, "sums over manoeuvres should give the same as all samples together"
assert set(truth["Cm"]) - {"1"} <= set(kept), "a true term was missed"
