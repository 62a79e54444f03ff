"""resimulate(): flights with recorded inputs, over their complete length and in windows."""

import pickle

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel import (
    AeroModel,
    Aircraft,
    Instruments,
    Recording,
    ResponseModel,
    linearise,
    published_aircraft,
    resimulate,
    simulate,
    trim,
)
from structsel.errors import ChannelError, DataError, DomainError, ModelError
from structsel.inputs import doublet, frequency_sweep, information, name_derivatives, three_two_one_one
from structsel.plotting import draw_flight, draw_inputs, draw_resimulation, plot_resimulation
from structsel.validation import r2, rrmse, tic
from structsel.validation.resimulate import window_rows

CITATION = published_aircraft("citation")
TRIM = CITATION.trim()


def changed(**terms):
    """The model with other values of terms of Cm."""
    held = CITATION.model["Cm"]
    values = [terms.get(str(term), value) for term, value in zip(held.terms, held.values)]
    return AeroModel({**CITATION.model.responses, "Cm": ResponseModel(held.terms, np.array(values))}, "changed")


def manoeuvre(name="m01", size=0.02, model=CITATION.model, duration=12.0):
    """A manoeuvre without noise, from trim."""
    u = three_two_one_one("de", size, 0.5, duration=duration, dt=0.04)
    schedule = Recording(name, u.t, {"de": TRIM["de"] + u["de"]})
    return simulate(model, CITATION.aircraft, schedule, start=TRIM)


@pytest.fixture(scope="module")
def flight():
    return manoeuvre()


def test_the_true_model_reproduces_a_flight_exactly_over_its_length_and_in_windows(flight):
    found = resimulate(CITATION.model, CITATION.aircraft, flight)
    assert found.divergences == ()
    for one in found.scores:
        assert one.reached == 1.0
        assert one.rms_error < 1e-9 * max(1.0, np.abs(flight[one.output]).max())
        assert one.inside == 1.0


def test_scores_are_those_of_the_metrics_over_the_flights_it_returns(flight):
    other = manoeuvre("m02", -0.015)
    found = resimulate(
        changed(alpha=-0.4), CITATION.aircraft, [flight, other], outputs=["q", "alpha"], normaliser="std"
    )
    for kind, flights in (("whole", found.whole), ("windows", found.windows)):
        y = np.concatenate([flight["q"], other["q"]])
        z = np.concatenate([one["q"] for one in flights])
        score = found.score("q", kind=kind)
        assert score.n == len(y)
        assert_allclose([score.r2, score.rrmse, score.tic], [r2(y, z), rrmse(y, z, "std"), tic(y, z)], rtol=1e-12)
        assert score.inside == pytest.approx(np.mean(np.abs(y - z) <= np.radians(2.0)), abs=2e-3)
        one = found.score("q", "m02", kind)
        assert one.r2 == pytest.approx(r2(other["q"], flights[1]["q"]))
    assert len(found.to_frame()) == 2 * 2 * 3


def test_each_window_starts_from_what_was_recorded(flight):
    found = resimulate(changed(alpha=-0.3), CITATION.aircraft, flight, window=2.0)
    firsts = [rows.start for rows in window_rows(flight, 2.0)]
    assert firsts == [0, 50, 100, 150, 200, 250]
    assert_allclose(found.windows[0]["q"][firsts], flight["q"][firsts], atol=1e-12)
    error = np.abs(found.windows[0]["q"] - flight["q"])
    assert error[75] > 1e-3  # the model is wrong, so it leaves the record in between
    assert found.score("theta", kind="windows").r2 > found.score("theta").r2
    # What is left is a window of its own from half a window on.
    assert [rows.stop - rows.start for rows in window_rows(flight, 5.0)] == [125, 176]
    assert [rows.stop - rows.start for rows in window_rows(flight, 4.0)] == [100, 100, 101]


def test_outputs_are_read_where_the_instruments_stand():
    places = {"vane": {"position": [6.0, 0.0, 0.0]}, "accelerometer": {"position": [1.0, 0.0, 0.5]}}
    with_sensors = Aircraft.from_dict({**CITATION.aircraft.to_dict(), "sensors": places})
    u = doublet("de", 0.03, duration=8.0, dt=0.04)
    schedule = Recording("m01", u.t, {"de": TRIM["de"] + u["de"]})
    record = simulate(CITATION.model, with_sensors, schedule, start=TRIM, instruments=Instruments())
    found = resimulate(CITATION.model, with_sensors, record)
    assert max(one.rms_error for one in found.scores) < 1e-8
    elsewhere = resimulate(CITATION.model, CITATION.aircraft, record)
    # At the vane alpha is less by q x / V, with x = 6 m.
    off = record["alpha"] - elsewhere.whole[0]["alpha"]
    assert_allclose(off, -record["q"] * 6.0 / record["V"], atol=4e-4)


