"""Coefficients of a free simulation: identified from its own flights, whichever way its inputs act between samples."""

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

from structsel.aircraft import Aircraft
from structsel.comparison.preparing import prepare
from structsel.recording import Recording

AIRCRAFT = Aircraft(
    name="short period", mass=1000.0, S=15.0, b=10.0, cbar=1.5, inertia={"Ix": 1500.0, "Iy": 2000.0, "Iz": 3000.0}
)
V, RHO, DT, N = 60.0, 1.225, 0.04, 500
CZ_ALPHA, CZ_DE, CM_ALPHA, CM_Q, CM_DE = -5.0, -0.4, -0.8, -20.0, -1.2


def flown(k, held):
    """Linear short-period motion at constant speed; elevator steps held after the sample or before it."""
    rng = np.random.default_rng(k)
    de = 0.03 * np.repeat(rng.choice([-1.0, 0.0, 1.0], N // 10), 10)
    qS = 0.5 * RHO * V**2 * AIRCRAFT.S
    x = np.zeros((N, 2))
    lift = qS / (1000.0 * V) * np.array([CZ_ALPHA, 0.0, CZ_DE]) + [0.0, 1.0, 0.0]
    pitch = qS * AIRCRAFT.cbar / 2000.0 * np.array([CM_ALPHA, CM_Q * AIRCRAFT.cbar / (2.0 * V), CM_DE])
    step = scipy.linalg.expm(DT * np.vstack([lift, pitch, np.zeros(3)]))  # exact for an input that is held
    for i in range(N - 1):
        x[i + 1] = (step @ [*x[i], de[i + (held == "before")]])[:2]
    alpha, q = x.T
    az = qS * (CZ_ALPHA * alpha + CZ_DE * de) / 1000.0
    zero = np.zeros(N)
    level = dict.fromkeys(("beta", "p", "r", "phi", "psi", "ax", "ay", "da", "dr"), zero)
    theta = np.concatenate([[0.0], np.cumsum(0.5 * DT * (q[1:] + q[:-1]))])
    return Recording(
        f"m{k}", DT * np.arange(N),
        {"V": zero + V, "alpha": alpha, "q": q, "theta": theta, "az": az, "de": de, "rho": zero + RHO, **level},
    )  # fmt: skip


@pytest.mark.parametrize("held", ["after", "before"])
def test_derivatives_are_those_of_the_simulation_whichever_sample_it_holds(held):
    flights = [flown(k, held) for k in range(3)]
    prepared = prepare({f.name: f for f in flights}, flights, AIRCRAFT)
    assert prepared.simulation.form == "free"
    for f, own in zip(prepared.flights, flights):
        expected = CM_ALPHA * own["alpha"] + CM_Q * own["q"] * AIRCRAFT.cbar / (2.0 * V) + CM_DE * own["de"]
        quiet = np.abs(np.diff(own["de"], prepend=0.0)) == 0.0
        quiet[:5] = quiet[-5:] = False
        for k in range(1, 5):  # steps shine into their neighbours
            quiet[k:] &= np.diff(own["de"], prepend=0.0)[:-k] == 0.0
            quiet[:-k] &= np.diff(own["de"], prepend=0.0)[k:] == 0.0
        assert_allclose(f.simulated["Cm"][quiet], expected[quiet], atol=0.004 * np.ptp(expected))
        assert np.std(f.difference["Cm"]) < 0.04 * np.std(expected)


@pytest.mark.parametrize("channel", ["df", "speedbrake"])
def test_a_configuration_that_simulated_files_do_not_hold_is_that_of_the_recordings(channel):
    recorded, simulated = [], {}
    for k in range(3):
        made = flown(k, "after")
        out = np.clip(np.arange(N) - 250.0, 0.0, 25.0) / 25.0 * (k == 1)
        lift = 0.5 * RHO * V**2 * AIRCRAFT.S * 0.3 * out / AIRCRAFT.mass
        channels = {c: made[c] for c in made.names} | {"az": made["az"] + lift}
        simulated[made.name] = Recording(made.name, made.t, channels)
        recorded.append(Recording(made.name, made.t, channels | {channel: out}))
    for f in prepare(simulated, recorded, AIRCRAFT).flights:
        assert np.std(f.difference["CZ"]) < 0.05 * 0.3


def halves(recording, jump=0.0):
    """A recording in two parts, the second with another angle of attack."""
    parts = []
    for name, part in (("a", slice(0, N // 2)), ("b", slice(N // 2, N))):
        channels = {c: recording[c][part] for c in recording.names}
        moved = {"alpha": channels["alpha"] + jump * (name == "b")}
        parts.append(Recording(recording.name + name, recording.t[part], {**channels, **moved}))
    return parts


def test_recordings_and_a_free_simulation_are_joined_unless_it_began_anew():
    flights = [flown(k, "after") for k in range(3)]
    complete = prepare({f.name: f for f in flights}, flights, AIRCRAFT, aligned=True).flights
    recorded = [part for f in flights for part in halves(f)]
    prepared = prepare({p.name: p for p in recorded}, recorded, AIRCRAFT, aligned=True)
    joined = prepared.flights
    assert sum("were taken as one" in remark for remark in prepared.remarks) == 3
    assert [f.name for f in joined] == ["m0a to m0b", "m1a to m1b", "m2a to m2b"]
    for f, g in zip(complete, joined):
        assert_allclose(f.simulated["Cm"], g.simulated["Cm"], atol=1e-12)
    anew = [part for f in flights for part in halves(f, 0.02)]
    apart = prepare({p.name: p for p in anew}, recorded, AIRCRAFT, aligned=True).flights
    assert [f.name for f in apart] == [p.name for p in recorded]
