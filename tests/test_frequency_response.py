"""Frequency responses agree with scipy.signal and with known systems; transfer functions find poles and delay."""

from dataclasses import replace

import control
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from scipy import signal
from scipy.stats import chi2

import structsel as ss
from structsel.errors import ChannelError, DataError, DomainError, ModelError
from structsel.frequency_domain.forms import FORMS, read_form
from structsel.numerics.frequency_response import condition, multiple_coherence
from structsel.numerics.linear_systems import simulate_linear
from structsel.numerics.spectra import spectral_matrix
from structsel.plotting import draw_frequency_response, plot_bode
from tests.commands import run
from tests.figures import assert_nothing_outside

DT = 0.02
ZETA, OMEGA, TTHETA2, GAIN, DELAY = 0.45, 3.0, 1.2, -8.0, 0.08
TRUTH = {"K": GAIN, "1/Ttheta2": TTHETA2, "zeta": ZETA, "omega": OMEGA, "tau": DELAY + DT / 2}
"""Of q/de. The elevator is held over each sample, which delays it by half an interval."""
SHORT_PERIOD = control.tf([GAIN, GAIN * TTHETA2], [1.0, 2.0 * ZETA * OMEGA, OMEGA**2])


def sweep(rng, duration=60.0, low=0.3, high=12.0):
    """Elevator sweep [rad] that begins and ends at trim, and some movement besides."""
    t = DT * np.arange(round(duration / DT))
    rate = low * (high / low) ** np.clip((t - 3.0) / (duration - 6.0), 0.0, 1.0)
    ends = np.clip(t / 3.0, 0.0, 1.0) * np.clip((duration - t) / 3.0, 0.0, 1.0)
    noise = np.convolve(rng.standard_normal(t.size), np.ones(10) / 10.0, "same")
    return t, 0.03 * np.sin(np.cumsum(rate) * DT) * ends + 0.004 * noise


def sweeps(seed, noise=0.02, count=3, delay=DELAY):
    """Recordings of a pitch rate that follows SHORT_PERIOD and a delay, with white noise."""
    A, B, C, D = (np.asarray(a) for a in control.ssdata(control.ss(SHORT_PERIOD)))
    made = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        t, de = sweep(rng)
        q = simulate_linear(A, B, C, D, de[:, None], DT, delay=delay)[:, 0]
        made.append(ss.Recording(f"sweep{k}", t, {"de": de, "q": q + noise * rng.standard_normal(t.size)}))
    return made


def true_response(omega):
    """From python-control, with the delays of the actuator and of held inputs."""
    return control.frequency_response(SHORT_PERIOD, omega).complex.ravel() * np.exp(-1j * omega * TRUTH["tau"])


# --- spectra -------------------------------------------------------------------------------------


@pytest.mark.parametrize("overlap", [0.5, 0.8])
def test_spectra_are_those_of_scipy_where_their_frequencies_coincide(overlap):
    rng = np.random.default_rng(1)
    x = rng.standard_normal((1000, 2))
    x[:, 1] += signal.lfilter([0.5], [1.0, -0.7], x[:, 0])
    f, expected = signal.csd(x[:, 0], x[:, 1], 1.0 / DT, nperseg=200, noverlap=int(200 * overlap), detrend="linear")
    found = spectral_matrix([x], DT, 200 * DT, 2.0 * np.pi * f[1:-1], overlap)
    assert_allclose(found.density[:, 0, 1], expected[1:-1], rtol=1e-9, atol=1e-12)
    _, coherence = signal.coherence(
        x[:, 0], x[:, 1], 1.0 / DT, nperseg=200, noverlap=int(200 * overlap), detrend="linear"
    )
    assert_allclose(condition(found, 1).coherence[:, 0, 0], coherence[1:-1], rtol=1e-9)


def test_independent_segments_of_random_signals_are_those_of_welch():
    # Hann, overlap of one half: rho_1 = 1/6, so K / (1 + 2/36 (1 - 1/K)) segments in the mean.
    x = np.random.default_rng(2).standard_normal((200_000, 2))
    found = condition(spectral_matrix([x], 1.0, 200.0, np.linspace(0.5, 2.5, 40), 0.5), 1)
    assert_allclose(found.independent.mean(), 1999.0 / (1.0 + 2.0 / 36.0), rtol=0.01)


def test_conditioning_gives_the_solution_for_all_inputs_at_once():
    rng = np.random.default_rng(3)
    u = rng.standard_normal((4000, 3)) @ rng.standard_normal((3, 3))
    y = np.column_stack([signal.lfilter([1.0], [1.0, -0.5], u[:, 0]) + u[:, 1], u[:, 2] - u[:, 0]])
    spectra = spectral_matrix([np.column_stack([u, y])], DT, 4.0, np.array([2.0, 5.0, 20.0]))
    S = spectra.density
    direct = np.linalg.solve(S[:, :3, :3], S[:, :3, 3:])
    assert_allclose(condition(spectra, 3).response, np.swapaxes(direct, 1, 2), rtol=1e-7, atol=1e-9)
    assert_allclose(multiple_coherence(spectra, 3), 1.0, atol=5e-3)