def test_an_aircraft_unstable_in_open_loop_diverges_over_the_recording_and_is_judged_in_windows():
    # A slight gyro bias starts each flight with a turn; over the complete length, that grows with 1.2 per second.
    unstable = changed(alpha=0.8)
    steady = trim(unstable, CITATION.aircraft, 120.0, 7500.0)
    fastest = linearise(unstable, CITATION.aircraft, steady).modes().eigenvalues.real.max()
    assert fastest == pytest.approx(1.2, abs=0.1)
    u = doublet("de", 0.0005, 0.5, duration=6.0, dt=0.04)
    schedule = Recording("m01", u.t, {"de": steady["de"] + u["de"]})
    record = simulate(unstable, CITATION.aircraft, schedule, start=steady)
    off = record.with_channels(q=record["q"] + 0.002)
    found = resimulate(unstable, CITATION.aircraft, off, window=1.0, outputs=["alpha", "theta"])
    windows, complete = (found.score("alpha", kind=kind).rms_error for kind in ("windows", "whole"))
    assert windows < 0.05 * complete
    wild = resimulate(changed(alpha=3.0), CITATION.aircraft, manoeuvre())
    (parted,) = [one for one in wild.divergences if "measured range" in one.why]
    assert 0.0 < parted.at < 3.0
    assert f"diverges at t = {parted.at:g} s" in str(wild)


def test_a_flight_that_blows_up_is_named_with_the_time_and_scored_to_there(flight):
    found = resimulate(changed(alpha=60.0, q_hat=90.0), CITATION.aircraft, flight)
    complete = next(one for one in found.divergences if one.kind == "whole" and "measured range" not in one.why)
    reached = int(np.isfinite(found.whole[0]["q"]).sum())
    assert complete.at == pytest.approx(flight.t[reached])
    score = found.score("q")
    assert score.reached == pytest.approx(reached / len(flight))
    assert score.inside <= score.reached  # samples that were not reached are not inside
    assert found.to_dict()["departures"][0]["recording"] == "m01"
    assert "more of its windows diverge" in str(found)


def test_gaps_of_an_output_are_passed_over_and_a_still_channel_has_no_r2(flight):
    gaps = flight["q"].copy()
    gaps[20:60] = np.nan
    found = resimulate(CITATION.model, CITATION.aircraft, flight.with_channels(q=gaps, beta=0.0), outputs=["q", "beta"])
    assert found.score("q").n == len(flight) - 40
    assert found.score("q").rms_error < 1e-9
    assert np.isnan(found.score("beta").r2)
    assert found.to_dict()["pooled"][1]["r2"] is None


def test_bands_may_be_given_and_decide_what_is_inside(flight):
    model = changed(alpha=-0.45)
    error = np.abs(resimulate(model, CITATION.aircraft, flight).whole[0]["q"] - flight["q"])
    half = float(np.median(error))
    found = resimulate(model, CITATION.aircraft, flight, bands={"q": half})
    assert found.score("q").inside == pytest.approx(0.5, abs=0.01)


def test_longitudinal_models_start_without_lateral_motion_and_need_no_altitude_with_a_density():
    published = published_aircraft("hfb320")
    trim = published.trim()
    u = doublet("de", 0.02, duration=8.0, dt=0.05)
    record = published.simulate(Recording("m01", u.t, {"de": trim["de"] + u["de"]}), start=trim)
    record = Recording("m01", u.t, {c: record[c] for c in record.names if c != "h"}, provenance=record.provenance)
    record = record.with_channels(p=0.1, phi=0.05)
    found = resimulate(
        published.model, published.aircraft, record, air=published.air, definitions=published.definitions
    )
    assert found.outputs == ("V", "alpha", "q", "theta", "ax", "az")
    assert found.score("q").r2 > 1.0 - 1e-9


def test_what_cannot_be_simulated_is_refused_with_the_reason(flight):
    fly = lambda *more, **options: resimulate(CITATION.model, CITATION.aircraft, *more, **options)  # noqa: E731
    with pytest.raises(DataError, match="given none"):
        fly([])
    with pytest.raises(DataError, match="m01 more than once"):
        fly([flight, flight])
    with pytest.raises(ModelError, match=r"no output 'qq'.*has V"):
        fly(flight, outputs=["qq"])
    with pytest.raises(ModelError, match="window above zero"):
        fly(flight, window=0.0)
    with pytest.raises(DomainError, match="bands above zero"):
        fly(flight, bands={"q": 0.0})
    bare = Recording("m01", flight.t, {c: flight[c] for c in flight.names if c != "de"})
    with pytest.raises(ChannelError, match="flies on 'de'"):
        fly(bare)
    lost = flight["theta"].copy()
    lost[0] = np.nan
    with pytest.raises(DataError, match="theta is not finite"):
        fly(flight.with_channels(theta=lost))


