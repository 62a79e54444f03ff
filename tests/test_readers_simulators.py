"""What JSBSim and X-Plane write, and headers that carry their unit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.readers.table import split_header
from structsel.recording import read_recording

G = 9.80665
FOOT, SLUG, LBF, KNOT = 0.3048, 14.593902937, 4.4482216152605, 1852.0 / 3600.0

# --- JSBSim --------------------------------------------------------------------------------------

PROPERTIES = (
    "velocities/vt-fps", "aero/alpha-rad", "aero/beta-deg", "attitude/phi-rad", "attitude/theta-rad",
    "velocities/p-rad_sec", "velocities/q-rad_sec", "velocities/r-rad_sec", "accelerations/Nz", "forces/fbx-total-lbs",
    "forces/fbz-total-lbs", "inertia/mass-slugs", "atmosphere/rho-slugs_ft3", "atmosphere/T-R", "position/h-sl-ft",
    "velocities/v-down-fps", "aero/qbar-psf", "fcs/elevator-pos-rad", "fcs/left-aileron-pos-rad",
    "fcs/right-aileron-pos-rad", "fcs/rudder-pos-rad", "fcs/throttle-pos-norm", "forces/fbx-prop-lbs",
    "fcs/flap-pos-deg", "gear/gear-pos-norm", "moments/l-total-lbsft", "moments/m-total-lbsft", "moments/n-total-lbsft",
)  # fmt: skip


@pytest.fixture(scope="module")
def jsbsim_output(tmp_path_factory):
    """CSV that JSBSim wrote of a flight, and what its properties were at the same times."""
    jsbsim = pytest.importorskip("jsbsim")
    folder = tmp_path_factory.mktemp("jsbsim")
    listed = "".join(f"<property>{name}</property>" for name in PROPERTIES)
    (folder / "output.xml").write_text(
        f'<?xml version="1.0"?><output name="flight.csv" type="CSV" rate="100">{listed}'
        "<velocities>ON</velocities><rates>ON</rates></output>"
    )
    flight = jsbsim.FGFDMExec(None)
    flight.set_debug_level(0)
    flight.set_output_path(str(folder))  # the model's own output goes there too
    flight.load_model("c172x")
    flight.set_dt(0.01)
    flight.set_output_directive(str(folder / "output.xml"))
    for name, value in {"ic/h-sl-ft": 3000.0, "ic/vc-kts": 90.0, "ic/phi-deg": 5.0}.items():
        flight[name] = value
    flight.run_ic()
    flight["propulsion/set-running"] = -1
    flight["fcs/throttle-cmd-norm"], flight["fcs/mixture-cmd-norm"] = 0.7, 0.9
    for i in range(300):
        for name, start in (("elevator", 50), ("aileron", 120), ("rudder", 190)):
            flight[f"fcs/{name}-cmd-norm"] = 0.1 if start <= i < start + 50 else 0.0
        flight.run()
    truth = {name: flight[name] for name in PROPERTIES}
    del flight  # closes the file
    return folder / "flight.csv", truth


def test_jsbsim_output_needs_no_map(jsbsim_output):
    path, truth = jsbsim_output
    recording = read_recording(path)
    last = {name: recording[name][-1] for name in recording.names}
    for channel, name, factor in (
        ("V", "velocities/vt-fps", FOOT), ("alpha", "aero/alpha-rad", 1.0), ("beta", "aero/beta-deg", np.pi / 180.0),
        ("phi", "attitude/phi-rad", 1.0), ("theta", "attitude/theta-rad", 1.0), ("p", "velocities/p-rad_sec", 1.0),
        ("q", "velocities/q-rad_sec", 1.0), ("r", "velocities/r-rad_sec", 1.0), ("mass", "inertia/mass-slugs", SLUG),
        ("rho", "atmosphere/rho-slugs_ft3", SLUG / FOOT**3), ("temperature", "atmosphere/T-R", 5.0 / 9.0),
        ("h", "position/h-sl-ft", FOOT), ("vd", "velocities/v-down-fps", FOOT),
        ("qbar", "aero/qbar-psf", LBF / FOOT**2),
        ("de", "fcs/elevator-pos-rad", 1.0), ("dr", "fcs/rudder-pos-rad", 1.0), ("thrust", "forces/fbx-prop-lbs", LBF),
        ("throttle", "fcs/throttle-pos-norm", 1.0), ("df", "fcs/flap-pos-deg", np.pi / 180.0),
        ("gear", "gear/gear-pos-norm", 1.0),
    ):  # fmt: skip
        assert_allclose(last[channel], truth[name] * factor, rtol=1e-8, atol=1e-9, err_msg=channel)
    assert recording.dt == pytest.approx(0.01)


def test_specific_force_is_every_force_but_gravity_over_mass(jsbsim_output):
    recording = read_recording(jsbsim_output[0])
    for axis in ("x", "z"):
        force = recording[f"/fdm/jsbsim/forces/fb{axis}-total-lbs"]  # kept by its own name, in newtons
        assert recording.unit(f"/fdm/jsbsim/forces/fb{axis}-total-lbs") == "N"
        assert_allclose(recording[f"a{axis}"], force / recording["mass"], rtol=1e-7, atol=1e-9)


def test_a_positive_control_makes_a_negative_moment(jsbsim_output):
    recording = read_recording(jsbsim_output[0])
    t = recording.t
    for control, axis, start in (("de", "m", 0.5), ("da", "l", 1.2), ("dr", "n", 1.9)):
        moment = recording[f"/fdm/jsbsim/moments/{axis}-total-lbsft"]
        before, after = np.searchsorted(t, [start - 0.02, start + 0.06])
        step = recording[control][after] - recording[control][before]
        assert abs(step) > 0.01
        assert (moment[after] - moment[before]) * step < 0.0, control
    (stated,) = [f for f in recording.findings if f.kind == "assumed"]
    assert "most make a positive deflection a negative moment; also for da, dr" in stated.message


def test_jsbsim_groups_alone_are_known_too(jsbsim_output, tmp_path):
    lines = [line.split(",") for line in jsbsim_output[0].read_text().splitlines()]
    kept = [j for j, name in enumerate(lines[0]) if not name.startswith("/fdm")]
    path = tmp_path / "groups.csv"
    path.write_text("\n".join(",".join(line[j] for j in kept) for line in lines) + "\n")
    groups, complete = read_recording(path), read_recording(jsbsim_output[0])
    for name in ("V", "p", "q", "r", "ax", "az", "qbar", "vd"):
        assert_allclose(groups[name], complete[name], rtol=1e-6, atol=1e-6)


# --- X-Plane -------------------------------------------------------------------------------------

HEADERS = (
    "_real,_time", "_totl,_time", "Vtrue,_ktas", "_Vind,_kias", "alpha,__deg", "_beta,__deg", "pitch,__deg",
    "_roll,__deg", "hding,_true", "____P,rad/s", "____Q,rad/s", "____R,rad/s", "Gload,norml", "Gload,axial",
    "Gload,_side", "__alt,ftmsl", "__alt,ftagl", "elev1,__deg", "elev2,__deg", "Lailn,1,deg", "Railn,1,deg",
    "rudr1,__deg", "thro1,_part", "rpm_1,_prop", "wing1,_lift", "wing1,_lift",
)  # fmt: skip


@pytest.fixture
def xplane(tmp_path):
    t = np.arange(40) * 0.05
    rows = np.array([
        100.0 + 2.0 * t, 50.0 + t, 100.0 + t, 90.0 + t, 3.0 + t, 2.0 + 0 * t, 4.0 + t, 10.0 + t, 350.0 + 0 * t,
        0.1 * t, 0.2 * t, 0.3 * t, 1.0 + 0 * t, -0.1 + 0 * t, 0.05 + 0 * t, 3000.0 + t, 500.0 + t, 5.0 + 0 * t,
        5.0 + 0 * t, 4.0 + 0 * t, -4.0 + 0 * t, 6.0 + 0 * t, 0.7 + 0 * t, 2300.0 + t, t, -t,
    ]).T  # fmt: skip
    text = "\n" + "".join(f"{name:>14} |" for name in HEADERS) + "\n"
    text += "".join("".join(f"{x:14.5f} |" for x in row) + "\n" for row in rows)
    (tmp_path / "Data.txt").write_text(text)
    return tmp_path / "Data.txt"


def test_xplane_output_needs_no_map(xplane):
    recording = read_recording(xplane)
    t = np.arange(40) * 0.05
    deg = np.pi / 180.0
    for channel, value in {
        "t": 50.0 + t, "V": (100.0 + t) * KNOT, "alpha": (3.0 + t) * deg, "theta": (4.0 + t) * deg,
        "phi": (10.0 + t) * deg, "psi": 350.0 * deg, "p": 0.1 * t, "q": 0.2 * t, "r": 0.3 * t, "az": -G,
        "h": (3000.0 + t) * FOOT, "h_agl": (500.0 + t) * FOOT, "de": 5.0 * deg, "throttle": 0.7, "rpm": 2300.0 + t,
    }.items():  # fmt: skip
        assert_allclose(recording[channel], value, rtol=1e-6, atol=1e-5, err_msg=channel)


def test_xplane_signs_are_turned_to_ours_and_said_to_be_on_trust(xplane):
    recording = read_recording(xplane)
    deg = np.pi / 180.0
    # Left aileron down rolls right, which is negative; loads count aft and left; beta counts the nose to the right.
    for channel, value in {
        "da": -4.0 * deg,
        "dr": -6.0 * deg,
        "beta": -2.0 * deg,
        "ax": 0.1 * G,
        "ay": -0.05 * G,
    }.items():
        assert_allclose(recording[channel], value, rtol=1e-5, err_msg=channel)
    (stated,) = [f for f in recording.findings if f.kind == "assumed"]
    assert (stated.channel, stated.message.rpartition("also for ")[2]) == ("beta", "ax, ay, dr")


def test_headers_that_xplane_repeats_make_no_channel(xplane, tmp_path):
    text = xplane.read_text().replace("elev2,__deg", "elev1,__deg")
    (tmp_path / "twice.txt").write_text(text)
    recording = read_recording(tmp_path / "twice.txt")
    assert "de" not in recording
    assert any("'elev1,deg'" in note for note in recording.provenance)


# --- units in headers ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("alpha_deg", "alpha", "deg"),
        ("p_deg_s", "p", "deg/s"),
        ("alpha_dot_rad_s", "alpha_dot", "rad/s"),
        ("h_agl_ft", "h_agl", "ft"),
        ("V_kts", "V", "kt"),
        ("ax_g", "ax", "g"),
        ("t_ms", "t", "ms"),
        ("temperature_degC", "temperature", "degC"),
        ("h_agl", "h_agl", None),  # a channel itself
        ("q_hat", "q_hat", None),
        ("V_ms", "V_ms", None),  # milliseconds measure no speed
        ("V_c", "V_c", None),  # not the speed of light
        ("alpha_1", "alpha_1", None),
        ("AoA_deg", "AoA_deg", None),  # no channel: a map defines it
        ("alpha_left_deg", "alpha_left_deg", None),
    ],
)
def test_a_tail_is_a_unit_only_after_a_channel_measured_in_it(text, name, unit):
    assert split_header(text) == (name, unit)


def test_units_in_tails_are_honoured_in_text_and_matlab_files(tmp_path):
    from scipy.io import savemat

    t = np.arange(5) * 0.1
    (tmp_path / "m.csv").write_text("t_ms,alpha_deg,h_ft\n" + "".join(f"{1000 * x},{x},{x}\n" for x in t))
    savemat(tmp_path / "n.mat", {"t_ms": 1000 * t, "alpha_deg": t, "h_ft": t})
    for name in ("m.csv", "n.mat"):
        recording = read_recording(tmp_path / name)
        assert_allclose(recording.t, t, atol=1e-12)
        assert_allclose(recording["alpha"], np.radians(t), rtol=1e-12)
        assert_allclose(recording["h"], 0.3048 * t, rtol=1e-12)
