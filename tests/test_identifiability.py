"""Terms the data cannot separate are reported, with the manoeuvre that would separate them."""

import numpy as np
import pytest

from structsel.candidates import Candidates, Term
from structsel.recording import Recording
from structsel.selection import select
from structsel.selection.data import summarise_recordings
from structsel.selection.diagnostics import EXCITATION, describe_channel, to_separate

from .flights import fly
from .pools import ar1

POOL = Candidates.parse(["alpha", "V_ratio*alpha", "de", "q_hat", "alpha^2"])
TRUTH = {"1": -0.3, "alpha": -4.0, "de": -0.6, "q_hat": -12.0}


def speed(spread, mean=1.0):
    return {"V_ratio": lambda c, rng: mean + spread * ar1(rng, c["alpha"].size, 0.99, np.sqrt(1 - 0.99**2))}


def pairs(selection):
    return [{str(a.kept), str(a.other)} for a in selection.aliases]


@pytest.mark.parametrize(("noise", "residual"), [("white", "white"), ("ar", "ar1_0.92")])
def test_alpha_and_alpha_times_speed_are_aliases_at_nearly_constant_speed(noise, residual):
    flights = fly(TRUTH, 0.02, residual, (2000, 2000), **speed(0.001))
    found = select(flights, "CZ", POOL, F_in="auto", noise=noise, bootstrap=0)
    (alias,) = [a for a in found.aliases if {str(a.kept), str(a.other)} == {"alpha", "V_ratio*alpha"}]
    # Of two terms the data cannot separate, the simpler is in the model.
    assert str(alias.kept) == "alpha"
    assert abs(alias.correlation) > 0.99
    assert alias.loss < 4.0
    mean, std = (f(np.concatenate([r["V_ratio"] for r in flights])) for f in (np.mean, np.std))
    assert f"they differ only by V_ratio = {mean:.4g} +- {std:.2g}, which hardly varies" in alias.to_separate
    assert alias.to_separate.endswith("fly the same inputs at other speeds")
    assert f"Aliased in these data: {alias}." in found.doubts
    assert {"kept": "alpha", "other": "V_ratio*alpha"}.items() <= found.to_dict()["aliases"][0].items()


@pytest.mark.parametrize("true", ["alpha", "V_ratio*alpha"])
def test_flying_at_other_speeds_as_advised_separates_them(true):
    truth = {**{k: v for k, v in TRUTH.items() if k != "alpha"}, true: -4.0}
    flights = fly(truth, 0.02, "ar1_0.92", (2000, 2000), **speed(0.001))
    faster = fly(truth, 0.02, "ar1_0.92", (2000, 2000), seed=7, **speed(0.001, mean=1.3))
    before = select(flights, "CZ", POOL, F_in="auto", bootstrap=0)
    after = select(flights + faster, "CZ", POOL, F_in="auto", bootstrap=0)
    assert {"alpha", "V_ratio*alpha"} in pairs(before)
    assert {"alpha", "V_ratio*alpha"} not in pairs(after)
    assert {str(t) for t in after.terms} == {true, "de", "q_hat"}


def test_pitch_rate_and_rate_of_angle_of_attack_that_move_together_are_aliases():
    # In level flight without plunging, angle of attack turns as fast as the nose does.
    near = {"alpha_dot_hat": lambda c, rng: c["q_hat"] * (1 + 1e-3 * rng.standard_normal(c["q_hat"].size))}
    pool = Candidates.polynomial(["alpha", "de", "q_hat", "alpha_dot_hat"], 1)
    found = select(fly(TRUTH, 0.02, lengths=(2000, 2000), **near), "CZ", pool, F_in="auto", bootstrap=0)
    assert pairs(found) == [{"q_hat", "alpha_dot_hat"}]
    (alias,) = found.aliases
    assert alias.to_separate.startswith("alpha_dot_hat and q_hat move together here: ")
    assert EXCITATION["q_hat"] in alias.to_separate
    assert EXCITATION["alpha_dot_hat"] in alias.to_separate
    assert len({"q_hat", "alpha_dot_hat"} & {str(t) for t in found.terms}) == 1


def test_at_exactly_constant_speed_the_copy_is_listed_as_dependent():
    found = select(fly(TRUTH, 0.02, lengths=(2000, 2000), **speed(0.0)), "CZ", POOL, F_in="auto", bootstrap=0)
    assert {str(t) for t in found.terms} == {"alpha", "de", "q_hat"}
    assert [str(t) for t in found.dependent] == ["V_ratio*alpha"]
    assert any("exactly dependent on the kept terms" in d for d in found.doubts)


@pytest.mark.parametrize("seed", range(5))
def test_with_good_excitation_there_is_no_alias(seed):
    rng = np.random.default_rng(seed)
    n = 2000
    channels = {c: 0.1 * ar1(rng, n, 0.9, 0.4) for c in ("alpha", "de", "q_hat", "alpha_dot_hat")}
    channels["V_ratio"] = 1.0 + 0.2 * ar1(rng, n, 0.95, 0.3)
    channels["CZ"] = -4 * channels["alpha"] - channels["de"] - 3 * channels["q_hat"] + 0.05 * ar1(rng, n, 0.9, 0.4)
    pool = POOL + Candidates.parse(["alpha_dot_hat", "de*V_ratio", "q_hat*V_ratio"])
    found = select(Recording("a", 0.02 * np.arange(n), channels), "CZ", pool, F_in="auto", bootstrap=0)
    assert found.aliases == ()
    assert found.dependent == ()
    assert not any("told apart" in d or "Collinear" in d for d in found.doubts)


# --- the advice ------------------------------------------------------------------------------------


def one(**channels):
    n = 200
    t = np.arange(n)
    held = {c: np.sin((k + 1) * t / 9) for k, c in enumerate(("alpha", "de", "q_hat", "mine"))}
    return Recording("a", 0.02 * t, held | {"CZ": np.cos(t / 7)} | channels)


def ranges_of(flight, *terms):
    """Channel ranges of the flight, as a selection among these terms records them."""
    return summarise_recordings([flight], Candidates(terms), ["CZ"])


def test_terms_that_differ_by_one_factor_are_reported_with_its_variation():
    flight = one(V_ratio=np.full(200, 1.5))
    pair = Term("alpha"), Term("V_ratio*alpha")
    assert to_separate(*pair, ranges_of(flight, *pair)) == (
        "they differ only by V_ratio = 1.5 +- 0, which hardly varies: fly the same inputs at other speeds"
    )
    assert describe_channel("V", ranges_of(one(V=np.linspace(50.0, 70.0, 200)), Term("V"))) == "V = 60 +- 5.8 m/s"


def test_terms_of_different_channels_are_reported_with_advice_to_move_each():
    pair = Term("alpha*de"), Term("alpha*mine")
    said = to_separate(*pair, ranges_of(one(), *pair))
    assert said == (
        "de and mine move together here: move the elevator independently of the motion (an unaugmented doublet or a "
        "multisine); vary mine independently"
    )


def test_powers_of_one_channel_are_reported_with_advice_to_widen_its_range():
    pair = Term("alpha"), Term("alpha^3")
    said = to_separate(*pair, ranges_of(one(), *pair))
    assert said.endswith("fly the same inputs about other trim angles of attack, or larger pitch inputs")
