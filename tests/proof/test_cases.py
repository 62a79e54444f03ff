"""Generated cases: each effect can be drawn, the key agrees with the data, and a seed determines the case."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from proof import EffectKey, Key, write_case
from proof.detectability import log_evidence_of
from proof.generate import draw_case, drawable
from proof.keys import DECIDABLE
from proof.polynomial.aircraft import AIRCRAFT_NAMES, truth_aircraft
from proof.polynomial.cases import NAMES, SINGLES
from proof.polynomial.effects import EffectContext, Injection
from proof.polynomial.flight import STATES, InjectedPhysics, settings_of, simulate_truth
from proof.polynomial.manoeuvres import make_manoeuvre
from proof.polynomial.scenario import draw_scenario
from proof.polynomial.simulate import simulate_scenario
from proof.polynomial.single_channel import SINGLE_CHANNEL
from proof.polynomial.terms import AXES, compile_terms, evaluate
from proof.polynomial.unmodelled import EFFECTS as OUTSIDE
from proof.scenario.errors import NOISE
from structsel import compute_coefficients
from structsel.aircraft import Aircraft
from structsel.effects import EFFECTS
from structsel.errors import DataError
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import body_to_earth

EXAMPLES = Path(__file__).parents[3] / "shared" / "data" / "diagnose-examples"


@pytest.mark.parametrize("name", AIRCRAFT_NAMES)
def test_a_truth_flight_obeys_the_rigid_body_equations_of_the_package(name):
    made = truth_aircraft(name)
    manoeuvre = make_manoeuvre(
        "multisine", made, float(np.mean(made.speeds)), float(np.mean(made.heights)), 4.0, np.random.default_rng(1)
    )
    flight = simulate_truth(made, [manoeuvre], InjectedPhysics(), settings_of(made, [manoeuvre], 0.0), 50.0)[0]
    air, r = made.aircraft, flight.reads
    airframe = rb.Airframe(
        air.mass, air.inertia.tensor, air.S, air.b, air.cbar, air.thrust.offset, air.thrust.inclination
    )
    slope = rb.state_derivative(flight.states[:, :12].T, flight.coefs.T, r["rho"], airframe, r["thrust"])
    for row, channel in ((3, "p_dot"), (4, "q_dot"), (5, "r_dot")):
        assert_allclose(r[channel], slope[row], atol=1e-9)
    # And the states move as their derivatives say.
    u = flight.state("u")
    assert_allclose(np.gradient(u, flight.t)[5:-5], slope[STATES.index("u")][5:-5], atol=0.03)


def test_in_sheared_air_the_motion_over_the_ground_is_that_of_all_forces():
    made = truth_aircraft("citation")
    manoeuvre = make_manoeuvre("pull-up", made, 120.0, 5000.0, 20.0, np.random.default_rng(3))
    air = InjectedPhysics(settings={"shear_n": 0.05, "shear_e": -0.02, "shear_h": 5000.0})
    flight = simulate_truth(made, [manoeuvre], air, settings_of(made, [manoeuvre], 0.0), 50.0)[0]
    over_ground = np.column_stack(
        [np.gradient(flight.state(c), flight.t) * s for c, s in (("x", 1), ("y", 1), ("h", -1))]
    )
    force = np.column_stack([flight.reads[c] for c in ("ax", "ay", "az")])
    frame = body_to_earth(*(flight.state(c) for c in ("phi", "theta", "psi")))
    expected = np.einsum("nij,nj->ni", frame, force) + np.array([0.0, 0.0, 9.80665])
    found = np.gradient(over_ground, flight.t, axis=0)
    assert np.ptp(flight.state("h")) > 10.0
    assert_allclose(found[5:-5, :2], expected[5:-5, :2], atol=0.05)  # a step of a control moves the third by more


def test_a_trimmed_aircraft_that_nobody_disturbs_flies_on_level():
    made = truth_aircraft("citation")
    manoeuvre = make_manoeuvre("flap", made, 120.0, 5000.0, 4.0, np.random.default_rng(0))
    for name in ("de", "phi"):
        manoeuvre.column(name)[:] = 0.0
    manoeuvre.column("da")[:] = manoeuvre.trim["da"]
    flight = simulate_truth(made, [manoeuvre], InjectedPhysics(), settings_of(made, [manoeuvre], 0.0), 25.0)[0]
    assert abs(flight.state("h") - 5000.0).max() < 1.0
    assert abs(flight.reads["V"] - 120.0).max() < 0.2


@pytest.mark.default_cases(
    "wrong-derivative",
    "static-stall",
    "ground-effect",
    "downwash-lag",
    "slipstream",
    "mass-error",
    "actuator-lag",
    "turbulence",
    "sensor-delay",
    "structural-mode",
    "chaotic forcing",
)
@pytest.mark.parametrize("effect", [*SINGLES, *OUTSIDE], ids=lambda e: e.label or e.name)
def test_each_effect_can_be_simulated_and_shows_in_its_own_axes(effect):
    base = (effect.aircraft or AIRCRAFT_NAMES)[0]
    scenario = draw_scenario([effect], truth_aircraft(base), 4, "reconstructed")
    flights = simulate_truth(
        scenario.truth, scenario.manoeuvres, scenario.background.physics, scenario.settings, scenario.rate
    )
    rng = np.random.default_rng(4)
    design = effect.make(
        EffectContext(
            scenario.truth, scenario.manoeuvres, flights, scenario.settings, scenario.aircraft.tolerances, rng
        )
    )
    result = simulate_scenario(scenario, design.at(float(np.clip(0.5, design.low, design.high))))
    if effect.channels == ("vn",):
        # A wind changes only the velocity over the ground.
        assert max(np.abs(d).max() for d in result.delta) < 1e-9
        return
    moved = np.sqrt(np.mean(np.concatenate(result.delta) ** 2, axis=0))
    there = np.sqrt(np.mean(np.concatenate(result.after) ** 2, axis=0))
    assert max(moved[AXES.index(a)] / there[AXES.index(a)] for a in design.axes) > 0.1
    assert all(np.isfinite(d).all() for d in result.before)


def test_the_same_seed_gives_the_same_files_and_another_seed_others(tmp_path):
    for place, seed in (("one", 12), ("two", 12), ("three", 13)):
        write_case(draw_case(seed, effect="downwash-lag"), tmp_path / place, tmp_path / f"{place}-keys")
    files = {p: sorted(f for f in (tmp_path / p).rglob("*") if f.is_file()) for p in ("one", "two", "three")}
    assert len(files["one"]) == 17
    assert [f.read_bytes() for f in files["one"]] == [f.read_bytes() for f in files["two"]]
    assert files["one"][3].read_bytes() != files["three"][3].read_bytes()


def test_no_file_of_the_case_reveals_what_is_concealed(tmp_path):
    folder = write_case(draw_case(21, effect="sensor-scale"), tmp_path / "cases", tmp_path / "keys")
    text = (folder / "aircraft.toml").read_text() + "".join(str(p) for p in folder.rglob("*"))
    assert "sensor-scale" not in text
    assert not list(folder.rglob("*.json"))
    assert Key.read(tmp_path / "keys" / f"{folder.name}.json").effects[0].effect == "sensor-scale"
    # What is written is what a user would read.
    assert Aircraft.from_toml(folder / "aircraft.toml").tolerances.main in (0.01, 0.02, 0.05)


def test_the_attainable_fraction_of_a_mass_error_is_what_the_true_mass_brings(tmp_path):
    case = draw_case(3, effect="mass-error", severity="easy")
    while "factor" not in case.key.effects[0].parameters or case.key.form != "forced":
        case = draw_case(case.key.seed + 1, effect="mass-error", severity="easy")
    factor = case.key.effects[0].parameters["factor"]
    before, after = [], []
    for recording in case.recordings:
        CZ, simulated = compute_coefficients(recording, case.aircraft)["CZ"], case.simulated[recording.name]["CZ"]
        before.append(CZ - simulated)
        after.append(factor * CZ - simulated)
    before, after = (np.sqrt(np.mean(np.concatenate(x) ** 2)) for x in (before, after))
    # The key's rates are smoothed before they are differentiated, these are not: a small part of CZ at the seat.
    assert_allclose(1.0 - after / before, case.key.attainable["CZ"], atol=0.06)


@pytest.mark.default_cases("ground-effect-5")
@pytest.mark.parametrize(("effect", "seed"), [("ground-effect", 5), ("thrust-line", 6), ("friction", 7)])
def test_the_severity_follows_from_what_is_attainable(effect, seed):
    key = draw_case(seed, effect=effect, severity="medium").key
    largest = max(key.attainable[a] for a in key.effects[0].axes)
    assert largest >= {"easy": 0.30, "medium": 0.15, "hard": 0.05}[key.severity]
    assert set(key.attainable) == (set(AXES) if effect != "friction" else set(key.effects[0].axes))


def test_ground_effect_acts_near_the_ground_only():
    case = draw_case(5, effect="ground-effect", severity="easy")
    key, span = case.key.effects[0], case.aircraft.b
    assert key.region["h_agl"][1] < 1.2 * span
    found = [(r, a, b) for r in case.recordings for a, b in key.intervals[r.name]]
    assert found
    for recording, a, b in found:
        inside = (recording.t >= a) & (recording.t <= b)
        assert recording["h_agl"][inside].max() < 1.3 * span


@pytest.mark.parametrize("seed", [31, 32, 33])
def test_a_null_differs_by_no_more_than_noise_biases_and_tolerances(seed):
    scenario = draw_scenario([], truth_aircraft(AIRCRAFT_NAMES[seed % len(AIRCRAFT_NAMES)]), seed, "reconstructed")
    result = simulate_scenario(scenario, Injection())
    assert max(np.abs(d).max() for d in result.delta) < 1e-12
    air, allowed = scenario.aircraft, scenario.aircraft.tolerances
    table = np.concatenate([f.table for f in result.flights])
    variance = 0.0
    for axis, text, value in scenario.truth.terms:
        if axis == "CZ":
            part = evaluate(*compile_terms([(axis, text, value)]), table)[:, AXES.index("CZ")]
            variance += (allowed.secondary if text not in ("1", "alpha", "de", "df") else allowed.main) ** 2 * np.mean(
                part**2
            )
    qbar = np.concatenate([m.readings["qbar"] for m in result.manoeuvres])
    read = ((scenario.noise["az"] + 0.06) * air.mass / (qbar.mean() * air.S)) ** 2
    scale = (allowed.mass + 2 * 0.4 / scenario.manoeuvres[0].V) * np.abs(
        np.concatenate([f.coefs[:, 2] for f in result.flights])
    ).mean()
    slope = (allowed.vane_scale * 0.1 * scenario.truth.value("CZ", "alpha")) ** 2
    rms = np.sqrt(np.mean(np.concatenate(result.before)[:, AXES.index("CZ")] ** 2))
    assert rms < 3.0 * np.sqrt(variance + read + scale**2 + slope)


def test_nulls_say_consistent_and_pairs_hold_two_effects():
    null, pair = draw_case(41, family="null").key, draw_case(43, family="pair").key
    assert null.verdicts == ("consistent",)
    assert all(e.effect == "turbulence" for e in null.effects)
    assert len({e.effect for e in pair.effects}) == 2


def test_more_than_forty_names_can_be_drawn_and_all_of_them_are_names_of_the_library():
    assert len(NAMES) >= 48
    known = {effect.name for effect in EFFECTS} | {"turbulence"}
    assert set(NAMES) <= known
    assert all(set(e.tie) <= known for e in SINGLE_CHANNEL.values())


def test_every_listed_effect_can_be_named_and_drawn():
    # The library may have more effects than the list.
    path = Path(__file__).parents[3] / "shared" / "EFFECTS.md"
    if not path.exists():
        pytest.skip("the list of effects is not here")
    listed = {line.split("`")[1] for line in path.read_text().splitlines() if line.startswith("| `")}
    assert listed - {"unknown", "turbulence"} <= {effect.name for effect in EFFECTS}
    assert listed - {"unknown"} <= drawable("polynomial")


def test_a_key_is_read_back_as_it_was_written(tmp_path):
    effect = EffectKey(
        effect="icing", accept=("icing",), kinds=("static",), axes=("CX",), intervals={"m01": [(1.0, 2.0)]}
    )
    key = Key(verdicts=("mismatch",), form="forced", severity="hard", attainable={"CX": 0.1}, effects=(effect,), seed=3)
    assert Key.read(key.write(tmp_path / "keys" / "a.json")) == key
    (tmp_path / "b.json").write_text(json.dumps({"verdicts": ["wrong"]}))
    with pytest.raises(DataError, match=r"b\.json"):
        Key.read(tmp_path / "b.json")


def test_a_key_of_the_published_examples_can_be_read():
    answers = sorted(EXAMPLES.glob("*/answer.json"))
    if not answers:
        pytest.skip("the example cases are not here")
    assert {Key.read(path).severity for path in answers} == {"easy", "medium", "none"}


def test_noise_is_of_the_size_that_the_published_examples_have():
    path = EXAMPLES / "nothing-wrong" / "recordings" / "m01.csv"
    if not path.exists():
        pytest.skip("the example cases are not here")
    frame = pd.read_csv(path)
    for channel in ("V", "alpha", "phi", "h", "ax"):
        # Fourth differences of white noise have 70 times its variance.
        std = np.diff(frame[channel], 4).std() / np.sqrt(70.0)
        assert 0.8 < std / NOISE[channel] < 1.7


def test_the_aircraft_of_a_case_is_written_with_six_digits(tmp_path):
    case = draw_case(51, effect="asymmetry")
    read = Aircraft.from_toml(write_case(case, tmp_path, tmp_path / "keys") / "aircraft.toml")
    assert read.tolerances == case.aircraft.tolerances
    assert_allclose(read.position("vane"), case.aircraft.position("vane"), rtol=1e-5)
    assert float(f"{case.aircraft.S:.6g}") == read.S


@pytest.mark.slow
def test_a_case_is_decided_by_the_effect_relative_to_the_tolerances(tmp_path):
    case = draw_case(5, effect="ground-effect", severity="easy")
    folder = write_case(case, tmp_path / "cases", tmp_path / "keys")
    value = log_evidence_of(case, folder)[0]
    assert value > DECIDABLE
    nothing = replace(case, contribution=[np.zeros_like(x) for x in case.contribution])
    assert_allclose(log_evidence_of(nothing, folder)[0], 0.0, atol=1e-6)
    half = replace(case, contribution=[0.5 * x for x in case.contribution])
    assert 0.0 < log_evidence_of(half, folder)[0] < value
    assert log_evidence_of(replace(case, contribution=()), folder) == (None, [])


@pytest.mark.slow
@pytest.mark.parametrize("source", ["polynomial", "jsbsim"])
def test_what_the_effects_of_a_pair_add_is_about_their_sum_and_each_has_its_own_evidence(tmp_path, source):
    case = draw_case(61300, family="pair", source=source)
    first, second = (np.concatenate(added) for added in case.of_each)
    both = np.concatenate(case.contribution)
    assert np.sqrt(np.mean((first + second - both) ** 2)) < 0.1 * np.sqrt(np.mean(both**2))
    folder = write_case(case, tmp_path / "cases", tmp_path / "keys")
    value, of_each = log_evidence_of(case, folder)
    assert max(of_each) < value  # the other effect explains a part
    nothing = replace(case, of_each=[case.contribution, [np.zeros_like(x) for x in case.contribution]])
    assert_allclose(log_evidence_of(nothing, folder)[1], (value, 0.0), atol=1e-6)
    assert log_evidence_of(replace(case, of_each=()), folder) == (value, [])


def test_a_pair_is_decided_where_the_data_show_each_effect_beside_the_other():
    effects = tuple(EffectKey(effect=e, accept=(e,), kinds=("inertial",), axes=("CZ",)) for e in ("slosh", "cg-shift"))
    key = Key(verdicts=("mismatch",), form="forced", severity="easy", attainable={"CZ": 0.4}, effects=effects)
    assert not key.each_decided  # not known
    for of_each, decided in (((50.0, DECIDABLE + 1.0), True), ((50.0, DECIDABLE - 1.0), False)):
        found = key.with_log_evidence(80.0, of_each)
        assert [e.log_evidence for e in found.effects] == list(of_each)
        assert found.each_decided is decided


def test_where_the_truth_brings_too_little_consistent_is_right_as_well():
    effect = EffectKey(effect="mass-error", accept=("mass-error",), kinds=("inertial",), axes=("CZ",))
    key = Key(verdicts=("mismatch",), form="forced", severity="easy", attainable={"CZ": 0.4}, effects=(effect,))
    assert key.decided  # not known: by its severity
    assert key.with_log_evidence(None) == key
    little, much = key.with_log_evidence(DECIDABLE - 1.0), key.with_log_evidence(DECIDABLE + 1.0)
    assert (little.decided, much.decided) == (False, True)
    assert (little.verdicts, much.verdicts) == (("mismatch", "consistent"), ("mismatch",))
