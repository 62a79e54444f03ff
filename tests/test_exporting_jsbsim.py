"""Exports to JSBSim: the same coefficients, simulated there and identified again; refusals of other models."""

import contextlib
import io
import os
import re
import shlex
from pathlib import Path

import numpy as np
import pint
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from structsel import (
    AeroModel,
    Aircraft,
    Candidates,
    Instruments,
    Recording,
    ResponseModel,
    compute_all,
    compute_coefficients,
    export_model,
    open_jsbsim,
    published_aircraft,
    read_recording,
    select,
    write_recording,
)
from structsel.cli import app, demo
from structsel.errors import AircraftError, ModelError
from structsel.exporting import TARGETS
from tests.commands import code_blocks
from tests.exported_models import KINDS, RANGES, model_of, random_states

jsbsim = pytest.importorskip("jsbsim", reason='JSBSim is not installed: pip install "structsel[jsbsim]"')

CITATION = published_aircraft("citation")
AXES = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
CLOCK = np.arange(0.0, 20.0, 0.02)
AIRCRAFT = Aircraft(
    name="odd",
    mass=1234.5,
    S=17.3,
    b=11.1,
    cbar=1.61,
    V0=55.0,
    inertia={"Ix": 2100.0, "Iy": 3300.0, "Iz": 4900.0, "Ixz": 210.0, "Ixy": 30.0, "Iyz": -20.0},
    thrust={"offset": (1.8, 0.1, -0.15), "inclination": 0.03},
)


# --- the round trip -------------------------------------------------------------------------------------


def moved(trim, seed):
    """Inputs in all three axes, sums of sines about a trim."""
    rng = np.random.default_rng(seed)

    def multisine(size, *hertz):
        waves = [np.sin(2.0 * np.pi * f * CLOCK + rng.uniform(0.0, 2.0 * np.pi)) for f in hertz]
        return size * np.sum(waves, axis=0) * np.minimum(CLOCK, 1.0) / np.sqrt(len(hertz))

    return trim.inputs(
        CLOCK,
        de=multisine(0.012, 0.1, 0.25, 0.45, 0.8, 1.3),
        da=multisine(0.02, 0.15, 0.3, 0.55, 0.9, 1.5),
        dr=multisine(0.03, 0.12, 0.35, 0.6, 1.0, 1.4),
    )


def identify(flights, aircraft, seed):
    """Model of six responses, from what accelerometers, linear and angular, read of flights."""
    noise = {"ax": 0.02, "ay": 0.02, "az": 0.05, "p_dot": 0.01, "q_dot": 0.01, "r_dot": 0.005}
    states = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "rho", "qbar", "thrust", "de", "da", "dr")
    seen = []
    for k, flight in enumerate(flights):
        true = {name: flight[name] for name in (*states, *noise)}
        read = Instruments(noise=noise, seed=seed + k).read(flight.t, true)
        seen.append(Recording(f"m{k}", flight.t, read))
    pool = Candidates.polynomial(["alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr"], 2)
    return select(compute_all(seen, aircraft), list(AXES), pool, F_in="auto", bootstrap=0).model


@pytest.fixture(scope="module")
def first():
    """Three flights of ours, the density they flew in, and the model identified from them."""
    steady = CITATION.trim()
    flights = [CITATION.simulate(moved(steady, k), start=steady) for k in range(3)]
    return flights, float(flights[0]["rho"][0]), identify(flights, CITATION.aircraft, 100)


@pytest.fixture(scope="module")
def theirs(first, tmp_path_factory):
    """The identified model as JSBSim's aircraft, and three flights of it."""
    path = export_model(first[2], tmp_path_factory.mktemp("jsbsim") / "citation.xml", aircraft=CITATION.aircraft)
    their_aircraft = open_jsbsim(path, rho=first[1])
    steady = their_aircraft.trim(120.0, 7500.0)
    return their_aircraft, [their_aircraft.fly(moved(steady, 10 + k), start=steady) for k in range(3)]


def departures(found, truth):
    """Departure of every value in its standard errors."""
    z = [
        (v - truth[r][t]) / e
        for r in AXES
        for t, v, e in zip(found[r].terms, found[r].values, found[r].standard_errors)
    ]
    return np.array(z)


