# %% [markdown]
# # A campaign in a folder: many manoeuvres as Parquet files, read once, and all that is asked of them is algebra
#
# Run it whole, or cell by cell. It writes its files, some 11 MB, where it is run.

# %% [markdown]
# ## Forty manoeuvres as a campaign would leave them, one Parquet file each

# %%
import time
from pathlib import Path

import numpy as np

import structsel as ss

folder = Path("07_campaign")
folder.mkdir(exist_ok=True)
made, aircraft, truth = ss.demo_flights(40, turbulence=0.4)
for recording in made:
    ss.write_recording(recording, folder / f"{recording.name}.parquet", overwrite=True)
size = sum(path.stat().st_size for path in folder.iterdir()) / 1e6
print(f"{len(made)} files, {size:.0f} MB, {sum(map(len, made))} samples of {len(made[0].names)} channels")


# %% [markdown]
# ## Time what follows
#
# The first call of anything also compiles its loops, so it is a small one.


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
# ## Read, make coefficients, choose among all candidates for two responses
#
# The recordings are held in memory. The matrix of all candidates never is: it is made in pieces, each
# summed and forgotten.

# %%
read = timed("read the folder", lambda: ss.read_recordings(folder))
flown = timed("coefficients of every manoeuvre", lambda: ss.compute_all(read, aircraft))
chosen = timed(
    f"choose among {len(pool)} candidates for {len(responses)} responses",
    lambda: ss.select(flown, responses, pool, F_in="auto", bootstrap=0),
)
chosen["Cm"]

# %% [markdown]
# ## How sure is the structure?
#
# Sixty selections from resampled manoeuvres, and each manoeuvre held out, cost little more: each manoeuvre's sums are
# there, and they add.

# %%
sure = timed("the same with 60 selections from resampled manoeuvres",
             lambda: ss.select(flown, responses, pool, F_in="auto", bootstrap=60))  # fmt: skip
kept = [str(term) for term in sure["Cm"].terms]
print({term: round(sure["Cm"].inclusion[term], 2) for term in kept})
print(f"held out, manoeuvre by manoeuvre: R2 {sure['Cm'].held_out_r2:.4f}")

# %% [markdown]
# ## Against the whole matrix at once, as one would do without: the same values

# %%
matrix = np.concatenate([np.column_stack([np.ones(len(r)), ss.Candidates.parse(kept).evaluate(r)]) for r in flown])
names = ["1", *map(str, ss.Candidates.parse(kept))]
whole = dict(zip(names, np.linalg.lstsq(matrix, np.concatenate([r["Cm"] for r in flown]), rcond=None)[0]))
model = ss.select(flown, "Cm", ss.Candidates.parse(kept), include=kept, noise="white", bootstrap=0).model["Cm"]
apart = max(abs(model[name] / whole[name] - 1.0) for name in names)
print(f"parameters differ from one large least-squares problem by {apart:.1e} at most")

assert apart < 1e-8, "sums over manoeuvres were to say the same as all samples together"
assert set(truth["Cm"]) - {"1"} <= set(kept), "a true term was missed"
