import itertools
from math import comb

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import cont2discrete, lfilter

from structsel.candidates import Term
from structsel.demo import FLIGHTS, INSTRUMENT_ERRORS, TRUTH, demo_aircraft, demo_flight, demo_flights, demo_instruments
from structsel.errors import DomainError
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data_at_cg, body_velocity
from structsel.numerics.differentiation import differentiate
from tests.flights import cases


def test_flights_follow_from_the_seed_alone():
    one, _, _ = demo_flights(2, seed=3, duration=3.0)
    again, _, _ = demo_flights(3, seed=3, duration=3.0)
    other, _, _ = demo_flights(2, seed=4, duration=3.0)
    for name in one[1].names:
        assert_allclose(one[1][name], again[1][name], rtol=1e-9, atol=1e-9, err_msg=name)
    assert np.abs(one[1]["alpha"] - other[1]["alpha"]).max() > 1e-3


def test_a_flight_is_called_by_name_or_number():
    by_name = demo_flight("bank-to-bank", duration=2.0)
    by_number = demo_flight(FLIGHTS.index("bank-to-bank"), duration=2.0)
    assert_allclose(by_name["phi"], by_number["phi"], rtol=0, atol=0)
    with pytest.raises(DomainError, match="no demonstration flight 'loop'; there are elevator-3211"):
        demo_flight("loop")


def test_flights_begin_trimmed_and_stay_where_the_aerodynamics_hold():
    recordings, aircraft, _ = demo_flights(turbulence=0.0, noise=0.0)
    for r in recordings:
        quiet = r.t < 0.9
        assert np.abs(r["q"][quiet]).max() < 1e-9
        assert np.ptp(r["h"][quiet]) < 1e-6
        assert r["alpha"].max() < 0.35
        assert r["V"].min() > 28.0
        assert np.abs(r["phi"]).max() < 1.0
        assert not r.check().findings or all(f.severity == "note" for f in r.check().findings)
    assert aircraft.mass == pytest.approx(2288.231)


def test_a_flights_states_and_accelerations_are_one_motion():
    # Derivatives of the states against the kinematics, between two commands (the pilot's steps bend the
    # rates within a sample); instruments read at their own places.
    calm = demo_flight("all-axes", turbulence=0.0, noise=0.0, exact_derivatives=True, duration=8.0)
    free = (calm.t > 5.0) & (calm.t < 5.9)
    rates, turning = (calm["p"], calm["q"], calm["r"]), (calm["p_dot"], calm["q_dot"], calm["r_dot"])
    turned = rb.euler_rates(*rates, calm["phi"], calm["theta"])
    for name, derivative in zip(("phi", "theta", "psi", "p", "q", "r"), (*turned, *turning)):
        assert_allclose(differentiate(calm[name], 0.02)[free], derivative[free], atol=1e-5, err_msg=name)
    aircraft = demo_aircraft()
    air = air_data_at_cg(calm["V"], calm["alpha"], calm["beta"], *rates, aircraft.position("vane"))
    velocity = body_velocity(*air)
    felt = rb.acceleration_at_cg(calm["ax"], calm["ay"], calm["az"], rates, turning, aircraft.position("accelerometer"))
    slope = rb.velocity_derivative(velocity, rates, felt, calm["phi"], calm["theta"])
    for component, derivative in zip(velocity, slope):
        assert_allclose(differentiate(component, 0.02)[free], derivative[free], atol=1e-5)


# ---------------------------------------------------------------- flights with known instrument errors


PATH = ("u", "v", "w", "phi", "theta", "psi", "x", "y", "h")


