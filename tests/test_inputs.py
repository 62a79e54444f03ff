"""Inputs: their shapes and energies, multisines, and the information matrix."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy import signal

from structsel.errors import DataError, DomainError, ModelError
from structsel.inputs import (
    combine,
    doublet,
    energy,
    frequency_sweep,
    impulse,
    information,
    multisine,
    multistep,
    peak_factor,
    step,
    table,
    three_two_one_one,
    two_one_one_one,
    with_energy,
)
from structsel.simulation.library.linear import as355, hawk

# Signals


def test_a_3211_holds_each_pulse_for_its_units_and_ends_at_zero():
    u = three_two_one_one("de", 0.1, 0.5, start=1.0, duration=6.0, dt=0.1)
    assert_allclose(u["de"], np.repeat([0, 1, -1, 1, -1, 0], [10, 15, 10, 5, 5, 16]) * 0.1)
    assert_allclose(two_one_one_one("de", 0.1, 0.5, dt=0.1)["de"].sum(), 0.1 * 5 * (2 - 1 + 1 - 1))


@given(amplitude=st.floats(0.01, 1.0), width=st.floats(0.1, 2.0))
def test_a_doublet_has_no_mean_and_twice_the_energy_of_one_pulse(amplitude, width):
    u = doublet("de", amplitude, width, duration=10.0, dt=0.05)
    assert_allclose(u["de"].sum(), 0.0, atol=1e-12)
    assert_allclose(energy(u), 2 * amplitude**2 * 0.05 * round(width / 0.05), rtol=1e-12)


def test_an_impulse_carries_its_area_whatever_the_sampling():
    for dt in (0.01, 0.05):
        assert_allclose(impulse("da", 0.3, dt=dt)["da"].sum() * dt, 0.3)


def test_a_table_is_linear_between_points_and_jumps_where_two_have_one_time():
    points = [(0, 0), (1, 2), (1, -1), (2, -1), (3, 0)]
    assert_allclose(table("de", points, dt=0.5)["de"], [0, 1, -1, -1, -1, -0.5, 0])
    assert_allclose(table("de", points, between="hold", dt=0.5)["de"], [0, 0, -1, -1, -1, -1, 0])
    assert_allclose(table("de", points, duration=4.0, dt=1.0)["de"], [0, -1, -1, 0, 0])
    with pytest.raises(DataError, match="time falls after row 1, from 2 to 1 s"):
        table("de", [(0, 0), (2, 1), (1, 0)])


@pytest.mark.parametrize("law", ["linear", "log"])
def test_a_sweep_is_scipys_chirp(law):
    u = frequency_sweep("de", 0.1, 0.2, 3.0, law=law, start=0.0, duration=10.0, dt=0.01)
    method = "logarithmic" if law == "log" else "linear"
    assert_allclose(u["de"], 0.1 * signal.chirp(u.t, 0.2, 10.0, 3.0, method, phi=-90), atol=1e-9)


def test_scaling_to_an_energy_keeps_the_shape():
    u = combine(doublet("da", 0.1), step("dr", 0.3))
    scaled = with_energy(u, 0.7, {"da": 0.1})
    assert_allclose(energy(scaled, {"da": 0.1}), 0.7)
    assert_allclose(scaled["da"] * u["dr"].max(), u["da"] * scaled["dr"].max())
    with pytest.raises(DomainError, match="zero throughout"):
        with_energy(step("de", 0.0), 1.0)


def test_pulses_that_do_not_fit_and_clocks_that_differ_are_refused():
    with pytest.raises(DomainError, match="runs from 1 to 15 s, the record from 0 to 10 s"):
        three_two_one_one("de", 0.1, 2.0, duration=10.0)
    with pytest.raises(DomainError, match="shorter than a sample"):
        multistep("de", 0.1, (1, -0.01), 0.1)
    with pytest.raises(DataError, match="needs one clock"):
        combine(doublet("da", 0.1), doublet("dr", 0.1, duration=10.0))


# Multisines


def test_multisines_of_several_inputs_are_orthogonal_and_flat_and_begin_at_zero():
    u = multisine(("de", "da", "dr"), (0.1, 0.2, 0.3), low=0.1, high=2.0, period=20.0, dt=0.02, periods=2)
    one = np.array([u[c][:1000] for c in u.names])
    assert_allclose(one @ one.T / 1000, np.diag(np.diag(one @ one.T)) / 1000, atol=1e-15)
    spectra = np.abs(np.fft.rfft(one, axis=1)) > 1e-6 * 1000 * 0.1
    lines = [set(np.flatnonzero(s)) for s in spectra]
    assert lines[0] == set(range(2, 41, 3))
    assert not lines[0] & lines[1]
    assert not lines[1] & lines[2]
    for row, peak in zip(one, (0.1, 0.2, 0.3)):
        assert_allclose(np.abs(row).max(), peak)
        assert_allclose(row[0], 0.0, atol=1e-9)
        # In step, n cosines have about sqrt(n) = 3.6; a single sine has 1.
        assert peak_factor(row) < 1.15
    assert_allclose(u["de"][1000:2000], u["de"][:1000])


def test_the_peak_factor_of_a_sine_is_one_and_of_a_square_wave_its_root_half():
    x = 2 * np.pi * np.arange(4000) / 4000
    assert_allclose(peak_factor(np.sin(x)), 1.0, rtol=1e-12)
    assert_allclose(peak_factor(np.sign(np.sin(x + 1e-6))), np.sqrt(0.5), rtol=1e-12)


def test_a_multisine_keeps_the_powers_it_is_given():
    u = multisine("de", 1.0, low=0.1, high=0.3, period=10.0, dt=0.05, powers=(4, 1, 0))
    lines = np.abs(np.fft.rfft(u["de"][:-1]))
    assert_allclose(lines[1] / lines[2], 2.0, rtol=1e-9)
    assert lines[3:].max() < 1e-9 * lines[1]
    with pytest.raises(DomainError, match=r"2 harmonics of 0.1 Hz lie between 0.1 and 0.2 Hz for 3 inputs"):
        multisine(("de", "da", "dr"), 0.1, low=0.1, high=0.2, period=10.0)


# Information


def test_the_information_matrix_is_that_of_brute_force_differences():
    model, u = as355("80kt", x_boom=3.0), doublet("dlon", 1.0, duration=8.0)
    noise = {"alpha": 0.01, "q": 0.02, "ax": 0.1, "az": 0.2, "theta": 0.01}
    names = ("Xu", "Zw", "Mq", "Md", "tau", "K_alpha", "bias_w", "ref_az")
    got = information(model, u, noise=noise, parameters=names, hold="linear")
    columns = []
    for name in names:
        h = 1e-5
        up, down = (
            model.with_parameters({name: model.parameters[name] + d}).simulate(u, hold="linear") for d in (h, -h)
        )
        columns.append(np.concatenate([(up[o] - down[o]) / (2 * h * std) for o, std in noise.items()]))
    S = np.array(columns).T
    size = np.linalg.norm(S, axis=0)
    assert_allclose(got.matrix / np.outer(size, size), (S / size).T @ (S / size), atol=1e-6)
    assert_allclose(got.crlb, np.sqrt(np.diag(np.linalg.inv(S.T @ S))), rtol=1e-4)


def test_an_input_that_excites_nothing_names_the_parameters():
    model = hawk("lateral")
    aileron_only = doublet("da", 0.05).with_channels(dr=0.0)
    noise = {"v": 0.3, "p": 0.01, "r": 0.01}
    found = information(model, aileron_only, noise=noise)
    with pytest.warns(DeprecationWarning, match="use unidentifiable instead"):
        assert found.unseen == found.unidentifiable
    assert found.unidentifiable == tuple(f"{n} does not affect the measured outputs" for n in ("ydr", "ldr", "ndr"))
    assert np.isnan(found.crlb).all()
    with pytest.raises(ModelError, match=r"'doublet' does not determine all of yv.*\n  ydr does not affect"):
        found.require()
    still = information(model, step("da", 0.0).with_channels(dr=0.0), noise=noise, parameters=["lp", "lda"])
    assert len(still.unidentifiable) == 2


def test_parameters_that_act_alike_are_named_together():
    held = as355()
    biased = information(
        held,
        doublet("dlon", 1.0, duration=8.0),
        noise={"theta": 0.01},
        parameters=["ref_theta", "ref_q", "Md", "Mq"],
    )
    assert biased.unidentifiable == ("ref_q does not affect the measured outputs",)
    scaled = information(
        held, doublet("dlon", 1.0, duration=8.0), noise={"alpha": 0.01}, parameters=["Md", "Zd", "Xd", "K_alpha"]
    )
    assert scaled.unidentifiable == (
        "Md, Zd, Xd, K_alpha have the same effect: only a combination of them is determined",
    )


# Optimal inputs
