"""Figures of recordings show the recorded channels in customary units, and print as lines."""

from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from structsel import AeroModel, Recording
from structsel.comparison.locating.coherence import Coherence
from structsel.errors import ChannelError, DomainError
from structsel.model import ResponseModel
from structsel.numerics.spectra import coherence
from structsel.plotting import (
    plot_coherence,
    plot_coverage,
    plot_flight,
    plot_histories,
    plot_mismatch_coherence,
    plot_spectrum,
)


def flight(name, seed, *, at=0.1, n=1500):
    rng = np.random.default_rng(seed)
    t = 0.02 * np.arange(n)
    alpha, beta = at + 0.05 * np.sin(t), 0.02 * np.cos(1.7 * t)
    q = 0.1 * np.sin(2.0 * np.pi * 2.0 * t)
    V, h = 60.0 + t, 1000.0 - 2.0 * t
    load = rng.standard_normal(n)
    return Recording(name, t, {"alpha": alpha, "beta": beta, "q": q, "V": V, "h": h, "load": load}, {"load": "N"})


def test_accounts_of_one_flight_stand_over_each_other_in_degrees(ax):
    measured, simulated = flight("a", 1), flight("a", 1, at=0.12)
    plot_histories({"measured": measured, "simulated": simulated}, "alpha", ax=ax)
    first, second = ax.get_lines()
    assert_allclose(first.get_ydata(), np.rad2deg(measured["alpha"]))
    assert_allclose(second.get_ydata(), np.rad2deg(simulated["alpha"]))
    assert (first.get_label(), second.get_label()) == ("measured", "simulated")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", r"$\alpha$ [deg]")


def test_an_account_without_the_channel_is_left_out_and_none_is_an_error(ax):
    other = Recording("b", np.arange(3.0), {"V": np.ones(3)})
    plot_histories({"measured": other, "reconstructed": flight("a", 1)}, "alpha", ax=ax)
    assert [line.get_label() for line in ax.get_lines()] == ["reconstructed"]
    with pytest.raises(ChannelError, match="plot_histories needs channel 'alpha'"):
        plot_histories({"measured": other}, "alpha", ax=ax)


def test_coverage_encloses_the_recorded_conditions_in_their_hull_and_shows_the_models_box(ax):
    recordings, beyond = [flight("a", 1), flight("b", 2)], [flight("c", 3, at=0.3)]
    region = {"alpha": (0.05, 0.15), "beta": (-0.02, 0.02)}
    model = AeroModel({"CZ": ResponseModel(("1", "alpha", "beta"), np.zeros(3), ranges=region)})
    plot_coverage(recordings, held_out=beyond, model=model, ax=ax)
    hull, box = ax.patches
    corners = np.asarray(hull.get_xy())
    assert_allclose(corners.max(axis=0), np.rad2deg([0.15, 0.02]), rtol=1e-3)
    assert_allclose([box.get_x(), box.get_y()], np.rad2deg([0.05, -0.02]))
    assert_allclose([box.get_width(), box.get_height()], np.rad2deg([0.10, 0.04]))
    assert_allclose(ax.get_lines()[2].get_xdata(), np.rad2deg(beyond[0]["alpha"]))
    assert (ax.get_xlabel(), ax.get_ylabel()) == (r"$\alpha$ [deg]", r"$\beta$ [deg]")


def test_airspeed_and_height_along_one_line_enclose_nothing(ax):
    plot_coverage(flight("a", 1), "V", "h", ax=ax)
    assert not ax.patches
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("$V$ [m/s]", "$h$ [m]")


def test_a_spectrum_peaks_where_the_motion_is(ax):
    plot_spectrum([flight("a", 1), flight("b", 2)], ["q"], segment=5.0, ax=ax)
    f, density = ax.get_lines()[0].get_data()
    assert_allclose(f[np.argmax(density)], 2.0)
    assert_allclose(np.sum(density) * (f[1] - f[0]), np.rad2deg(0.1) ** 2 / 2.0, rtol=1e-2)
    assert ax.get_ylabel() == "power spectral density [(deg/s)$^2$/Hz]"
    with pytest.raises(DomainError, match="no piece is as long"):
        plot_spectrum(flight("a", 1), "q", segment=100.0, ax=ax)


def test_spectra_of_different_units_claim_none(ax):
    assert plot_spectrum(flight("a", 1), ["q", "load"], ax=ax).get_ylabel() == "power spectral density"


def test_coherence_has_a_line_for_each_input_and_one_for_probability(ax):
    recordings = [flight(name, k) for k, name in enumerate("abc")]
    with_output = [r.with_channels(out=0.5 * r["load"] + 0.1 * r["V"], units={"out": "N"}) for r in recordings]
    plot_coherence(with_output, ["load", "q"], "out", segment=2.0, ax=ax)
    one, _, probability = ax.get_lines()
    _, squared, threshold = coherence([r["load"] for r in with_output], [r["out"] for r in with_output], 0.02, 2.0)
    assert_allclose(one.get_ydata(), squared)
    assert squared.min() > 0.99  # a gain and a linear trend, which are removed from each segment
    assert_allclose(probability.get_ydata(), threshold)


def test_a_residual_is_drawn_with_the_channels_of_highest_coherence(ax):
    f = np.linspace(0.1, 2.0, 20)
    found = [Coherence("CZ", c, f, np.full(20, s), 0.4, s, 1.0, np.nan) for c, s in (("de", 0.8), ("alpha", 0.1))]
    mismatch = SimpleNamespace(coherences=(*found, Coherence("Cm", "de", f, f, 0.4, 0.3, 1.0, np.nan)))
    plot_mismatch_coherence(mismatch, "CZ", ax=ax)
    lines = ax.get_lines()
    assert_allclose([line.get_ydata()[0] for line in lines], [0.8, 0.1, 0.4])
    assert "80 % of the power" in lines[0].get_label()
    assert "no coherence" in plot_mismatch_coherence(mismatch, "Cn", ax=Figure().add_subplot()).texts[0].get_text()


@pytest.mark.parametrize(("kind", "begins"), [("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_figures_go_to_paper_as_vectors(tmp_path, kind, begins):
    figure = Figure(layout="constrained")
    panels = figure.subplots(1, 2)
    plot_coverage([flight("a", 1), flight("b", 2, at=0.2)], ax=panels[0])
    plot_spectrum(flight("a", 1), "q", ax=panels[1])
    path = tmp_path / f"figure.{kind}"
    figure.savefig(path)
    assert path.read_bytes().startswith(begins)
    # Clouds of dots are a picture inside; lines and letters are not.
    assert path.stat().st_size < 400_000


def test_a_simulated_flight_alone_has_its_axes_and_lines_labelled():
    plt.close("all")
    ax = plot_flight(flight("a", 1, at=0.12), "alpha", recorded=flight("a", 1))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", r"$\alpha$ [deg]")
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["recorded", "simulated"]
    plt.close("all")