def integrated(record, wind, bent):
    """Fourth-order Runge-Kutta over the kinematics, written out.

    Accelerations are linear between samples; the rates too, or where `bent` as their recorded derivatives bend them.
    """
    inputs = np.array([record[name] for name in ("ax", "ay", "az", "p", "q", "r")]).T
    bend = np.zeros_like(inputs)
    if bent:
        bend[:, 3:] = record.dt / 8 * np.array([record[name] for name in ("p_dot", "q_dot", "r_dot")]).T
    x = np.array([record[name][0] for name in PATH])

    def slope(x, given):
        (u, v, w, phi, theta, psi), (ax, ay, az, p, q, r) = x[:6], given
        sf, cf, st, ct, sp, cp = (f(a) for a in (phi, theta, psi) for f in (np.sin, np.cos))
        return np.array(
            [
                ax - 9.80665 * st - q * w + r * v,
                ay + 9.80665 * ct * sf - r * u + p * w,
                az + 9.80665 * ct * cf - p * v + q * u,
                p + (q * sf + r * cf) * st / ct,
                q * cf - r * sf,
                (q * sf + r * cf) / ct,
                ct * cp * u + (sf * st * cp - cf * sp) * v + (cf * st * cp + sf * sp) * w + wind[0],
                ct * sp * u + (sf * st * sp + cf * cp) * v + (cf * st * sp - sf * cp) * w + wind[1],
                st * u - sf * ct * v - cf * ct * w - wind[2],
            ]
        )

    out, dt = [x], record.dt
    for i, (a, b) in enumerate(itertools.pairwise(inputs)):
        middle = (a + b) / 2 + bend[i] - bend[i + 1]
        k1 = slope(x, a)
        k2 = slope(x + dt / 2 * k1, middle)
        k3 = slope(x + dt / 2 * k2, middle)
        k4 = slope(x + dt * k3, b)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        out.append(x)
    return np.array(out)


@pytest.mark.default_cases("all-axes")
@pytest.mark.parametrize("which", FLIGHTS)
def test_the_exact_accelerations_and_rates_integrate_to_the_true_path(which):
    wind = {"wn": 5.0, "we": -3.0, "wd": 0.5}
    truth = demo_instruments(which, errors=wind).truth
    true = np.array([truth[name] for name in PATH]).T
    # To the rule's own accuracy where the curvature of the rates between samples is given.
    error = np.abs(integrated(truth, tuple(wind.values()), bent=True) - true).max(axis=0)
    assert (error[3:6] < 3e-6).all(), error
    # With linear interpolation between 50 samples a second.
    error = np.abs(integrated(truth, tuple(wind.values()), bent=False) - true).max(axis=0)
    assert (error[:3] < 5e-3).all(), error
    assert (error[3:6] < 1e-4).all(), error
    assert (error[6:] < 0.05).all(), error


def test_without_errors_and_noise_instruments_read_the_truth_at_their_places():
    flight = demo_instruments("all-axes", errors={}, noise=0.0, duration=20.0)
    seen, true, aircraft = flight.measured, flight.truth, flight.aircraft
    rates, turning = [true[n] for n in "pqr"], [true[f"{n}_dot"] for n in "pqr"]
    air = air_data_at_cg(seen["V"], seen["alpha"], seen["beta"], *rates, aircraft.position("vane"))
    felt = rb.acceleration_at_cg(seen["ax"], seen["ay"], seen["az"], rates, turning, aircraft.position("accelerometer"))
    for name, got in zip(("V", "alpha", "beta", "ax", "ay", "az"), (*air, *felt)):
        assert_allclose(got, true[name], rtol=1e-12, atol=1e-12, err_msg=name)
    for name in ("p", "q", "r", "phi", "theta", "psi", "de", "da", "dr", "thrust", "rho"):
        assert_allclose(seen[name], true[name], rtol=0, atol=0, err_msg=name)
    # The antenna's velocity is the slope of its position; both swing about the centre of gravity.
    for place, speed in (("x", "vn"), ("y", "ve")):
        assert_allclose(differentiate(seen[place], 0.02)[5:-5], seen[speed][5:-5], atol=5e-4)
        assert np.abs(seen[place] - true[place]).max() < np.linalg.norm(aircraft.position("gps")) + 1e-9
    above = true["h"] + np.sin(true["theta"]) * -1.5 - np.cos(true["theta"]) * np.cos(true["phi"]) * 0.2
    assert_allclose(seen["h"], above, rtol=1e-12)
    assert all(not aircraft.sensors[name].noise for name in aircraft.sensors)