def test_the_model_identified_flies_in_jsbsim_and_is_identified_again(first, theirs):
    _, _, model = first
    their_aircraft, flights = theirs
    again = identify(flights, their_aircraft.aircraft, 200)
    for name in AXES:
        assert set(again[name].terms) == set(model[name].terms) == set(CITATION.model[name].terms)
    # 31 values: under the stated errors one beyond 3.5 of them has odds of 1 in 70, an rms above 1.35 less.
    for z in (departures(model, CITATION.model), departures(again, model)):
        assert len(z) == 31
        assert np.abs(z).max() < 3.5
        assert 0.5 < np.sqrt(np.mean(z**2)) < 1.35


def test_coefficients_along_the_flight_are_the_model_s(first, theirs):
    their_aircraft, flights = theirs
    for flight in flights:
        expected = first[2].evaluate(compute_coefficients(flight, their_aircraft.aircraft), outside="ignore")
        assert np.ptp(flight["alpha"]) > 0.03
        for name in AXES:
            assert_allclose(flight[name], expected[name], atol=1e-9, rtol=0.0, err_msg=name)


def test_coefficients_at_the_states_of_our_own_flight_are_the_model_s(first, theirs):
    computed = compute_coefficients(first[0][0], CITATION.aircraft)
    expected = first[2].evaluate(computed, outside="ignore")
    forced = theirs[0].coefficients(computed)
    for name in AXES:
        assert_allclose(forced[name], expected[name], atol=1e-9, rtol=0.0, err_msg=name)


def test_the_commands_make_the_same_trip(first, tmp_path):
    _, rho, model = first
    model.to_json(tmp_path / "model.json")
    CITATION.aircraft.to_toml(tmp_path / "aircraft.toml")
    push = 0.02 * ((CLOCK > 1.0) & (CLOCK < 2.0)) - 0.02 * ((CLOCK >= 2.0) & (CLOCK < 3.0))
    write_recording(Recording("doublet", CLOCK[:200], {"de": push[:200]}), tmp_path / "doublet.csv")
    for command in (
        ["export", "model.json", "--to", "jsbsim", "--aircraft", "aircraft.toml", "--out", "aircraft.xml"],
        ["simulate", "jsbsim:{}/aircraft.xml", "--trim", "120,7500", "--rho", repr(rho), "--inputs", "doublet.csv",
         "--out", "simulated", "--no-plots"],
    ):  # fmt: skip
        words = [
            str(tmp_path / w) if (tmp_path / w).exists() or w in ("aircraft.xml", "simulated") else w for w in command
        ]
        done = CliRunner().invoke(app, [word.format(tmp_path) for word in words], env={"NO_COLOR": "1"})
        assert done.exit_code == 0, done.output
    flight = read_recording(tmp_path / "simulated" / "flights" / "doublet.csv")
    expected = model.evaluate(compute_coefficients(flight, CITATION.aircraft), outside="ignore")
    assert np.ptp(flight["q"]) > 0.02
    for name in AXES:
        assert_allclose(flight[name], expected[name], atol=1e-9, rtol=0.0, err_msg=name)


@pytest.fixture(scope="module")
def page():
    return (Path(__file__).parents[1] / "docs" / "exports.md").read_text()


def test_the_commands_of_the_page_run_and_do_what_it_says(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PWD", str(tmp_path))
    monkeypatch.setattr(demo, "DEGREE", 1)  # what is exported is not what is tested here
    lines = re.findall(r"^structsel .*[^\\\n]$", "".join(code_blocks(page, "sh")), re.MULTILINE)
    assert {target for line in lines for target in TARGETS if f"--to {target} " in line} == set(TARGETS)
    for line in lines:
        words = shlex.split(os.path.expandvars(line))[1:]
        words += ["--bootstrap", "0"] if words[0] == "demo" else []
        words += ["--no-plots"] if words[0] in ("demo", "inputs", "simulate") and "--out" in words else []
        done = CliRunner().invoke(app, words, env={"COLUMNS": "80", "NO_COLOR": "1"})
        assert done.exit_code == 0, done.output
        if words[0] == "validate":  # "R2 is 1 for all six coefficients"
            assert re.findall(r"^(C\w).* 401 +1\.0000", done.stdout, re.MULTILINE) == list(AXES)
    monkeypatch.syspath_prepend(tmp_path)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code_blocks(page, "python")[0], {})
    at = {name: np.array([0.1 * (name == "alpha") - 0.02 * (name == "de")]) for name in RANGES}
    expected = AeroModel.from_json("out/demo/model.json").evaluate(at, outside="ignore")["Cm"][0]
    assert float(printed.getvalue()) == pytest.approx(expected, rel=1e-12)


