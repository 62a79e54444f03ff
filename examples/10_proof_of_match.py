# %% [markdown]
# # Proof of match: a simulation within the tolerances for flight simulators, before and after a correction
#
# Run the complete file, or cell by cell: figures and tables then appear below the cells. No files are needed, and none
# are written.

# %% [markdown]
# ## Three recordings of an aircraft, and a simulation in which the elevator is half again too effective

# %%
import matplotlib.pyplot as plt

import structsel as ss
from structsel.demo import demo_aircraft
from structsel.demo.aircraft import TRUTH
from structsel.inputs import doublet
from structsel.plotting import plot_match

aircraft = demo_aircraft()
terms = {response: dict(values) for response, values in TRUTH.items()}
right = ss.AeroModel.from_terms(terms, "corrected simulation")
terms["Cm"]["de"] *= 1.5
wrong = ss.AeroModel.from_terms(terms, "simulation")

start = ss.trim(right, aircraft, 45.0, 1000.0)
reading = ss.Instruments(noise={"V": 0.05, "q": 3e-4, "r": 3e-4, "theta": 3e-4, "az": 0.01}, seed=1)
recordings = []
for control, size, duration in (("de", -0.04, 12.0), ("da", 0.08, 6.0), ("dr", 0.08, 20.0)):
    pulse = doublet(control, size, 0.8, start=1.5, duration=duration, dt=0.04)
    inputs = start.inputs(pulse.t, **{control: pulse[control]})
    motion = ss.simulate(right, aircraft, inputs, start=start, instruments=reading)
    recordings.append(ss.Recording(control, motion.t, {name: motion[name] for name in motion.names}))

# %% [markdown]
# ## Each manoeuvre is taken for a test of 14 CFR part 60, table A2A, and compared with its tolerances

# %%
result = ss.qualify(wrong, aircraft, recordings, corrected=right)
print(result)

# %% [markdown]
# ## Pitch angle in the short-period test

# %%
plot_match(result.tests[0], "theta")
plt.legend()
plt.show()

# %% [markdown]
# ## The correction passes; `structsel.report.write_qualification(result, folder)` writes HTML and PDF

# %%
print([(test.title, test.passed("before"), test.passed("after")) for test in result.tests])
assert result.count("after", True) == len(recordings) > result.count("before", True)