@pytest.mark.default_cases(3)
@pytest.mark.parametrize("name", INSTRUMENT_ERRORS)
def test_each_error_shows_in_its_own_channels_and_in_no_other(name):
    size = 0.01
    right = demo_instruments(3, errors={}, noise=0.0, duration=6.0).measured
    flight = demo_instruments(3, errors={name: size}, noise=0.0, duration=6.0)
    wrong, true = flight.measured, flight.truth
    assert flight.errors == {**dict.fromkeys(INSTRUMENT_ERRORS, 0.0), name: size}
    t = right.t
    expected = {
        "wn": {"vn": size, "x": size * t},
        "we": {"ve": size, "y": size * t},
        "wd": {"vd": size, "h": -size * t},
        "Cup": {"alpha": size * true["alpha"]},
        "Calpha0": {"alpha": size},
        "Csi": {"beta": size * true["beta"]},
        "Cbeta0": {"beta": size},
        "KV": {"V": size * right["V"]},
    }.get(name, {name[1:]: size})
    # Air a hair denser at another height is all the wind down can do to the rest.
    atol = 1e-3 if name == "wd" else 1e-9
    for channel in right.names:
        if channel != "thrust":
            moved = wrong[channel] - right[channel]
            assert_allclose(moved, np.broadcast_to(expected.get(channel, 0.0), t.shape), atol=atol, err_msg=channel)


def test_noise_has_the_standard_deviation_the_aircraft_states():
    clean = demo_instruments(2, seed=4, errors={}, noise=0.0).measured
    for noise in (1.0, 0.5):
        noisy = demo_instruments(2, seed=4, errors={}, noise=noise)
        stated = {c: std for sensor in noisy.aircraft.sensors.values() for c, std in sensor.noise.items()}
        assert set(stated) == {*("V", "alpha", "beta", "phi", "theta", "psi", "h", "x", "y", "vn", "ve", "vd")} | {
            *("ax", "ay", "az", "p", "q", "r")
        }
        for channel, std in stated.items():
            # 1501 samples: the ratio scatters by 1/sqrt(3002) = 1.8 %; five of these.
            assert (noisy.measured[channel] - clean[channel]).std() == pytest.approx(std, rel=0.09)


def test_errors_are_drawn_from_the_seed_at_their_stated_sizes():
    drawn = [demo_instruments(k, seed, duration=1.0).errors for seed in range(30) for k in (0, 1)]
    assert demo_instruments(1, 7, duration=2.0).errors == demo_instruments(1, 7, duration=1.0).errors
    sizes = {**dict.fromkeys(("bax", "bay", "baz"), 0.1), **dict.fromkeys(("bp", "bq", "br"), 3e-3)}
    sizes |= {"wn": 6.0, "we": 6.0, "Cup": 0.03, "Calpha0": 5e-3, "Csi": 0.03}
    for name in INSTRUMENT_ERRORS:
        values = np.array([one[name] for one in drawn])
        if name in sizes:
            # 60 draws: the ratio scatters by 1/sqrt(120) = 9 %; four of these.
            assert np.sqrt(np.mean(values**2)) == pytest.approx(sizes[name], rel=0.37), name
        else:
            assert not values.any()


def test_an_unknown_error_is_answered_with_the_nearest():
    with pytest.raises(DomainError, match=r"no error 'Calpha'\. Did you mean 'Calpha0'"):
        demo_instruments(errors={"Calpha": 0.01})
    with pytest.raises(DomainError, match="lasts 1 s or more"):
        demo_instruments(duration=0.5)
    with pytest.raises(DomainError, match="no demonstration flight 'loop'"):
        demo_instruments("loop")


def test_every_term_of_the_truth_is_a_candidate():
    for terms in TRUTH.values():
        assert [str(Term.parse(term)) for term in terms] == list(terms)


# ---------------------------------------------------------------- recovery cases of benchmarks/


def test_the_candidates_are_all_monomials():
    for degree, count in ((3, 164), (4, 494)):
        exponents = cases.monomials(8, degree)
        assert len(exponents) == count == comb(8 + degree, degree) - 1
        assert len({tuple(row) for row in exponents}) == count
    X = cases.design_matrix(np.array([[2.0], [3.0]]), cases.monomials(2, 2))
    assert X.tolist() == [[2.0, 3.0, 4.0, 6.0, 9.0]]


