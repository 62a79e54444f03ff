"""structsel reconstruct: what it prints, writes and refuses."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from structsel import Aircraft, compute_coefficients, read_recording, write_recording
from structsel.demo import demo_aircraft, demo_flight, demo_instruments
from structsel.reconstruction import METHODS, reconstruct
from structsel.recording import split_manoeuvres
from tests.commands import run

MANOEUVRES = ("elevator-3211", "all-axes")


@pytest.fixture(scope="module")
def flights():
    return {name: demo_instruments(name, 3, duration=8.0) for name in MANOEUVRES}


@pytest.fixture(scope="module")
def folder(flights, tmp_path_factory):
    made = tmp_path_factory.mktemp("flights")
    for name, flight in flights.items():
        write_recording(flight.measured, made / f"{name}.csv")
        flight.aircraft.to_toml(made / "aircraft.toml")
    return made


@pytest.fixture(scope="module")
def common(folder):
    return ("--aircraft", folder / "aircraft.toml", "--workers", 1)


@pytest.fixture(scope="module")
def written(folder, common, tmp_path_factory):
    """Return the folder of two reconstructed flights, and what was printed."""
    out = tmp_path_factory.mktemp("written") / "out"
    return out, run("reconstruct", folder, *common, "--out", out, "--no-plots")


def changed(folder, target, name, change):
    """Write one of the flights with its table changed; return its path."""
    data = pd.read_csv(folder / f"{name}.csv", comment="#")
    change(data).to_csv(target, index=False)
    return target


# --- what is printed --------------------------------------------------------------------------------


def test_the_help_page_holds_examples_and_fits_80_columns():
    printed = run("reconstruct", "--help").stdout
    assert "Examples" in printed
    assert "structsel reconstruct" in printed
    assert max(map(len, printed.splitlines())) <= 80


def test_nothing_printed_is_wider_than_80_columns(folder, common, written):
    every = run("reconstruct", folder / "all-axes.csv", *common, "--method", "all").stdout
    for text in (written[1].stdout, every):
        printed = [line for line in text.splitlines() if not line.startswith("Written to")]
        assert len(printed) > 10
        assert max(map(len, printed)) <= 80


def test_the_constants_printed_are_those_the_library_finds(flights, written):
    printed = written[1].stdout
    for name, flight in flights.items():
        found = reconstruct(flight.measured, flight.aircraft)
        part = printed[printed.index(f"{name}  401 samples, 8.0 s, unscented, trusted") :]
        for constant in found.constants:
            value = re.search(rf"^{constant.name} .*? (-?\d\S*) +\d\S* +\S+ *$", part, re.MULTILINE)[1]
            assert_allclose(float(value), constant.value, rtol=1e-3)


def test_the_summary_is_the_mean_the_scatter_and_the_mean_std_over_manoeuvres(written):
    out, result = written
    table = pd.read_csv(out / "constants.csv")
    summary = result.stdout[result.stdout.index("All manoeuvres") :]
    for name, group in table.groupby("name"):
        row = re.search(rf"^{name} +2 +(\S+) +(\S+) +(\S+)", summary, re.MULTILINE)
        expected = (group.value.mean(), group.value.std(), group["std"].mean())
        assert_allclose([float(figure) for figure in row.groups()], expected, rtol=0.06)  # printed in two digits


def test_what_cannot_be_determined_is_named_with_the_reason(folder, common, tmp_path):
    # Without any ground reference, heading changes nothing that is measured.
    gone = ["psi", "x", "y", "vn", "ve", "vd", "h"]
    path = changed(folder, tmp_path / "blind.csv", "all-axes", lambda data: data.drop(columns=gone))
    result = run("reconstruct", path, *common, "--estimate", "bax,bay,baz,bp,bq,br,Calpha0,Cbeta0")
    assert re.search(r"not estimated: (\w+, )*Cbeta0", result.stdout)
    assert "set it on the ground" in " ".join(result.stdout.split())
    assert not re.search(r"^Cbeta0", result.stdout, re.MULTILINE)


# --- what is found ----------------------------------------------------------------------------------


def test_the_errors_set_are_found_within_their_standard_deviations(flights, folder, common):
    held = json.loads(run("reconstruct", folder, *common, "--json").stdout)
    assert held["schema"] == "structsel.reconstructions/1"
    assert [one["name"] for one in held["done"]] == sorted(MANOEUVRES)
    for one in held["done"]:
        assert one["trusted"]
        off = [(c["value"] - flights[one["name"]].errors[c["name"]]) / c["std"] for c in one["constants"]]
        assert len(off) == 11
        assert np.max(np.abs(off)) < 4.0  # 22 numbers: probability 1 in 700 at random


def test_only_the_constants_asked_for_are_estimated(folder, common):
    arguments = ("reconstruct", folder / "all-axes.csv", *common, "--estimate", "baz,bq", "--json")
    (one,) = json.loads(run(*arguments).stdout)["done"]
    assert [c["name"] for c in one["constants"]] == ["baz", "bq"]


def test_a_wrong_gravity_goes_into_the_bias_of_the_vertical_accelerometer(folder, common):
    def baz(*options):
        held = json.loads(run("reconstruct", folder / "elevator-3211.csv", *common, "--json", *options).stdout)
        return next(c["value"] for c in held["done"][0]["constants"] if c["name"] == "baz")

    # In level flight az - baz = -g, whatever g is taken to be.
    assert baz("--g", 9.85665) - baz("--g", 9.80665) == pytest.approx(0.05, rel=0.05)


def test_every_method_is_compared_and_leaves_its_own_folder(folder, common, tmp_path):
    arguments = ("reconstruct", folder / "all-axes.csv", *common, "--method", "all", "--no-plots")
    printed = run(*arguments, "--out", tmp_path / "out").stdout
    assert re.search(r"constant +unscented +std +extended +std +output-error +std", printed)
    assert {p.name for p in (tmp_path / "out").iterdir()} == set(METHODS)
    for method in METHODS:
        held = json.loads((tmp_path / "out" / method / "reconstruction.json").read_text())
        assert held["done"][0]["method"] == method


def test_a_delayed_channel_is_named_and_advanced_by_what_is_given(folder, common, tmp_path):
    # Five samples of 0.02 s late.
    path = changed(folder, tmp_path / "late.csv", "elevator-3211", lambda data: data.assign(alpha=data.alpha.shift(5)))

    def outcome(delays):
        (one,) = json.loads(run("reconstruct", path, *common, "--delays", delays, "--json").stdout)["done"]
        said = any("alpha is delayed" in text for text in (*one["doubts"], *one["distrust"]))
        return next(d["delay"] for d in one["delays"] if d["channel"] == "alpha"), said

    delay, said = outcome("report")
    assert delay > 0.05
    assert said
    for delays in ("alpha=0.1", "estimate"):
        delay, said = outcome(delays)
        assert abs(delay) < 0.01
        assert not said


def test_manoeuvres_are_found_in_a_long_recording(common, tmp_path):
    flight = demo_instruments("elevator-3211", 3, duration=30.0)
    write_recording(flight.measured, tmp_path / "long.csv")
    result = run("reconstruct", tmp_path / "long.csv", *common, "--cut", "manoeuvres", "--json")
    found = [one["name"] for one in json.loads(result.stdout)["done"]]
    assert found == [part.name for part in split_manoeuvres(read_recording(tmp_path / "long.csv"))]
    assert "'long' is cut into 3 parts: long_m01 (0 to" in result.stderr
    former = run("reconstruct", tmp_path / "long.csv", *common, "--find-manoeuvres", "--json")
    assert "--find-manoeuvres is deprecated: use --cut manoeuvres." in former.stderr
    assert [one["name"] for one in json.loads(former.stdout)["done"]] == found


# --- what is written ---------------------------------------------------------------------------------


def test_out_holds_flights_tables_report_and_plots(folder, common, tmp_path):
    run("reconstruct", folder / "all-axes.csv", *common, "--out", tmp_path / "a/b", "--format", "parquet")
    found = {str(p.relative_to(tmp_path / "a/b")) for p in (tmp_path / "a/b").rglob("*") if p.is_file()}
    plots = {f"plots/all-axes_{name}.png" for name in ("readings", "innovations", "nis", "constants")}
    assert (
        found
        == {"flights/all-axes.parquet", "reconstruction.json", "report.txt", "report.html", "constants.csv"} | plots
    )


def test_the_flights_written_are_nearer_the_truth_and_carried_only_once(flights, written):
    for name, flight in flights.items():
        back = read_recording(written[0] / "flights" / f"{name}.csv")
        for channel in ("V", "alpha", "beta", "phi", "theta"):
            error, before = (
                np.sqrt(np.mean((r[channel] - flight.truth[channel]) ** 2)) for r in (back, flight.measured)
            )
            assert error < 0.3 * before
        again = compute_coefficients(back, flight.aircraft)
        assert_allclose(again["alpha"], back["alpha"], rtol=1e-12)
        # CZ = (m az + T sin i) / (qbar S), of the file's own az: carried twice it would differ.
        force = flight.aircraft.mass * back["az"] + back["thrust"] * np.sin(0.03)
        assert_allclose(again["CZ"], force / (again["qbar"] * flight.aircraft.S), rtol=1e-9)


def test_select_reads_what_was_written_and_can_do_both_steps_by_itself(folder, common, written):
    asked = (
        "--responses",
        "Cm",
        "--terms",
        "alpha,q_hat,de",
        "--include",
        "alpha,q_hat,de",
        "--bootstrap",
        0,
        "--json",
    )
    aircraft = common[:2]
    name = "all-axes.csv"
    stepwise = json.loads(run("select", written[0] / "flights" / name, *aircraft, *asked).stdout)
    at_once = json.loads(run("select", folder / name, *aircraft, "--reconstruct", *asked).stdout)
    plain = json.loads(run("select", folder / name, *aircraft, *asked).stdout)

    def values(held):
        return [row["value"] for row in held["responses"]["Cm"]["parameters"]]

    assert_allclose(values(at_once), values(stepwise), rtol=1e-6)
    assert not np.allclose(values(at_once), values(plain), rtol=1e-3)


def test_what_stands_is_not_overwritten_unless_asked(folder, common, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    arguments = ("reconstruct", folder / "all-axes.csv", *common, "--out", tmp_path, "--no-plots")
    assert "--overwrite" in run(*arguments, code=1).stderr
    run(*arguments, "--overwrite")
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "flights/all-axes.csv").exists()


def test_turbulence_is_printed_and_may_be_given(folder, tmp_path):
    # The instruments of the demonstration's aircraft; what noise they have nobody states.
    demo_aircraft().to_toml(tmp_path / "aircraft.toml")
    write_recording(demo_flight("all-axes", 2, turbulence=1.0, duration=8.0), tmp_path / "rough.csv")
    common = (tmp_path / "rough.csv", "--aircraft", tmp_path / "aircraft.toml", "--workers", 1)
    found = run("reconstruct", *common)
    assert re.search(r"turbulence [\d.]+, [\d.]+, [\d.]+ m/s", found.stdout)
    assert max(map(len, found.stdout.splitlines())) <= 80
    (still,) = json.loads(run("reconstruct", *common, "--gusts", "0", "--json").stdout)["done"]
    assert still["gust"] == [0.0, 0.0, 0.0]
    assert "--gusts" in run("reconstruct", *common, "--gusts", "strong", code=2).stderr


# --- what goes wrong ---------------------------------------------------------------------------------


def test_one_bad_manoeuvre_is_said_and_the_others_are_written(folder, common, tmp_path):
    bad = changed(folder, tmp_path / "bad.csv", "all-axes", lambda data: data.drop(columns="az"))
    result = run("reconstruct", bad, folder / "all-axes.csv", *common, "--out", tmp_path / "out", "--no-plots")
    assert re.search(r"warning: 'bad' was not reconstructed by unscented: .*'az'", result.stderr)
    assert re.search(r"^bad +- +- +NOT RECONSTRUCTED", result.stdout, re.MULTILINE)
    assert [p.name for p in (tmp_path / "out/flights").iterdir()] == ["all-axes.csv"]
    assert "'az'" in json.loads((tmp_path / "out/reconstruction.json").read_text())["failed"]["bad"]


def test_where_none_can_be_reconstructed_the_message_says_why_and_nothing_is_left(folder, common, tmp_path):
    bad = changed(folder, tmp_path / "bad.csv", "all-axes", lambda data: data.drop(columns="az"))
    for options in ((), ("--method", "all")):
        result = run("reconstruct", bad, *common, "--out", tmp_path / "out", *options, code=1)
        assert re.search(r"error: no manoeuvre could be reconstructed.*\n.*'az'", result.stderr)
        assert result.stdout == ""
        assert not (tmp_path / "out").exists()


def test_what_is_not_trusted_is_written_with_its_verdict_everywhere(folder, common, tmp_path):
    # Ten times the noise that the aircraft file states of the angle-of-attack vane.
    rng = np.random.default_rng(5)
    noisy = changed(
        folder,
        tmp_path / "noisy.csv",
        "all-axes",
        lambda data: data.assign(alpha=data.alpha + 0.02 * rng.standard_normal(len(data))),
    )
    result = run("reconstruct", noisy, *common, "--out", tmp_path / "out", "--no-plots")
    assert re.search(r"warning: 'noisy' by unscented is NOT TRUSTED: .*alpha", result.stderr)
    assert re.search(r"^noisy  .*NOT TRUSTED\n! .*alpha", result.stdout, re.MULTILINE)
    held = json.loads((tmp_path / "out/reconstruction.json").read_text())
    assert held["done"][0]["trusted"] is False
    assert not pd.read_csv(tmp_path / "out/constants.csv").trusted.any()
    assert (tmp_path / "out/flights/noisy.csv").exists()


@pytest.mark.parametrize("delays", ["soon", "alpha=soon", "alpha", "alpha=0.1,beta", ""])
def test_delays_that_cannot_be_read_exit_with_2(folder, common, delays):
    assert "NAME=NUMBER" in run("reconstruct", folder, *common, "--delays", delays, code=2).stderr


def test_a_constant_of_unknown_name_is_refused_with_those_there_are(folder, common):
    printed = run("reconstruct", folder / "all-axes.csv", *common, "--estimate", "bx", code=1).stderr
    assert "'bx'" in printed
    assert "bax" in printed


def test_reconstruct_before_select_needs_an_aircraft(folder):
    arguments = ("--responses", "V", "--terms", "alpha", "--reconstruct")
    assert "--aircraft" in run("select", folder / "all-axes.csv", *arguments, code=2).stderr


def test_the_aircraft_of_these_tests_is_the_one_that_flew(flights, folder):
    assert Aircraft.from_toml(folder / "aircraft.toml").noise == flights["all-axes"].aircraft.noise