# --- every kind of term ---------------------------------------------------------------------------------

UNITS = pint.UnitRegistry()
# Channel: property of JSBSim and its unit, from JSBSim's own names for them.
HELD = {
    "V": ("velocities/vt-fps", "ft/s"), "alpha": ("aero/alpha-rad", "rad"), "beta": ("aero/beta-rad", "rad"),
    "qbar": ("aero/qbar-psf", "lbf/ft^2"), "mach": ("velocities/mach", ""), "phi": ("attitude/phi-rad", "rad"),
    "theta": ("attitude/theta-rad", "rad"), "psi": ("attitude/psi-rad", "rad"), "p": ("velocities/p-rad_sec", "rad/s"),
    "q": ("velocities/q-rad_sec", "rad/s"), "r": ("velocities/r-rad_sec", "rad/s"), "u": ("velocities/u-fps", "ft/s"),
    "v": ("velocities/v-fps", "ft/s"), "w": ("velocities/w-fps", "ft/s"), "vn": ("velocities/v-north-fps", "ft/s"),
    "ve": ("velocities/v-east-fps", "ft/s"), "vd": ("velocities/v-down-fps", "ft/s"),
    "gamma": ("flight-path/gamma-rad", "rad"), "de": ("fcs/elevator-pos-rad", "rad"),
    "dr": ("fcs/rudder-pos-rad", "rad"), "df": ("fcs/flap-pos-rad", "rad"), "gear": ("gear/gear-pos-norm", ""),
    "thrust": ("external_reactions/thrust/magnitude", "lbf"), "mass": ("inertia/mass-slugs", "slug"),
    "rho": ("atmosphere/rho-slugs_ft3", "slug/ft^3"), "pressure": ("atmosphere/P-psf", "lbf/ft^2"),
    "temperature": ("atmosphere/T-R", "degR"), "h": ("position/h-sl-ft", "ft"), "h_agl": ("position/h-agl-ft", "ft"),
    "alpha_dot": ("aero/alphadot-rad_sec", "rad/s"), "beta_dot": ("aero/betadot-rad_sec", "rad/s"),
    "t": ("simulation/sim-time-sec", "s"),
}  # fmt: skip


def load(path):
    fdm = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    fdm.set_debug_level(0)
    assert fdm.load_model_with_paths(path.stem, str(path.parent), "", "", False)
    return fdm


def converge(fdm, state, thrust=1500.0):
    """Put JSBSim into a state, without any of our own code, and read back what it holds there in our units."""
    for name, value in {
        "ic/vt-fps": state["V"] / 0.3048, "ic/alpha-rad": state["alpha"], "ic/beta-rad": state["beta"],
        "ic/h-sl-ft": 5000.0, "ic/phi-rad": 0.2, "ic/gamma-rad": 0.05,
        "ic/p-rad_sec": 0.1 + state["p_hat"], "ic/q-rad_sec": state["q_hat"],
        "ic/r-rad_sec": state["r_hat"], "ic/psi-true-rad": 0.4, "fcs/elevator-pos-rad": state["de"],
        "fcs/left-aileron-pos-rad": -state["da"], "fcs/right-aileron-pos-rad": state["da"],
        "fcs/rudder-pos-rad": state["dr"], "fcs/flap-pos-rad": 0.2, "gear/gear-pos-norm": 0.7,
        "external_reactions/thrust/magnitude": thrust,
    }.items():  # fmt: skip
        fdm[name] = value
    fdm.run_ic()
    channels = {c: UNITS.Quantity(fdm[name], unit).to_base_units().magnitude for c, (name, unit) in HELD.items()}
    channels["da"] = state["da"]
    b, cbar, V = AIRCRAFT.b, AIRCRAFT.cbar, channels["V"]
    channels |= {f"{c}_hat": channels[c] * (cbar if c in ("q", "alpha_dot") else b) / (2.0 * V)
                 for c in ("p", "q", "r", "alpha_dot", "beta_dot")}  # fmt: skip
    return channels | {"V_ratio": V / 55.0, "CT": channels["thrust"] / (channels["qbar"] * AIRCRAFT.S)}