def test_the_closed_loop_is_stable_and_its_modes_add_up_to_the_plain_recursion():
    A, B, C = cases.closed_loop()
    assert np.linalg.eigvals(A).real.max() < -0.1
    u = np.random.default_rng(0).standard_normal((6, 400))
    Ad, Bd, *_ = cont2discrete((A, B, C, np.zeros((10, 6))), cases.DT, "zoh")
    x, expected = np.zeros(len(A)), np.empty((10, 400))
    for k in range(400):
        expected[:, k] = C @ x
        x = Ad @ x + Bd @ u[:, k]
    poles, gains_in, gains_out = cases._modes()
    got = sum(
        np.outer(out, lfilter([0, 1], [1, -pole], into @ u)).real for pole, into, out in zip(poles, gains_in, gains_out)
    )
    assert_allclose(got, expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("noise_model", cases.NOISE_MODELS)
def test_a_residual_has_unit_variance_and_its_ar_whitens_it(noise_model):
    e = cases.residual(noise_model, 400_000, np.random.default_rng(0))
    assert e.var() == pytest.approx(1.0, rel=0.05)
    ar, innovation = cases.true_ar(noise_model)
    w = lfilter(np.r_[1.0, -ar], 1.0, e)[len(ar) :]
    assert w.std() == pytest.approx(innovation, rel=0.01)
    # Box and Pierce: n sum rho^2 over 20 lags is chi-squared(20), below 45.3 in 99.9 per cent.
    rho = np.array([w[k:] @ w[:-k] / (w @ w) for k in range(1, 21)])
    # No AR of finite order whitens a five-point mean, whose spectrum has zeros; what is left is small.
    assert len(w) * np.sum(rho**2) < (45.3 if noise_model != "smoothed_5pt" else 2000.0)


@pytest.mark.parametrize("noise_model", ["white", "ar1_0.92"])
def test_weak_terms_stand_at_their_stated_t_values(noise_model):
    case = cases.recovery_case(noise_model, 2, n=6000, n_manoeuvres=2)
    assert case.n == 6000
    assert len(case.manoeuvres) == 2
    assert case.r2 == pytest.approx(0.96, abs=0.02)
    assert sorted(np.round(np.abs(case.theta / case.standard_errors)[-3:], 6)) == [7.0, 10.0, 13.0]
    # The mean square error over redraws of generalised least squares with the true colour is what was stated.
    X = cases.design_matrix(case.base, case.exponents[list(case.true)])
    whiten = np.r_[1.0, -case.ar]
    parts = np.split(X, 2)
    Z = np.concatenate([lfilter(whiten, 1.0, part, axis=0)[len(case.ar) :] for part in parts])
    Z -= Z.mean(axis=0)
    errors = []
    for seed in range(60):
        y = np.split(case.redraw(seed).response, 2)
        v = np.concatenate([lfilter(whiten, 1.0, part)[len(case.ar) :] for part in y])
        errors.append(np.linalg.lstsq(Z, v - v.mean(), rcond=None)[0] - case.theta)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / case.standard_errors
    # 60 draws: the ratio scatters by 1/sqrt(120) = 0.09.
    assert_allclose(ratio, 1.0, atol=0.35)


def test_no_true_term_has_a_near_alias():
    case = cases.recovery_case("white", 5, n=4000)
    X = cases.design_matrix(case.base, case.exponents)
    X = X - X.mean(axis=0)
    for j in case.true:
        others = [k for k in case.true if k != j]
        projector = np.linalg.pinv(X[:, others])
        left = X - X[:, others] @ (projector @ X)
        size = np.linalg.norm(left, axis=0)
        outside = [k for k in range(164) if k not in case.true]
        correlation = np.abs(left[:, outside].T @ left[:, j]) / (size[outside] * size[j])
        assert correlation.max() <= 0.9 + 1e-9


def test_several_responses_have_each_their_own_truth_on_the_same_signals():
    one = cases.recovery_case("white", 3, n=2000)
    six = cases.recovery_case("white", 3, n=2000, n_responses=6)
    base, responses = six.manoeuvres[0]
    assert responses.shape == (6, 2000)
    assert_allclose(base, one.manoeuvres[0][0], rtol=0, atol=0)
    assert six.true == one.true
    for a, b in itertools.combinations(responses, 2):
        assert np.abs(np.corrcoef(a, b)[0, 1]) < 0.9999


def test_in_open_loop_the_surfaces_do_not_answer_the_motion():
    # Before the first input, at 1 s, surfaces of the closed loop answer the gusts; those of the open loop stay.
    open_loop, closed = (demo_flights(1, 3, duration=1.0, noise=0.0, augmentation=gain)[0][0] for gain in (0.0, 1.0))
    for surface in ("da", "dr"):
        assert np.ptp(open_loop[surface]) < 1e-9
        assert np.ptp(closed[surface]) > 1e-4