# --- frequency responses -------------------------------------------------------------------------


def test_the_response_of_a_known_system_lies_within_its_random_errors():
    z = []
    for seed in range(8):
        found = ss.frequency_response(sweeps(seed), "q", "de", band=(0.5, 10.0), points=25)
        error = found.response[:, 0, 0] / true_response(found.omega) - 1.0
        z += [error.real / found.random_error[:, 0, 0], error.imag / found.random_error[:, 0, 0]]
    within = np.mean(np.abs(z) < 1.96)
    assert 0.93 < within <= 1.0
    assert np.sqrt(np.mean(np.square(z))) > 0.5  # the errors are not stated far too large


def test_correlated_inputs_are_separated_and_a_single_one_would_mislead():
    rng = np.random.default_rng(5)
    t = DT * np.arange(12_000)
    da = np.convolve(rng.standard_normal(t.size), np.ones(5) / 5.0, "same")
    dr = 0.6 * da + np.convolve(rng.standard_normal(t.size), np.ones(5) / 5.0, "same")
    lag = {name: signal.lfilter([0.1], [1.0, -0.9], u) for name, u in (("da", da), ("dr", dr))}
    flight = ss.Recording("two", t, {"da": da, "dr": dr, "p": 2.0 * lag["da"] - 1.0 * lag["dr"]})
    options = {"band": (1.0, 10.0), "windows": (10.0,), "points": 20}
    z = np.exp(1j * DT * np.geomspace(1.0, 10.0, 20))
    one = 0.1 / (1.0 - 0.9 / z)
    both = ss.frequency_response(flight, "p", ["da", "dr"], **options)
    assert_allclose(both.response[:, 0, 0], 2.0 * one, rtol=0.06)
    assert_allclose(both.response[:, 0, 1], -one, rtol=0.12)
    assert both.coherence.min() > 0.9
    assert both.multiple_coherence.min() > 0.97  # windows of 10 s cut off the response of 0.2 s at their ends
    alone = ss.frequency_response(flight, "p", "da", **options)
    assert np.abs(alone.response[:, 0, 0] / one - 1.4).max() < 0.4  # 2 - 0.6: the rudder's part is in it
    assert alone.coherence.max() < 0.85


def test_a_composite_has_smaller_errors_at_high_frequencies_and_keeps_low_ones():
    flights = sweeps(3)
    longest = ss.frequency_response(flights, "q", "de", band=(0.5, 10.0), windows=(30.0,))
    composite = ss.frequency_response(flights, "q", "de", band=(0.5, 10.0), windows=(30.0, 15.0, 6.0))
    high = longest.omega > 7.0
    assert composite.random_error[high].mean() < 0.85 * longest.random_error[high].mean()
    assert_allclose(composite.response[:20], longest.response[:20], rtol=0.02)
    assert_allclose(composite.window[0, 0, 0], 30.0)
    assert composite.window[-1, 0, 0] < 20.0


def test_a_sweep_that_starts_at_the_first_sample_needs_its_ends_held():
    # The first seconds have the lowest frequencies, and the Hann window all but removes them.
    error = {}
    for hold in (True, False):
        found = [ss.frequency_response(sweeps(seed), "q", "de", band=(0.42, 0.6), points=5, hold_ends=hold)
                 for seed in range(6)]  # fmt: skip
        error[hold] = np.mean([np.angle(r.response[:, 0, 0] / true_response(r.omega)) for r in found])
    assert abs(error[True]) < 0.5 * abs(error[False])


def test_what_cannot_be_used_is_refused_with_its_name():
    (flight,) = sweeps(0, count=1)
    with pytest.raises(ChannelError, match="'q' is both output and input"):
        ss.frequency_response(flight, ["q"], ["de", "q"])
    with pytest.raises(ChannelError, match="needs channel 'az'"):
        ss.frequency_response(flight, "az", "de")
    with pytest.raises(DomainError, match="no piece is as long as a window of 80 s; the longest has 60 s"):
        ss.frequency_response(flight, "q", "de", windows=(80.0,), band=(1.0, 5.0))
    with pytest.raises(DomainError, match="below the Nyquist frequency"):
        ss.frequency_response(flight, "q", "de", band=(1.0, 500.0))
    coarse = ss.Recording("coarse", 0.04 * np.arange(500), {"q": np.zeros(500), "de": np.zeros(500)})
    with pytest.raises(DataError, match="one sampling interval"):
        ss.frequency_response([flight, coarse], "q", "de")
    with pytest.raises(ChannelError, match="no frequency response of 'p' to 'de'"):
        ss.frequency_response(flight, "q", "de").magnitude_db("p", "de")