def assert_agrees(fdm, model, states, **more):
    seen = []
    for i in range(len(states["V"])):
        channels = {**converge(fdm, {name: values[i] for name, values in states.items()}), **more}
        alone = {name: np.array([value]) for name, value in channels.items()}
        for name, expected in model.evaluate(alone).items():
            parts = [abs(v * t.evaluate(alone)[0]) for t, v in zip(model[name].terms, model[name].values)]
            assert fdm[f"aero/coefficient/{name}"] == pytest.approx(expected[0], abs=1e-9 * max(1.0, *parts)), name
            seen.append(expected[0])
        yield channels
    assert np.ptp(seen) > 0.0


def forces(fdm):
    """Forces [N] and moments [N m] of the aerodynamics, in body axes, over qbar S and the lengths."""
    qS = fdm["aero/qbar-psf"] * fdm["metrics/Sw-sqft"]
    b, cbar = fdm["metrics/bw-ft"], fdm["metrics/cbarw-ft"]
    made = {f"C{c.upper()}": fdm[f"forces/fb{c}-aero-lbs"] / qS for c in "xyz"}
    return made | {f"C{c}": fdm[f"moments/{c}-aero-lbsft"] / (qS * length) for c, length in zip("lmn", (b, cbar, b))}


def test_every_kind_of_term_is_jsbsim_s(tmp_path):
    model = model_of({name: KINDS[k::6] for k, name in enumerate(AXES)}, seed=4)
    fdm = load(export_model(model, tmp_path / "kinds.xml", aircraft=AIRCRAFT))
    for _ in assert_agrees(fdm, model, random_states(40, seed=2)):
        for name, value in forces(fdm).items():
            assert value == pytest.approx(fdm[f"aero/coefficient/{name}"], abs=1e-9 * max(1.0, abs(value)))


def test_every_channel_that_jsbsim_has_comes_in_si(tmp_path):
    reduced = ("p_hat", "q_hat", "r_hat", "alpha_dot_hat", "beta_dot_hat", "V_ratio", "CT", "da")
    model = AeroModel({"Cm": ResponseModel((*HELD, *reduced), 1.0 + np.arange(len(HELD) + len(reduced)) % 7)})
    fdm = load(export_model(model, tmp_path / "channels.xml", aircraft=AIRCRAFT))
    for channels in assert_agrees(fdm, model, random_states(3)):
        for name, value in channels.items():
            assert value != 0.0 or name == "t", name
            # Alone, since next to a pressure the others would not be seen.
            if fdm.get_property_manager().hasNode(f"aero/function/{name}"):
                assert fdm[f"aero/function/{name}"] == pytest.approx(value, rel=1e-9)


def test_the_section_alone_is_included_in_an_aircraft_of_its_own_sizes(tmp_path):
    model = model_of({"Cm": ("1", "alpha", "q_hat*de"), "CZ": ("alpha", "abs(beta)*V")})
    complete = export_model(model_of({"CX": ("1",)}), tmp_path / "complete.xml", aircraft=AIRCRAFT).read_text()
    export_model(model, tmp_path / "aero.xml")
    start, end = complete.index("<aerodynamics>"), complete.index("</aerodynamics>")
    (tmp_path / "own.xml").write_text(complete[:start] + '<aerodynamics file="aero.xml"/>' + complete[end + 15 :])
    fdm = load(tmp_path / "own.xml")
    for _ in assert_agrees(fdm, model, random_states(5)):
        assert forces(fdm)["CZ"] == pytest.approx(fdm["aero/coefficient/CZ"], rel=1e-12)


