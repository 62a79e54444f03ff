"""Reports of selections, reconstructions and refinements: the result first, every number, and every name escaped."""

import base64
import hashlib
import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel import Candidates, Reconstructions, Recording, read_recording, select, write_recording, write_report
from structsel.errors import DomainError
from structsel.formatting import format_number
from structsel.report import render
from structsel.report.downsampling import keep_extremes
from tests.report_pages import manoeuvre, pages, reconstructed, refined, selected
from tests.test_report import Page

KINDS = ("selection", "reconstruction", "refinement")
BAD = "<script>alert(1)</script>"


def unpack(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


def data_of(text):
    return json.loads(Page(text).scripts[0])


@pytest.mark.parametrize("kind", KINDS)
def test_every_tag_closes_and_no_figure_is_printed_as_nan(kind):
    made = Page(pages()[kind])
    assert made.crossed == made.open == []
    assert not re.search(r"\b(nan|inf|None)\b", made.words())


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_fetched_from_anywhere(kind):
    made = Page(pages()[kind])
    for tag, attrs in made.tags:
        assert tag not in ("link", "iframe", "object", "embed", "base", "img")
        assert not {"src", "action", "background"} & set(attrs)
        assert attrs.get("href", "#").startswith("#")
        assert not any(name.startswith("on") for name in attrs)


@pytest.mark.parametrize(
    ("kind", "order"),
    {
        "selection": ("Of 9 candidate terms, 3 for Cm and 1 for CZ were selected", "Validation These", "Terms"),
        "reconstruction": ("1 of 3 manoeuvres can be trusted", "All manoeuvres", "Errors of the instruments"),
        "refinement": ("The search converged: the model simulates alpha, q, theta and az", "Validation", "Parameters"),
    }.items(),
)
def test_the_finding_comes_first_then_figures_warnings_and_what_was_done(kind, order):
    stated = Page(pages()[kind]).words()
    ends = ("Time histories", "Warnings", "Method and data", "SHA-256")
    places = [stated.find(word) for word in (*order, *ends)]
    assert -1 not in places
    assert places == sorted(places)
    assert re.search(r"structsel \d\S*, Python \d\S*, NumPy \d\S*, SciPy \d", stated)


def test_a_selections_page_holds_its_numbers_and_warnings():
    found, _, judged = selected()
    stated = Page(pages()["selection"]).words()
    for s in found.values():
        for row in s.to_frame().to_dict("records"):
            assert f"{row['term']} {row['value']:.4g}"[:9] in stated
        assert all(warning in stated for warning in s.doubts)
    assert any(s.doubts for s in found.values())
    assert f"{judged.score('Cm').r2:.4f}" in stated
    assert "m04 validation m04.csv" in stated
    # Counted on the page, whose verdict it is.
    assert f"{sum(len(s.doubts) for s in found.values()) + len(judged.doubts)} warnings below" in stated


def test_the_verdict_of_a_selection_is_that_of_the_validation_recordings():
    found, _, judged = selected()
    worst, best = sorted(judged.score(response).r2 for response in found)
    stated = Page(pages()["selection"]).words()
    assert stated.index(f"predicts {100.0 * worst:.1f} to {100.0 * best:.1f} % of held-out data") < 120
    # Without them that of cross-validation, whose numbers differ.
    alone = Page(render(found["Cm"])).words()
    assert f"predicts {100.0 * found['Cm'].held_out_r2:.1f} % of held-out data" in alone
    useless = replace(found["Cm"], held_out_r2=-0.1)
    assert "does not predict Cm" in Page(render(useless)).words()
    assert "not validated" in Page(render(replace(found["Cm"], held_out_r2=np.nan))).words()


def test_the_candidates_that_were_not_selected_have_their_probability():
    found = replace(selected()[0]["Cm"], probability={"alpha": 1.0, "alpha^2": 0.31, "de^2": 0.01})
    stated = Page(render(found)).words()
    assert "Candidates that may belong in the model term prob. bar alpha^2 31 %" in stated
    assert "de^2 1 %" not in stated


def test_a_refinement_without_held_out_recordings_has_the_verdict_of_the_resimulations():
    found, flights, replays = refined()
    assert found.verdict == "not validated"
    stated = Page(pages()["refinement"]).words()
    assert "better The refined model is better on m02: the rms error is between" in stated
    turned = {"before": replays["after"], "after": replays["before"]}
    assert "The refined model is worse on m02" in Page(render(found, recordings=flights[:1], judged=turned)).words()
    assert "The refined model is not validated" in Page(render(found, recordings=flights[:1])).words()


def test_a_reconstructions_page_says_what_is_not_trusted_and_what_was_found():
    text = pages()["reconstruction"]
    stated = Page(text).words()
    for word in (
        "second: theta and the accelerometers contradict.",
        "third: not reconstructed: no channel 'V' [m/s]",
        "Cbeta0 was not estimated: never observable in flight",
        "No warnings except those at the top",
    ):
        assert word in stated
    one = next(iter(reconstructed()))
    # Gyro biases are reported in degrees; the std has one digit, which sets the digits of the value.
    p = np.rad2deg(one["bp"].value)
    assert f"{p:.3f} ± {np.rad2deg(one['bp'].std):.3f} deg/s" in stated
    held = data_of(text)["recordings"]["all-axes"]["responses"]["h"]
    known = np.flatnonzero(np.isfinite(one.residuals["h"]))
    # Read four times a second only: drawn as a line through these readings, not as gaps.
    assert len(unpack(held["t"])) == len(known)
    assert_allclose(unpack(held["y"]["measured"]), (one.readings["h"] + one.residuals["h"])[known], rtol=1e-6)
    assert_allclose(unpack(held["y"]["innovation"]), (one.innovations["h"] / one.innovation_std["h"])[known], rtol=1e-5)


def test_a_refinements_page_holds_estimates_their_errors_and_flights_held_out():
    found, _, replays = refined()
    stated = Page(pages()["refinement"]).words()
    for e in found.estimates[:4]:
        assert f"{e.name} {format_number(e.value)} {format_number(e.std, 2)}" in stated
    ratios = {o: replays["after"].score(o).rms_error / replays["before"].score(o).rms_error for o in found.noise_std}
    worst = max(ratios, key=ratios.get)
    assert f"and {100.0 * ratios[worst]:.0f} % ({worst}) of the error before the refinement" in stated
    bad = replace(found, converged=False, message="60 iterations")
    text = Page(render(bad, reasons=["the flights do not determine Cm:q_hat"])).words()
    assert text.index("the flights do not determine Cm:q_hat") < text.index("NOT CONVERGED: 60 iterations")
    assert text.index("NOT CONVERGED: 60 iterations") < text.index("Parameters 4 parameters")


def test_figures_hold_measured_and_modelled_in_the_units_people_read():
    found, recordings, _ = selected()
    data = data_of(pages()["selection"])
    one = data["recordings"]["m02"]
    modelled = found.model.evaluate(recordings[1])["Cm"]
    assert_allclose(unpack(one["responses"]["Cm"]["y"]["measured"]), recordings[1]["Cm"], rtol=1e-6)
    assert_allclose(unpack(one["responses"]["Cm"]["y"]["physics"]), modelled, rtol=1e-6)
    assert_allclose(unpack(one["channels"]["alpha"]["y"]), np.rad2deg(recordings[1]["alpha"]), rtol=1e-6)
    assert data["units"]["alpha"] == "deg"


def hostile():
    """A page of each kind in which every name the data can choose is a script."""
    recordings = [
        Recording(
            f"{BAD}{k}</script>", one.t, {**dict(one.channels), BAD: one["alpha"] ** 2, f"{BAD}y": one["Cm"]},
            {BAD: BAD, f"{BAD}y": BAD}, (f"read from '/{BAD}.csv'", BAD),
        )
        for k, one in enumerate(manoeuvre(k) for k in range(2))
    ]  # fmt: skip
    found = select(recordings, f"{BAD}y", Candidates.polynomial(["alpha", "de"], 1), bootstrap=0)
    one = found
    yield render(replace(one, doubts=(BAD,)), recordings=recordings)
    one = next(iter(reconstructed()))
    recording = Recording(BAD, one.recording.t, one.recording.channels, {}, (BAD,))
    changes = {"name": BAD, "recording": recording, "doubts": (BAD,), "distrust": (BAD,), "fixed": {BAD: BAD}}
    yield render(Reconstructions((type(one)(**{**one.__dict__, **changes}),), {BAD: BAD}))
    better, flights, _ = refined()
    named = [Recording(BAD, r.t, {**dict(r.channels), BAD: r["q"]}, {BAD: BAD}, (BAD,)) for r in better.simulated]
    fits = tuple(replace(f, recording=BAD) for f in better.fits)
    estimates = tuple(replace(e, name=f"start:{BAD}:w" if e.kind == "start" else BAD) for e in better.estimates)
    yield render(
        replace(better, simulated=tuple(named), fits=fits, estimates=estimates, message=BAD, converged=False,
                doubts=(BAD,), residuals={BAD: better.residuals["m01"]}),
        recordings=[replace_name(r) for r in flights[:1]], reasons=[BAD],
    )  # fmt: skip


def replace_name(recording):
    return Recording(BAD, recording.t, recording.channels, {}, (BAD,))


def test_no_name_from_the_data_becomes_markup_or_ends_the_script():
    made = list(hostile())
    assert len(made) == len(KINDS)
    for text in made:
        assert "<script>alert" not in text
        page = Page(text)
        assert len(page.scripts) == 2
        assert any(BAD in name for name in json.loads(page.scripts[0])["recordings"])
        assert BAD in page.words()


def test_the_files_are_named_with_their_hashes(tmp_path):
    path = tmp_path / "m01.csv"
    write_recording(manoeuvre(0), path)
    recordings = [read_recording(path)]
    found = select(recordings, "Cm", Candidates.polynomial(["alpha", "q_hat", "de"], 1), bootstrap=0)
    stated = Page(render(found, recordings=recordings)).words()
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    assert f"m01 used m01.csv {digest} 500 0 to 19.96 s 0.04 s" in stated
    assert str(tmp_path) not in stated
    path.unlink()
    assert "m01 used m01.csv - 500" in Page(render(found, recordings=recordings)).words()


def test_without_recordings_the_tables_stand_alone():
    made = Page(render(selected()[0]))
    assert "Time histories" not in made.words()
    assert "m01 m02 m03" in made.words()


def test_an_hour_at_50_hz_of_12_channels_can_be_mailed_and_keeps_its_peaks(tmp_path):
    n = 180_000
    t = 1.7e9 + 0.02 * np.arange(n)
    rng = np.random.default_rng(3)
    channels = {
        name: np.sin(t * 0.01 * (k + 1)) + 0.05 * rng.standard_normal(n)
        for k, name in enumerate(("alpha", "beta", "p", "q", "r", "V", "h", "de", "da", "dr", "mach"))
    }
    channels["Cm"] = -0.6 * channels["alpha"] + 0.01 * rng.standard_normal(n)
    channels["Cm"][123_456] = 3.0
    recordings = [Recording("hour", t, channels)]
    pool = Candidates.polynomial([c for c in channels if c != "Cm"], 1)
    found = select(recordings, "Cm", pool, bootstrap=0)
    began = time.process_time()
    path = write_report(found, tmp_path / "report.html", recordings=recordings)
    assert time.process_time() - began < 20.0  # it takes one: a report that draws every sample takes minutes
    assert 1_000_000 < path.stat().st_size < 3_000_000
    one = data_of(path.read_text())["recordings"]["hour"]
    held = one["responses"]["Cm"]
    y, seconds = unpack(held["y"]["measured"]), unpack(held["t"])
    assert y.max() == 3.0
    # Time since the start, so that single precision separates the samples.
    assert one["start"] == 1.7e9
    assert_allclose(seconds[y.argmax()], 123_456 * 0.02, atol=1e-3)


def test_thinning_keeps_the_least_and_the_greatest_of_every_segment():
    rng = np.random.default_rng(0)
    y = rng.standard_normal(10_000)
    y[[17, 9_000]] = 50.0, -50.0
    kept = keep_extremes([y, -2.0 * y], 400)
    assert len(kept) <= 400
    assert {0, 17, 9_000, 9_999} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)
    for part in np.array_split(np.arange(10_000), 100):
        assert {y[part].min(), y[part].max()} <= set(y[kept].tolist())