def test_a_resimulation_pickles_is_frozen_and_states_what_was_fitted(flight):
    model = AeroModel(CITATION.model.responses, "known", ("m01",))
    found = resimulate(model, CITATION.aircraft, flight)
    assert pickle.loads(pickle.dumps(found)).to_dict() == found.to_dict()
    assert "used to identify" in found.doubts[0]
    with pytest.raises(ModelError, match="No score of 'h'"):
        found.score("h")


def test_the_old_names_work_and_warn(flight):
    with pytest.warns(DeprecationWarning, match="use resimulate instead"):
        from structsel import replay
    found = replay(CITATION.model, CITATION.aircraft, flight, outputs=["q"])
    with pytest.warns(DeprecationWarning, match="use divergences instead"):
        assert found.departures == ()
    with pytest.warns(DeprecationWarning, match="use divergence_notes instead"):
        assert found.partings() == []
    with pytest.warns(DeprecationWarning, match="use reached instead"):
        assert found.scores[0].flown == 1.0
    with pytest.warns(DeprecationWarning, match="use Resimulation instead"):
        from structsel.validation import Replay
    assert isinstance(found, Replay)


# --- derivatives by name ----------------------------------------------------------------------------


@pytest.mark.parametrize("axis", ["longitudinal", "lateral"])
def test_named_derivatives_make_the_same_model(axis):
    linear = CITATION.linearise(TRIM, axis=axis)
    named = name_derivatives(linear)
    # Lateral: the model of named derivatives flies with wings level, this trim with a degree of bank.
    assert_allclose(named.system.A[:3], linear.system.A[:3], atol=4e-3 * np.abs(linear.system.A).max())
    assert_allclose(named.system.B, linear.system.B, rtol=1e-9, atol=1e-6 * np.abs(linear.system.B).max())


def test_a_named_derivative_is_that_of_the_coefficient():
    # mq = qbar S cbar Cmq cbar / (2 V) / Iy, with the 2 in q_hat.
    named = name_derivatives(CITATION.linearise(TRIM), outputs=["q"], inputs=["de"])
    a = CITATION.aircraft
    mq = TRIM["qbar"] * a.S * a.cbar * CITATION.model["Cm"]["q_hat"] * a.cbar / (2.0 * TRIM["V"]) / a.inertia.Iy
    assert named.parameters["mq"] == pytest.approx(mq, rel=1e-6)
    u = doublet("de", 0.02, dt=0.05)
    found = information(named, u, noise={"q": 0.001}, parameters=["mq", "mde"])
    assert (found.crlb > 0.0).all()


def test_other_states_have_no_named_derivatives():
    with pytest.raises(ModelError, match="derivatives are named for the states"):
        name_derivatives(CITATION.linearise(TRIM, axis="coupled"))
    with pytest.raises(ModelError, match="no input 'da'"):
        name_derivatives(CITATION.linearise(TRIM), inputs=["da"])


# --- figures ----------------------------------------------------------------------------------------


def test_the_figure_of_a_resimulation_shows_the_record_both_flights_the_band_and_where_they_part(flight):
    found = resimulate(changed(alpha=3.0), CITATION.aircraft, flight)
    ax = plot_resimulation(found, "m01", "alpha")
    lines = {line.get_label(): line for line in ax.get_lines()}
    assert_allclose(lines["recorded"].get_ydata(), np.rad2deg(flight["alpha"]))
    assert_allclose(lines["complete"].get_ydata(), np.rad2deg(found.whole[0]["alpha"]))
    parted = next(one.at for one in found.divergences if one.kind == "whole")
    assert any(np.allclose(line.get_xdata(), parted) for line in ax.get_lines() if len(line.get_xdata()) == 2)
    low, high = ax.get_ylim()
    assert high - low <= 4.0 * np.rad2deg(np.ptp(flight["alpha"])) + 1e-10  # the record stays readable
    plt.close("all")
    ((name, figure),) = draw_resimulation(found)
    assert name == "m01"
    assert len(figure.axes) >= len(found.outputs)


def test_figures_of_flights_and_inputs_hold_what_they_show(flight):
    figure = draw_flight(flight, flight.with_channels(q=flight["q"] + 0.01))
    q = next(ax for ax in figure.axes if ax.get_ylabel().startswith("$q"))
    measured, simulated = (line.get_ydata() for line in q.get_lines())
    assert_allclose(measured - simulated, np.rad2deg(0.01))
    u = frequency_sweep("de", 0.02, 0.1, 1.0, dt=0.05)
    figure = draw_inputs(u, name_derivatives(CITATION.linearise(TRIM), outputs=["alpha", "q"], inputs=["de"]))
    assert len(figure.axes) == 3
