"""Reconstruction against flights whose path, biases, wind and vanes' errors were set."""

import json
import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from structsel.aircraft import Aircraft
from structsel.coefficients import compute_coefficients
from structsel.demo import demo_instruments
from structsel.errors import DataError, DomainError
from structsel.reconstruction import METHODS, reconstruct, reconstruct_all
from structsel.recording import Recording

DURATION = 6.0


def true_states(flight):
    return {name: flight.truth[name] for name in flight.truth.names} | dict(flight.errors)


def without(flight, *names):
    kept = {name: flight.measured[name] for name in flight.measured.names if name not in names}
    return Recording(flight.measured.name, flight.measured.t, kept)


def silent(aircraft):
    """The same aircraft, without a word on its instruments' noise."""
    content = aircraft.to_dict()
    for sensor in content["sensors"].values():
        sensor.pop("noise", None)
    return Aircraft.from_dict(content)


@pytest.fixture(scope="module", params=[6, pytest.param(50, marks=pytest.mark.slow)], ids="{} flights".format)
def ensemble(request):
    """Normalised errors of many flights with errors drawn anew: NEES, biases in standard deviations, rms by state."""
    nees, biases, filtered, smoothed, trusted = [], [], [], [], []
    for seed in range(request.param):
        flight = demo_instruments(seed % 6, seed, duration=DURATION)
        found = reconstruct(flight.measured, flight.aircraft)
        truth = true_states(flight)
        nees.append(found.nees(truth))
        biases += [(c.value - flight.errors.get(c.name, 0.0)) / c.std for c in found.constants]
        true = np.stack([np.broadcast_to(truth[n], len(flight.truth)) for n in found.states], axis=1)
        delayed = slice(len(true) // 10, None)
        filtered.append(np.mean((found.filtered - true)[delayed] ** 2, axis=0))
        smoothed.append(np.mean((found.estimates - true)[delayed] ** 2, axis=0))
        trusted.append(found.trusted)
    names = found.states
    return {
        "names": names,
        "nees": np.array(nees),
        "biases": np.array(biases),
        "filtered": np.sqrt(np.mean(filtered, axis=0)),
        "smoothed": np.sqrt(np.mean(smoothed, axis=0)),
        "trusted": np.mean(trusted),
    }


def test_the_errors_of_many_flights_are_as_large_as_the_covariance_says(ensemble):
    # The sum of the NEES of N flights with L states is chi-squared with N L degrees of freedom at each sample.
    dof = len(ensemble["nees"]) * len(ensemble["names"])
    low, high = stats.chi2.ppf((0.025, 0.975), dof)
    total = ensemble["nees"].sum(axis=0)
    assert np.mean((total > low) & (total < high)) > 0.9
    assert low < total.mean() < high


def test_95_in_100_biases_winds_and_upwashes_lie_within_two_standard_deviations(ensemble):
    # Of 550 (66), 95.4 % give or take three standard errors: 93 to 98 % (88 to 100 %).
    biases = ensemble["biases"]
    assert abs(np.mean(np.abs(biases) < 2.0) - 0.954) < 3.0 * np.sqrt(0.954 * 0.046 / biases.size)


def test_the_smoother_beats_the_filter_in_every_state(ensemble):
    assert np.all(ensemble["smoothed"] < ensemble["filtered"])


def test_flights_in_order_are_trusted(ensemble):
    assert ensemble["trusted"] > 0.95


@pytest.mark.parametrize("flights", [1, pytest.param(6, marks=pytest.mark.slow)])
def test_unstated_noise_is_estimated_and_the_biases_are_still_right(flights):
    levels, biases = [], []
    for seed in range(flights):
        flight = demo_instruments(seed, seed, duration=12.0)
        found = reconstruct(flight.measured, silent(flight.aircraft))
        levels += [n.std / flight.aircraft.noise[n.channel] for n in found.noise if n.channel not in _INERTIAL]
        assert {n.source for n in found.noise} == {"estimated"}
        biases += [(c.value - flight.errors.get(c.name, 0.0)) / c.std for c in found.constants]
    assert_allclose(levels, 1.0, atol=0.25)
    assert_allclose(np.mean(levels), 1.0, atol=0.12 / np.sqrt(flights))
    # Two standard errors below 95.4 %: 90 % of the 66 biases of six flights, 83 % of the 11 of one.
    assert np.mean(np.abs(biases) < 2.0) > 0.954 - 2.0 * np.sqrt(0.954 * 0.046 / len(biases))


_INERTIAL = ("ax", "ay", "az", "p", "q", "r")


@pytest.mark.parametrize("method", METHODS)
def test_every_method_takes_out_the_biases(method):
    flight = demo_instruments(5, 3, duration=15.0)
    found = reconstruct(flight.measured, flight.aircraft, method=method)
    assert found.method == method
    for constant in found.constants:
        # Output error takes noisy inertial readings for exact, and is allowed more.
        limit = 4.0 if method != "output-error" else 6.0
        assert abs(constant.value - flight.errors.get(constant.name, 0.0)) < limit * constant.std, constant


@pytest.mark.slow
def test_the_extended_filter_agrees_with_the_unscented_where_little_is_curved():
    flight = demo_instruments(0, 4, duration=15.0)
    one, other = (reconstruct(flight.measured, flight.aircraft, method=m) for m in ("unscented", "extended"))
    for constant in one.constants:
        assert abs(other[constant.name].value - constant.value) < 0.3 * constant.std, constant


def test_the_reconstructed_recording_is_at_the_centre_of_gravity_and_stays_there():
    flight = demo_instruments("all-axes", 2, duration=15.0)
    found = reconstruct(flight.measured, flight.aircraft)
    made, truth = found.recording, flight.truth
    for name in ("V", "alpha", "beta", "u", "v", "w", "phi", "theta", "psi", "h", "x", "y"):
        error = np.sqrt(np.mean((made[name] - truth[name]) ** 2))
        assert error < 3.0 * np.sqrt(np.mean(found.std[name] ** 2)), name
    # What compute_coefficients makes of the truth; vanes and accelerometers must not be carried a second time.
    from_truth = compute_coefficients(truth.with_channels(rho=flight.measured["rho"]), _centred(flight.aircraft))
    from_found = compute_coefficients(made, flight.aircraft)
    for name in ("CX", "CY", "CZ"):
        assert abs(np.mean(from_found[name] - from_truth[name])) < 2e-3, name
    assert_allclose(from_found["alpha"], made["alpha"], rtol=0, atol=0)


def _centred(aircraft):
    content = aircraft.to_dict()
    content["sensors"] = {}
    return Aircraft.from_dict(content)


def test_rates_of_change_come_from_the_kinematics():
    flight = demo_instruments("elevator-3211", 1, duration=20.0)
    made, truth = reconstruct(flight.measured, flight.aircraft).recording, flight.truth
    for name, channel in (("alpha_dot", "alpha"), ("V_dot", "V"), ("beta_dot", "beta")):
        exact = truth.differentiate(channel)[name]
        measured = flight.measured.differentiate(channel)[name]
        error = np.sqrt(np.mean((made[name] - exact)[5:-5] ** 2))
        assert error < 0.05 * np.sqrt(np.mean((measured - exact)[5:-5] ** 2)), name


@pytest.mark.slow
def test_the_accuracy_stated_of_the_angular_accelerations_is_their_error_or_a_little_more():
    ratios = []
    for which in range(3):
        flight = demo_instruments(which, 1, duration=20.0)
        found = reconstruct(flight.measured, flight.aircraft)
        for name in ("p", "q", "r"):
            error = found.recording[f"{name}_dot"] - flight.truth[f"{name}_dot"]
            ratios.append(np.sqrt(np.mean(error**2)) / found.turning_std[name])
    assert min(ratios) > 0.45
    assert max(ratios) < 1.3


def test_slower_instruments_count_only_where_they_read():
    flight = demo_instruments("all-axes", 6)
    thin = {name: np.array(flight.measured[name]) for name in flight.measured.names}
    for name, every in (("x", 50), ("y", 50), ("h", 10), ("vn", 10), ("ve", 10), ("vd", 10)):
        reading = np.arange(len(flight.measured)) % every == 0
        thin[name][~reading] = np.nan
    held = dict(thin)
    for name in ("x", "y", "h", "vn", "ve", "vd"):
        last = np.maximum.accumulate(np.where(np.isfinite(thin[name]), np.arange(len(flight.measured)), 0))
        held[name] = thin[name][last]
    found = reconstruct(Recording("thin", flight.measured.t, thin), flight.aircraft)
    same = reconstruct(Recording("held", flight.measured.t, held), flight.aircraft)
    assert_allclose(same.estimates, found.estimates, rtol=1e-12, atol=1e-12)
    assert [f.kind for f in same.findings if f.channel == "x"] == ["held"]
    inside = [abs(c.value - flight.errors.get(c.name, 0.0)) < 3.0 * c.std for c in found.constants]
    assert all(inside)


@pytest.mark.slow
def test_a_delayed_vane_is_named_and_brought_into_line():
    flight = demo_instruments("elevator-3211", 2)
    t = flight.measured.t
    delayed = np.interp(t - 0.12, t, flight.measured["alpha"])
    recording = flight.measured.with_channels(alpha=delayed)
    stated = {d.channel: d for d in reconstruct(recording, flight.aircraft).delays}
    assert stated["alpha"].significant
    found = reconstruct(recording, flight.aircraft, delays="estimate")
    assert any("alpha" in note and "0.1" in note for note in found.recording.provenance)
    left = next(d for d in found.delays if d.channel == "alpha")
    assert abs(left.delay) < 0.01
    assert abs(found["Calpha0"].value - flight.errors["Calpha0"]) < 3.0 * found["Calpha0"].std


def test_the_sideslip_vane_s_offset_is_refused_with_the_reason():
    flight = demo_instruments(1, 1, duration=10.0)
    found = reconstruct(flight.measured, flight.aircraft, estimate=("bax", "Cbeta0"))
    assert "Cbeta0" in found.fixed
    assert "Cbeta0" not in found.states
    assert "Cbeta0" in str(found)


def test_without_position_there_is_no_wind_and_without_heading_none_is_made_up():
    flight = demo_instruments(1, 1, duration=10.0)
    found = reconstruct(without(flight, "x", "y", "vn", "ve", "vd", "psi"), flight.aircraft)
    assert not {"wn", "we", "psi", "x", "y"} & set(found.states)
    assert {"wn", "we", "psi", "Cbeta0"} <= set(found.fixed)
    assert "record x, y or vn, ve" in found.fixed["wn"]
    assert "psi" not in found.recording
    for constant in found.constants:
        assert abs(constant.value - flight.errors.get(constant.name, 0.0)) < 4.0 * constant.std, constant


@pytest.mark.default_cases("1")
@pytest.mark.parametrize("which", [1, 2, 5])
def test_without_a_heading_the_ground_track_gives_it_and_the_wind(which):
    # The heading may be off by half a radian in the wind of these flights, and the filter must not begin there.
    flight = demo_instruments(which, which, duration=12.0)
    found = reconstruct(without(flight, "psi"), flight.aircraft)
    assert found.trusted
    assert np.abs(found.recording["psi"] - flight.truth["psi"]).max() < 0.02
    for constant in found.constants:
        assert abs(constant.value - flight.errors[constant.name]) < 4.0 * constant.std, constant


@pytest.mark.parametrize("which", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_without_vanes_ground_velocity_and_airspeed_give_the_steady_wind(which):
    flight = demo_instruments(which, 3, duration=20.0)
    found = reconstruct(without(flight, "alpha", "beta", "x", "y"), flight.aircraft)
    assert found.trusted, found.distrust
    assert {"wn", "we"} <= set(found.states)
    for constant in found.constants:
        assert abs(constant.value - flight.errors[constant.name]) < 3.0 * constant.std, constant


@pytest.mark.slow
def test_longitudinal_channels_alone_give_the_longitudinal_motion():
    flight = demo_instruments("elevator-3211", 5)
    left = without(flight, "ay", "p", "r", "beta", "phi", "psi", "x", "y", "vn", "ve", "vd")
    found = reconstruct(left, flight.aircraft)
    assert set(found.states) <= {"u", "w", "theta", "h", "bax", "baz", "bq", "Cup", "Calpha0"}
    assert abs(found["bq"].value - flight.errors["bq"]) < 1e-3
    assert any(f.kind == "assumed" for f in found.findings)


def test_a_result_is_frozen_survives_a_pickle_and_goes_to_json():
    flight = demo_instruments(0, 1, duration=8.0)
    found = reconstruct(flight.measured, flight.aircraft)
    with pytest.raises(ValueError, match="read-only"):
        found.estimates[0, 0] = 1.0
    again = pickle.loads(pickle.dumps(found))
    assert str(again) == str(found)
    content = json.loads(json.dumps(found.to_dict()))
    assert content["schema"] == "structsel.reconstruction/1"
    assert {row["name"] for row in content["constants"]} == {c.name for c in found.constants}


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_many_manoeuvres_are_done_in_parallel_and_a_bad_one_costs_only_itself(workers):
    flights = [demo_instruments(which, 1, duration=4.0) for which in range(4)]
    recordings = [f.measured for f in flights]
    recordings[2] = recordings[2].with_channels(q=np.full(len(recordings[2]), np.nan))
    seen = []
    together = reconstruct_all(recordings, flights[0].aircraft, workers=workers, progress=lambda *a: seen.append(a))
    assert [one.name for one in together] == [recordings[i].name for i in (0, 1, 3)]
    assert list(together.failed) == [recordings[2].name]
    assert "'q'" in together.failed[recordings[2].name]
    assert seen[-1] == ("manoeuvres", 4, 4)
    alone = reconstruct(recordings[3], flights[3].aircraft)
    assert_allclose(together[recordings[3].name].estimates, alone.estimates, rtol=1e-12, atol=1e-13)
    with pytest.raises(KeyError, match="'q'"):
        together[recordings[2].name]
    with pytest.raises(DomainError, match="two recordings"):
        reconstruct_all([recordings[0], recordings[0]], flights[0].aircraft)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"method": "kalman"}, "no method 'kalman'"),
        ({"delays": "guess"}, "delays are"),
        ({"estimate": ("bx",)}, "'bx'"),
        ({"noise": {"V": -1.0}}, "above zero"),
        ({"noise": {"speed": 1.0}}, "'speed'"),
        ({"gate": -1.0}, "gate"),
        ({"spread": 0.1}, "spread"),
    ],
)
def test_an_option_out_of_range_is_refused_in_words(options, says):
    flight = demo_instruments(0, 1, duration=4.0)
    with pytest.raises(DomainError, match=says):
        reconstruct(flight.measured, flight.aircraft, **options)


def test_a_gap_in_time_is_refused_with_a_remedy():
    flight = demo_instruments(0, 1, duration=8.0)
    rows = np.r_[0:150, 250:401]
    cut = Recording("cut", flight.measured.t[rows], {n: flight.measured[n][rows] for n in flight.measured.names})
    with pytest.raises(DataError, match=r"split\(\)"):
        reconstruct(cut, flight.aircraft)
    assert len(reconstruct_all(cut.split(), flight.aircraft, workers=1)) == 2