def test_the_aircraft_written_is_the_aircraft_given(tmp_path):
    loaded = open_jsbsim(export_model(model_of({"Cm": ("de",)}), tmp_path / "odd.xml", aircraft=AIRCRAFT)).aircraft
    for name in ("mass", "S", "b", "cbar"):
        assert_allclose(getattr(loaded, name), getattr(AIRCRAFT, name), rtol=1e-9)
    assert_allclose(loaded.inertia.tensor, AIRCRAFT.inertia.tensor, rtol=1e-9)
    assert_allclose(loaded.thrust.offset, AIRCRAFT.thrust.offset, rtol=1e-9)
    assert_allclose(loaded.thrust.inclination, AIRCRAFT.thrust.inclination, rtol=1e-9)


def test_wind_axes_are_turned_into_body_axes(tmp_path):
    model = model_of({"CL": ("1", "alpha", "q_ratio"), "CD": ("1", "alpha^2"), "CY": ("beta",)})
    fdm = load(export_model(model, tmp_path / "wind.xml", aircraft=AIRCRAFT, definitions={"q_ratio": "q*1.2/V"}))
    for i in range(10):
        state = {name: values[i] for name, values in random_states(10).items()}
        channels = converge(fdm, state)
        channels["q_ratio"] = channels["q"] * 1.2 / channels["V"]
        made = {n: v[0] for n, v in model.evaluate({c: np.array([x]) for c, x in channels.items()}).items()}
        body = forces(fdm)
        sa, ca, sb, cb = (f(channels[c]) for c in ("alpha", "beta") for f in (np.sin, np.cos))
        # Lift is across the flow in the plane of symmetry, drag along the flow: projections, not the export's inverse.
        assert body["CX"] * sa - body["CZ"] * ca == pytest.approx(made["CL"], abs=1e-9)
        assert -(body["CX"] * ca * cb + body["CY"] * sb + body["CZ"] * sa * cb) == pytest.approx(made["CD"], abs=1e-9)
        assert body["CY"] == pytest.approx(made["CY"], abs=1e-9)


def test_the_beaver_flies_with_its_slipstream_and_an_engine_s_readings_from_outside(tmp_path):
    published = published_aircraft("beaver")
    inputs = {"manifold_pressure": "aero/input/manifold_pressure", "rpm": "aero/input/rpm"}
    path = export_model(
        published.model,
        tmp_path / "beaver.xml",
        aircraft=published.aircraft,
        definitions=published.definitions,
        properties=inputs,
    )
    fdm = load(path)
    fdm["aero/input/manifold_pressure"], fdm["aero/input/rpm"] = 20.0, 1800.0
    converged = converge(fdm, {"V": 45.0, "alpha": 0.1, "beta": 0.02, "p_hat": 0.1, "q_hat": 0.05, "r_hat": -0.1,
                           "de": -0.05, "da": 0.02, "dr": 0.01})  # fmt: skip
    # Tjee and Mulder (1988) by hand, kW:
    # 0.7355 (-326.5 + 0.00412 (20 + 7.4) (1800 + 2010) + (408 - 0.0965 1800) (1 - rho/1.225)).
    power = 0.7355 * (-326.5 + 0.00412 * 27.4 * 3810.0 + (408.0 - 173.7) * (1.0 - converged["rho"] / 1.225))
    assert fdm["aero/function/power"] == pytest.approx(power, rel=1e-12)
    for name in ("p", "q", "r", "alpha_dot", "beta_dot"):
        length = 1.5875 if name in ("q", "alpha_dot") else 14.63
        converged[f"{name}_hat"] = converged[name] * length / (2.0 * converged["V"])
    converged["dpt"] = 0.08696 + 191.18 * power / (0.5 * converged["rho"] * converged["V"] ** 3)
    for name, expected in published.model.evaluate({c: np.array([x]) for c, x in converged.items()}).items():
        assert fdm[f"aero/coefficient/{name}"] == pytest.approx(expected[0], abs=1e-9)