# --- transfer functions --------------------------------------------------------------------------


def distances(seeds):
    """Squared distances of the five parameters from the truth by their covariance; chi-squared of 5 if it is right."""
    found = []
    for seed in seeds:
        fit = ss.fit_transfer_function(ss.frequency_response(sweeps(seed), "q", "de"), "short-period")
        places = [fit.names.index(name) for name in TRUTH]
        error = fit.values[places] - list(TRUTH.values())
        found.append(error @ np.linalg.solve(fit.covariance[np.ix_(places, places)], error))
    return np.array(found)


def test_poles_zero_gain_and_delay_lie_within_their_bounds():
    # Each below the 99.95 % point of chi-squared of 5; the mean of six within three of its standard deviations.
    found = distances(range(6))
    assert found.max() < chi2.ppf(0.9995, 5)
    assert 5.0 - 3.0 * np.sqrt(10.0 / 6.0) < found.mean() < 5.0 + 3.0 * np.sqrt(10.0 / 6.0)


@pytest.mark.slow
def test_the_covariance_of_the_parameters_is_that_of_their_errors():
    # The mean of 40 within four standard deviations of that of chi-squared of 5; 5.6 on other seeds.
    assert abs(distances(range(100, 140)).mean() - 5.0) < 4.0 * np.sqrt(10.0 / 40.0)


def test_the_published_short_period_of_the_hawk_is_found_in_sweeps():
    # [C89], longitudinal matrices at 105.5 m/s; the short period published there is -1.512 +- 2.231i.
    A = np.array(
        [[-0.016, 0.026, 0.0, -9.81], [-0.217, -1.342, 105.5 - 1.379, 0.0], [-0.005, -0.048, -1.669, 0.0], [0, 0, 1, 0]]
    )
    B, C, D = np.array([[0.0], [-21.849], [-19.527], [0.0]]), np.array([[0.0, 0.0, 1.0, 0.0]]), np.zeros((1, 1))
    flights = []
    for k in range(3):
        rng = np.random.default_rng([2, k])
        t, de = sweep(rng)
        q = simulate_linear(A, B, C, D, 0.5 * de[:, None], DT, delay=0.05)[:, 0]
        flights.append(ss.Recording(f"h{k}", t, {"de": 0.5 * de, "q": q + 0.005 * rng.standard_normal(t.size)}))
    fit = ss.fit_transfer_function(ss.frequency_response(flights, "q", "de", band=(0.6, 12.0)), "short-period")
    published = complex(-1.512, 2.231)
    truth = {"omega": abs(published), "zeta": -published.real / abs(published), "tau": 0.05 + DT / 2}
    for name, value in truth.items():
        assert abs(fit[name][0] - value) < 3.0 * fit[name][1]
        assert fit[name][1] < 0.02 * value


def test_the_fit_of_an_exact_response_is_the_system_itself():
    response = ss.frequency_response(sweeps(0), "q", "de", band=(0.5, 10.0))
    response = replace(response, response=true_response(response.omega)[:, None, None])
    fit = ss.fit_transfer_function(response, "short-period", band=(0.5, 10.0))
    for name, value in TRUTH.items():
        assert_allclose(fit[name][0], value, rtol=1e-5)
    assert fit.costs[0] < 1e-8
    poles = np.sort_complex(control.poles(SHORT_PERIOD))
    assert_allclose(np.sort_complex(fit.poles()), poles, rtol=1e-5)
    assert_allclose(np.sort_complex(ss.fit_transfer_function(response, (1, 2)).poles()), poles, rtol=1e-4)
    assert_allclose(fit.zeros(), [-TTHETA2], rtol=1e-5)
    assert_allclose(fit.evaluate(response.omega), true_response(response.omega), rtol=1e-4)


def test_the_cost_is_the_published_one():
    # At a coherence of one, 1 dB everywhere costs 20 (1.58 (1 - 1/e))^2, and 7.57 deg as much.
    response = ss.frequency_response(sweeps(0), "q", "de", band=(0.5, 10.0))
    for factor in (10.0 ** (1.0 / 20.0), np.exp(1j * np.deg2rad(7.57))):
        wrong = factor * true_response(response.omega)[:, None, None]
        shifted = replace(response, response=wrong, coherence=np.ones_like(response.coherence))
        fit = ss.fit_transfer_function(shifted, "short-period", band=(0.5, 10.0), held=TRUTH)
        assert_allclose(fit.costs[0], 20.0 * (1.58 * (1.0 - np.exp(-1.0))) ** 2, rtol=1e-3)