def test_a_line_breaks_where_readings_fail_for_long_but_not_between_slow_ones():
    y = np.full(1000, np.nan)
    y[::10] = 1.0
    assert keep_extremes([y], 1000).tolist() == list(range(0, 1000, 10))
    y[300:500] = np.nan
    kept = keep_extremes([y], 1000)
    assert [k for k in kept if np.isnan(y[k])] == [291]
    assert keep_extremes([np.full(5, np.nan)], 10).size == 0


def test_means_over_a_channel_hold_equal_numbers_of_samples():
    found, recordings, _ = selected()
    bins = data_of(pages()["selection"])["binned"]["CZ"]["alpha"]
    assert all(half > 0.0 for half in bins["half"]["physics"])
    # Bins of as many samples each: the mean of their means is that of all differences.
    left = np.concatenate([r["CZ"] - found.model.evaluate(r, outside="ignore")["CZ"] for r in recordings])
    assert_allclose(np.mean(bins["means"]["physics"]), left.mean(), atol=0.01 * left.std())
    assert_allclose(np.mean(bins["at"]), np.rad2deg(np.mean([r["alpha"] for r in recordings])), rtol=1e-3)


def test_what_is_no_result_is_refused(tmp_path):
    with pytest.raises(DomainError, match="was given a dict"):
        write_report({}, tmp_path / "report.html")
    assert not list(tmp_path.iterdir())