def test_names_that_jsbsim_does_not_take_are_written_otherwise(tmp_path):
    defined = {"Δ": "2*alpha", "Ω": "3*beta"}
    model = model_of({"Cm": ("Δ", "Δ*Ω")})
    fdm = load(export_model(model, tmp_path / "greek.xml", aircraft=AIRCRAFT, definitions=defined))
    seen = converge(fdm, {name: values[0] for name, values in random_states(1).items()})
    expected = model.evaluate({"Δ": np.array([2.0 * seen["alpha"]]), "Ω": np.array([3.0 * seen["beta"]])})
    assert fdm["aero/coefficient/Cm"] == pytest.approx(expected["Cm"][0], abs=1e-12)


def test_at_rest_there_are_no_forces(tmp_path):
    fdm = load(export_model(model_of({"Cm": ("q_hat",), "CX": ("1", "1/V")}), tmp_path / "rest.xml", aircraft=AIRCRAFT))
    fdm["ic/vt-fps"] = 0.0
    fdm.run_ic()
    assert forces_are_zero(fdm)


def forces_are_zero(fdm):
    return all(fdm[n] == 0.0 for n in ("forces/fbx-aero-lbs", "moments/m-aero-lbsft"))


def test_the_stick_to_the_right_rolls_right(tmp_path):
    # Positive da rolls left: a negative Cl by da, and JSBSim's left aileron goes down to roll right.
    fdm = load(
        export_model(AeroModel({"Cl": ResponseModel(("da",), [-0.1])}), tmp_path / "roll.xml", aircraft=AIRCRAFT)
    )
    converge(fdm, {"V": 50.0, "alpha": 0.0, "beta": 0.0, "p_hat": 0.0, "q_hat": 0.0, "r_hat": 0.0, "de": 0.0,
                 "da": -0.1, "dr": 0.0})  # fmt: skip
    assert fdm["fcs/left-aileron-pos-rad"] > 0.0
    assert fdm["moments/l-aero-lbsft"] > 0.0


# --- refusals -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("terms", "more", "says"),
    [
        ({"Ch": ("alpha",)}, {}, r"JSBSim flies the coefficients CX, .*response 'Ch'"),
        ({"CL": ("alpha",), "CX": ("1",)}, {}, "mixes wind and body axes: CL, CX"),
        ({"Cm": ("alpha*rpm",)}, {}, r"Term '\(?alpha\*rpm\)?' needs channel 'rpm'.*\n.*rpm=aero/input/rpm"),
        ({"Cm": ("ax",)}, {}, "needs channel 'ax'"),
        ({"Cm": ("CL^2",), "CL": ("alpha",)}, {}, "needs channel 'CL'"),
        ({"Cm": ("CT",)}, {}, "Without an aircraft it is not known which property has the thrust"),
        ({"Cm": ("V_ratio",)}, {"aircraft": CITATION.aircraft}, "The aircraft says no V0"),
        ({"Cm": ("a",)}, {"definitions": {"a": "b*V", "b": "a/V"}}, "in a circle: a -> b -> a"),
        ({"Cm": ("p",)}, {"definitions": {"p": "p_hat*V"}}, "in a circle: p -> p_hat -> p"),
        ({"Cm": ("V",)}, {"aircraft": AIRCRAFT, "definitions": {"thrust": "9000*V"}}, "set from outside"),
    ],
)  # fmt: skip
def test_what_jsbsim_cannot_have_is_refused_in_words(terms, more, says, tmp_path):
    with pytest.raises(ModelError, match=says):
        export_model(model_of(terms), tmp_path / "m.xml", **more)
    assert not list(tmp_path.iterdir())


def test_an_aircraft_that_jsbsim_cannot_have_is_refused_in_words(tmp_path):
    held, model = AIRCRAFT.to_dict(), model_of({"Cm": ("alpha",)})
    for change, says in (
        ({"mass": None}, "needs its mass"),
        ({"inertia": None}, "needs the moments of inertia"),
        ({"engine": {"angular_momentum": 40.0}}, "rotating parts"),
    ):
        content = {key: value for key, value in {**held, **change}.items() if value is not None}
        with pytest.raises(AircraftError, match=says):
            export_model(model, tmp_path / "m.xml", aircraft=Aircraft.from_dict(content))
    with pytest.raises(ModelError, match=r"end in \.xml.*Name it m\.xml"):
        export_model(model, tmp_path / "m.aero")