def test_responses_with_common_poles_are_fitted_at_once():
    flights = []
    for k, flight in enumerate(sweeps(4, noise=0.01)):
        rng = np.random.default_rng([9, k])
        plant = control.tf([-3.0], [1.0, 2.0 * ZETA * OMEGA, OMEGA**2])
        A, B, C, D = (np.asarray(a) for a in control.ssdata(control.ss(plant)))
        alpha = simulate_linear(A, B, C, D, flight["de"][:, None], DT)[:, 0]
        flights.append(flight.with_channels(alpha=alpha + 0.002 * rng.standard_normal(len(flight))))
    response = ss.frequency_response(flights, ["q", "alpha"], "de")
    fit = ss.fit_transfer_function(response, {"q/de": "short-period", "alpha/de": "second-order"})
    assert fit.names == ("K q/de", "K alpha/de", "1/Ttheta2", "zeta", "omega", "tau q/de", "tau alpha/de")
    truth = (GAIN, -3.0, TTHETA2, ZETA, OMEGA, TRUTH["tau"], DT / 2)
    assert (np.abs(fit.values - truth) / fit.std).max() < 3.5
    assert_allclose(fit.poles(("q", "de")), fit.poles(("alpha", "de")))
    alone = ss.fit_transfer_function(response, {"q/de": "short-period"})
    assert fit["zeta"][1] < alone["zeta"][1]


def test_a_form_that_is_too_simple_is_doubted_and_a_held_parameter_stays():
    response = ss.frequency_response(sweeps(1), "q", "de")
    poor = ss.fit_transfer_function(response, "roll")
    assert any("above 100" in doubt for doubt in poor.doubts)
    held = ss.fit_transfer_function(response, "short-period", held={"1/Ttheta2": 1.2})
    assert held["1/Ttheta2"] == (1.2, 0.0)
    assert "held" in str(held)
    with pytest.raises(ModelError, match=r"'zta', which is no parameter\. Did you mean 'zeta'"):
        ss.fit_transfer_function(response, "short-period", held={"zta": 0.5})


@pytest.mark.parametrize("name", FORMS)
def test_every_named_form_can_be_read(name):
    form = read_form(name)
    assert any(factor.power < 0 for factor in form.factors)


@pytest.mark.parametrize(
    ("form", "message"),
    [
        ("short-perod", "Did you mean 'short-period'"),
        ("(a)", "has no pole"),
        ("(a) / (a)", "names a parameter twice"),
        ("/ [zeta]", "wrong parameters"),
        ((3, 2), "not more zeros than poles"),
    ],
)
def test_a_form_that_cannot_be_used_is_refused(form, message):
    with pytest.raises(ModelError, match=message):
        read_form(form)


# --- figures, files, commands --------------------------------------------------------------------


def test_a_bode_plot_has_degrees_decibels_and_the_fit():
    flights = [flight.with_channels(az=10.0 * flight["q"]) for flight in sweeps(0)]
    response = ss.frequency_response(flights, ["q", "az"], "de")
    fit = ss.fit_transfer_function(response, "short-period")
    figure = Figure(figsize=(6.5, 6.5), layout="constrained")
    magnitude, phase, coherence = plot_bode(response, "q", "de", fit=fit, ax=figure)
    assert magnitude.get_ylabel() == r"$q$/$\delta_e$ [dB of deg/s per deg]"
    assert phase.get_ylabel() == "phase [deg]"
    assert coherence.get_xlabel() == "frequency [rad/s]"
    assert_allclose(magnitude.get_lines()[0].get_ydata(), 20.0 * np.log10(np.abs(response.response[:, 0, 0])))
    # One m/s^2 per rad is pi/180 m/s^2 per deg.
    shown = 20.0 * np.log10(np.abs(response.response[:, 1, 0]) * np.pi / 180.0)
    assert_allclose(response.magnitude_db("az", "de"), shown)
    assert_nothing_outside(figure)
    names = [name for name, _ in draw_frequency_response(response, fit)]
    assert names == ["q_de", "az_de"]


def test_the_command_prints_responses_and_a_fit_and_writes_them(tmp_path):
    for flight in sweeps(0):
        ss.write_recording(flight, tmp_path / f"{flight.name}.csv")
    out = tmp_path / "out"
    files = sorted(tmp_path.glob("*.csv"))
    done = run("frequency-response", *files, "--outputs", "q", "--inputs", "de", "--fit", "q/de=short-period",
               "--out", out)  # fmt: skip
    assert "q/de [deg/s per deg]" in done.stdout
    assert "omega" in done.stdout
    assert {p.name for p in out.iterdir()} == {"frequency_response.csv", "frequency_response.json", "plots"}
    assert [p.name for p in (out / "plots").iterdir()] == ["q_de.png"]
    assert "is not of the form" in run(
        "frequency-response", files[0], "--outputs", "q", "--inputs", "de", "--fit", "short-period", code=2
    ).output.replace("\n", " ")
