"""The printed forms beside the right ones, each judged by a road that knows neither."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import block_diag, eigh, expm
from scipy.optimize import minimize, minimize_scalar
from scipy.special import ndtr

from slowtime.dynamics import evolution_functions, modes, perturbation, transfer
from slowtime.dynamics.sdof import oscillator, response, simulation
from slowtime.dynamics.structure import Structure
from slowtime.estimation import kalman
from slowtime.evolution import Reason, mass_from_frequency, stiffness_from_frequency
from slowtime.evolution.stiffness_mass import book_formulas
from slowtime.signals import filters

PAGE = Path(__file__).parents[2] / "docs/errata.md"
ROOT = Path(__file__).parents[2]

ZETA_0 = 0.05
R_0 = np.sqrt(1 - ZETA_0**2)
SPRING = oscillator.Oscillator.from_modal(2.0 / (2 * np.pi), 0.1)  # 2 rad/s, 10 %
Q_0, V_0 = 1.0, 0.5
TIMES = np.linspace(0.0, 8.0, 33)


def one(*values):
    return np.array(values, dtype=np.float64)


def moved(mass, damping, stiffness, start, time):
    """Displacements at `time`: a matrix exponential, which has no case to get wrong."""
    mass, damping, stiffness = map(np.atleast_2d, (mass, damping, stiffness))
    n = len(mass)
    generator = np.zeros((2 * n, 2 * n))
    generator[:n, n:] = np.eye(n)
    generator[n:] = -np.linalg.solve(mass, np.hstack((stiffness, damping)))
    return (expm(generator * time) @ start)[:n]


def spring_moved(start, times=TIMES):
    m, c, k = SPRING.mass_kg, SPRING.damping_n_s_per_m, SPRING.stiffness_n_per_m
    return np.array([moved(m, c, k, np.array(start), t)[0] for t in times])


# Chapter 1


def test_e01_only_the_bracketed_cost_has_the_optimal_estimator_as_its_minimum():
    rng = np.random.default_rng(1)
    h, mean, z = rng.standard_normal((3, 2)), one(1.0, -2.0), one(0.5, 3.0, 1.0)
    r, p = np.diag([1.0, 0.5, 2.0]), np.array([[2.0, 0.3], [0.3, 1.0]])

    def cost(x, of_prior):
        misfit, shift = z - h @ x, x - mean
        return 0.5 * misfit @ np.linalg.solve(r, misfit) + of_prior * shift @ np.linalg.solve(
            p, shift
        )

    right = minimize(cost, mean, args=(0.5,)).x
    printed = minimize(cost, mean, args=(1.0,)).x
    estimate = kalman.update(kalman.Gaussian.of(mean, p), z, h, r).mean
    np.testing.assert_allclose(estimate, right, atol=1e-5)
    assert np.abs(estimate - printed).max() > 0.1


def test_e02_the_covariance_needs_the_identity_matrix_not_the_number_one():
    rng = np.random.default_rng(2)
    h, r = rng.standard_normal((2, 3)), np.diag([0.5, 1.0])
    p = np.diag([1.0, 2.0, 0.5])
    batch = np.linalg.inv(np.linalg.inv(p) + h.T @ np.linalg.solve(r, h))
    gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
    updated = kalman.update(kalman.Gaussian.of(np.zeros(3), p), np.zeros(2), h, r)
    np.testing.assert_allclose(updated.covariance, batch, atol=1e-14)
    assert np.abs((1 - gain @ h) @ p - batch).max() > 0.1


def test_e03_gaussian_and_zero_mean_is_not_enough_noise_must_be_white():
    steps, prior, memory = 20, 4.0, 0.9
    lags = np.abs(np.subtract.outer(np.arange(steps), np.arange(steps)))
    model = kalman.Kalman(
        transition=np.eye(1),
        process_noise=np.zeros((1, 1)),
        observation=np.eye(1),
        reading_noise=np.eye(1),
    )
    start = model.start(np.zeros(1), np.array([[prior]]))
    # The estimate is linear in the readings: its weights are its answers to unit readings.
    weights = np.array(
        [model.run(start, e[:, None])[-1].updated.mean[0] for e in np.eye(steps)]
    )
    claimed = model.run(start, np.zeros((steps, 1)))[-1].updated.covariance[0, 0]
    of_start = (1 - weights.sum()) ** 2 * prior
    white, coloured = (of_start + weights @ c @ weights for c in (np.eye(steps), memory**lags))
    assert claimed == pytest.approx(white, rel=1e-12)
    assert coloured > 5 * claimed


# Chapter 3, one degree of freedom


def test_e04_the_inverse_transform_lacks_the_mass():
    mass, omega, time = 3.0, 2.0, 1.0
    undamped = oscillator.Oscillator(mass, 0.0, mass * omega**2)
    # f(s) / (s^2 + w^2) is the motion of a unit mass under f.
    left = quad(lambda tau: np.sin(omega * (time - tau)) / omega, 0.0, time)[0]
    right = quad(lambda tau: np.sin(omega * (time - tau)) / (mass * omega), 0.0, time)[0]
    by_steps = simulation.simulate(oscillator.Oscillator(1.0, 0.0, omega**2), np.ones(11), 10.0)
    assert by_steps[0][-1] == pytest.approx(left, rel=1e-12)
    assert left / right == pytest.approx(3.0)
    assert response.step_response(undamped, one(time))[0] == pytest.approx(left / mass)


def free_print(t):
    """Eq. 3.42, second form."""
    w, wd, rate = SPRING.natural_frequency, SPRING.damped_frequency, SPRING.decay_rate
    return (V_0 + rate * Q_0) / wd * np.sin(w * t) + Q_0 * np.cos(w * t)


def test_e05_a_free_motion_decays_and_rings_at_the_damped_frequency():
    exact = spring_moved((Q_0, V_0))
    found, _ = response.free_response(SPRING, TIMES, Q_0, V_0)
    np.testing.assert_allclose(found, exact, atol=1e-13)
    assert np.abs(free_print(TIMES) - exact).max() > 0.5
    slope = (free_print(1e-6) - free_print(-1e-6)) / 2e-6
    assert slope == pytest.approx(0.7035, abs=5e-5)
    assert V_0 == 0.5


def test_e06_amplitude_and_phase_form_decays_too():
    wd, rate = SPRING.damped_frequency, SPRING.decay_rate
    amplitude = np.hypot(Q_0, (V_0 + rate * Q_0) / wd)
    printed = amplitude * np.cos(wd * TIMES - np.arctan2(V_0 + rate * Q_0, wd * Q_0))
    found, _ = response.free_response(SPRING, TIMES, Q_0, V_0)
    np.testing.assert_allclose(np.exp(-rate * TIMES) * printed, found, atol=1e-14)
    assert np.abs(printed - found).max() > 0.5


def test_e07_an_impulse_rings_at_the_damped_frequency():
    w, wd, rate = SPRING.natural_frequency, SPRING.damped_frequency, SPRING.decay_rate
    found = response.impulse_response(SPRING, one(3.0))[0]
    assert found == pytest.approx(spring_moved((0.0, 1.0 / SPRING.mass_kg), one(3.0))[0])
    assert found == pytest.approx(-0.0849875247, abs=1e-10)
    printed = np.exp(-rate * 3.0) * np.sin(w * 3.0) / (SPRING.mass_kg * wd)
    assert printed == pytest.approx(-0.0770595040, abs=1e-10)


def test_e08_the_phase_needs_its_quadrant():
    wd, rate, q0 = SPRING.damped_frequency, SPRING.decay_rate, -Q_0
    amplitude = np.hypot(q0, (V_0 + rate * q0) / wd)
    found, _ = response.free_response(SPRING, TIMES, q0, V_0)

    def motion(phase):
        return amplitude * np.exp(-rate * TIMES) * np.cos(wd * TIMES - phase)

    np.testing.assert_allclose(motion(np.arctan2(V_0 + rate * q0, wd * q0)), found, atol=1e-14)
    printed = motion(np.arctan((V_0 + rate * q0) / (wd * q0)))
    np.testing.assert_allclose(printed, -found, atol=1e-14)


def test_e09_signs_phase_and_divisor_of_the_damped_oscillator():
    w, wd, rate = SPRING.natural_frequency, SPRING.damped_frequency, SPRING.decay_rate
    assert SPRING.poles[0] == pytest.approx(-rate + 1j * wd)
    theta = 0.3
    start = np.sin(theta), wd * np.cos(theta) - rate * np.sin(theta)
    decay = np.exp(-rate * TIMES)
    np.testing.assert_allclose(
        decay * np.sin(wd * TIMES + theta), spring_moved(start), atol=1e-13
    )
    unlike = decay * np.sin(wd * TIMES * theta)
    start = 0.0, wd * theta
    assert np.abs(unlike - spring_moved(start)).max() > 0.1
    omega = one(0.7)
    relative = omega / w
    shape = 1.0 / (1.0 - relative**2 + 2j * SPRING.damping_ratio * relative)
    exact = response.frequency_response(SPRING, omega)
    np.testing.assert_allclose(shape / (SPRING.mass_kg * w**2), exact)
    assert np.abs(shape / (SPRING.mass_kg * w) - exact).max() > 0.1


def test_e10_critical_damping_is_a_coefficient_with_a_unit():
    in_tonnes = oscillator.Oscillator(1.0, 0.4, 4.0)
    in_kilograms = oscillator.Oscillator(1e3, 0.4e3, 4e3)
    assert in_kilograms.critical_damping == pytest.approx(1e3 * in_tonnes.critical_damping)
    assert in_kilograms.damping_ratio == pytest.approx(in_tonnes.damping_ratio)


# Chapter 3, several degrees of freedom


CHAIN = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])


@pytest.mark.parametrize("time", [0.0, 1.0, 5.0])
def test_e11_motion_after_a_released_displacement_starts_without_velocity(time):
    damping = 0.2
    squares, shapes = eigh(CHAIN)
    w = np.sqrt(squares)
    zeta = damping / (2 * w)
    wd = w * np.sqrt(1 - zeta**2)
    start = one(0, 1, 0, 0, 0, 0)

    def summed(sine, t):
        swing = np.cos(wd * t) + sine * zeta * w / wd * np.sin(wd * t)
        return shapes @ (shapes[1] * np.exp(-zeta * w * t) * swing)

    exact = moved(np.eye(3), damping * np.eye(3), CHAIN, start, time)
    np.testing.assert_allclose(summed(1.0, time), exact, atol=1e-13)
    error = np.abs(summed(0.0, time) - exact).max()
    assert error == pytest.approx({0.0: 0.0, 1.0: 6.5e-2, 5.0: 2.1e-2}[time], abs=1e-3)
    slope = (summed(0.0, 1e-6) - summed(0.0, -1e-6))[1] / 2e-6
    assert slope == pytest.approx(-damping / 2, abs=1e-6)


M_2 = np.eye(2)
C_2 = np.array([[4.0, -4.0], [-4.0, 4.0]])
K_2 = np.array([[1100.0, -100.0], [-100.0, 1200.0]])


PAIR = Structure(mass=M_2, damping=C_2, stiffness=K_2)


def test_e13_the_sums_over_modes_hold_only_with_these_indices():
    damping = np.array([[0.3, -0.1, 0.0], [-0.1, 0.1, 0.0], [0.0, 0.0, 0.05]])
    chain = Structure(mass=np.eye(3), damping=damping, stiffness=CHAIN)
    exact, undamped = modes.complex_modes(chain), modes.undamped_modes(chain)
    squares = undamped.angular_frequency**2
    c = perturbation.modal_damping_matrix(chain, undamped)
    j, k = 0, 2
    lam, alpha = exact.complex_frequency[j], undamped.shapes.T @ exact.shapes[:, j]
    (other,) = set(range(3)) - {j, k}
    of_itself = (squares[k] - lam**2 + 1j * lam * c[k, k]) * alpha[k]
    right = of_itself + 1j * lam * (alpha[j] * c[k, j] + alpha[other] * c[k, other])
    # C'_ki has no i to sum over: read as C'_kj, so that only the last term differs.
    printed = of_itself + 1j * lam * (alpha[j] * c[k, j] + alpha[j] * c[k, other])
    assert abs(right) < 1e-13
    assert abs(printed) > 1e-2


def test_e14_the_denominator_holds_a_sum_with_the_conjugate():
    undamped, exact_shapes = modes.undamped_modes(PAIR), modes.complex_modes(PAIR).shapes
    c = perturbation.modal_damping_matrix(PAIR, undamped)
    squares, lam = undamped.angular_frequency**2, perturbation.light_frequencies(PAIR)
    right = perturbation.factored_shapes(PAIR)
    first = one(1, 1) * [0.7870 - 0.0661j, -0.6406 - 0.1179j]
    in_the_book = 0.6287 + 0.1070j, 0.7797 - 0.0729j
    for j, k in ((0, 1), (1, 0)):
        share = 1j * lam[j] * c[k, j] / ((lam[j] - lam[k]) * (lam[j] - lam[k].conj()))
        printed = undamped.shapes[:, j] + share * undamped.shapes[:, k]
        of_right, of_print, exact = (
            first[j] * z[1] / z[0] for z in (right[:, j], printed, exact_shapes[:, j])
        )
        assert of_right == pytest.approx(in_the_book[j], abs=1e-4)
        assert of_right == pytest.approx(exact, abs=0.025)
        assert abs(of_print - exact) > 0.5
    exact = squares[1] - lam[0] ** 2 + 1j * lam[0] * c[1, 1]
    split = lam[0] - lam[1]
    product, printed = -split * (lam[0] + lam[1].conj()), -split * (lam[0] - lam[1].conj())
    assert exact == pytest.approx(222.1 + 230.6j, abs=0.1)
    assert product == pytest.approx(236.4 + 230.6j, abs=0.1)
    assert printed == pytest.approx(-25.2 + 1.4j, abs=0.1)


def test_e15_the_transform_of_a_velocity_takes_off_the_start():
    s = 1.5
    motion = {
        i: quad(
            lambda t, i=i: (
                np.exp(-s * t) * response.free_response(SPRING, one(t), Q_0, V_0)[i][0]
            ),
            0.0,
            np.inf,
        )[0]
        for i in (0, 1)
    }
    assert motion[1] == pytest.approx(s * motion[0] - Q_0, abs=1e-9)
    assert abs(motion[1] - s * motion[0]) == pytest.approx(abs(Q_0), abs=1e-9)


Q_2, V_2 = one(1.0, -0.5), one(0.2, 0.8)


def test_e16_the_share_of_a_mode_holds_its_own_pole_and_only_the_sum_does_not_care():
    poles, shapes, gamma = modes.complex_modes(PAIR).all()
    s = 3.0 + 20.0j
    a = np.block([[C_2, M_2], [M_2, np.zeros((2, 2))]])
    b = block_diag(K_2, -M_2)
    transform = np.linalg.solve(s * a + b, a @ np.concatenate((Q_2, V_2)))
    exact = np.linalg.solve(np.vstack((shapes, shapes * poles)), transform)

    def shares(pole):
        drive = M_2 @ V_2 + C_2 @ Q_2 + np.multiply.outer(pole, M_2 @ Q_2)
        return np.einsum("dj,jd->j", shapes, drive) / (gamma * (s - poles))

    np.testing.assert_allclose(shares(poles), exact, atol=1e-13)
    printed = shares(np.full(4, s))
    assert np.abs(printed - exact).max() > 0.1 * np.abs(exact).max()
    whole = transfer.laplace_response(PAIR, np.array([s]), displacement=Q_2, velocity=V_2)[0]
    np.testing.assert_allclose(shapes @ printed, transform[:2], atol=1e-13)
    np.testing.assert_allclose(whole, transform[:2], atol=1e-13)


def test_e17_the_second_half_of_a_response_takes_the_conjugate_frequency():
    found = modes.complex_modes(PAIR)

    def half(pole, shapes, norm, t):
        drive = shapes.T @ (M_2 @ V_2 + C_2 @ Q_2) + pole * (shapes.T @ M_2 @ Q_2)
        return shapes @ (np.exp(pole * t) * drive / norm)

    def summed(t, second):
        return half(found.poles, found.shapes, found.norms, t) + half(
            second(found.poles), found.shapes.conj(), found.norms.conj(), t
        )

    errors = []
    for time in (0.4, 1.3):
        exact = moved(M_2, C_2, K_2, np.concatenate((Q_2, V_2)), time)
        np.testing.assert_allclose(summed(time, np.conj), exact, atol=1e-11)
        # Without the star exp(-i lambda t) is exp(-s t), which grows.
        errors.append(np.abs(summed(time, np.negative) - exact).max())
    assert errors[1] > 10 * errors[0] > 0.5


def test_e18_with_twice_the_pole_even_a_proportional_mode_is_not_mass_normalised():
    chain = Structure(mass=np.eye(3), damping=0.2 * np.eye(3), stiffness=CHAIN)
    found = modes.complex_modes(chain)
    for s, z, norm in zip(found.poles, found.shapes.T, found.norms, strict=True):
        assert z @ (2 * s * chain.mass + chain.damping) @ z == pytest.approx(norm)
        assert z @ chain.mass @ z == pytest.approx(1.0)
        of_print = z * np.sqrt(2 * s / norm)
        assert of_print @ chain.mass @ of_print == pytest.approx(s / (1j * s.imag))
        assert abs(s / (1j * s.imag) - 1.0) > 0.05


# Chapter 4


def test_e19_the_mean_value_index_takes_covariances_and_depends_on_how_failure_is_written():
    mean, sd, rho = one(8.0, 6.0), one(1.5, 0.8), 0.3
    correlation = np.array([[1.0, rho], [rho, 1.0]])
    covariance = correlation * np.outer(sd, sd)

    def index(value, slope, matrix):
        return value / np.sqrt(slope @ matrix @ slope)

    slope = one(1.0, -1.0)
    right = index(mean[0] - mean[1], slope, covariance)
    rng = np.random.default_rng(19)
    resistance, load = rng.multivariate_normal(mean, covariance, 200_000).T
    failed = np.mean(resistance < load)
    assert failed == pytest.approx(ndtr(-right), rel=0.02)
    printed = index(mean[0] - mean[1], slope, correlation)
    assert abs(ndtr(-printed) - failed) > 0.4 * failed
    same_event = index(np.log(mean[0] / mean[1]), one(1, -1) / mean, covariance)
    assert abs(same_event - right) > 0.1


# Chapter 5


def test_e20_no_response_peaks_at_the_damped_frequency():
    system = oscillator.Oscillator.from_modal(1.0, ZETA_0)
    for power, quantity in enumerate(("displacement", "velocity", "acceleration")):

        def gain(relative, power=power):
            w = relative * system.natural_frequency
            return -abs(response.frequency_response(system, one(w))[0]) * w**power

        peak = minimize_scalar(gain, bounds=(0.9, 1.1), options={"xatol": 1e-9}).x
        assert peak == pytest.approx(oscillator.resonance(ZETA_0, quantity), abs=1e-6)
        assert abs(peak - R_0) > 1e-3
    mistaken = one(oscillator.resonance(ZETA_0))
    bias = book_formulas.stiffness(book_formulas.distance(mistaken, ZETA_0), ZETA_0)[0]
    assert bias == pytest.approx(-0.0025, abs=1e-6)


def ringing(stiffness=0.0, mass=0.0, zeta=ZETA_0):
    """Damped frequency over the nominal undamped one, from the roots of the polynomial."""
    return np.roots([1.0 + mass, 2.0 * zeta, 1.0 + stiffness]).imag.max()


def test_e21_a_norm_cannot_tell_stiffening_from_softening():
    for change in (-0.2, 0.2):
        signed = book_formulas.distance(one(ringing(change)), ZETA_0)
        assert book_formulas.stiffness(signed, ZETA_0)[0] == pytest.approx(change)
        assert book_formulas.stiffness(np.abs(signed), ZETA_0)[0] < 0.0


def test_e22_the_distance_is_positive_when_the_frequency_has_fallen():
    fallen = ringing(-0.2)
    assert fallen < R_0
    assert book_formulas.distance(one(fallen), ZETA_0)[0] == pytest.approx(0.1057, abs=5e-5)
    assert book_formulas.distance(one(ringing(0.2)), ZETA_0)[0] < 0.0


def test_e23_distances_end_where_the_frequency_would_be_zero_not_at_two():
    allowed_by_print = one(1.5)
    spurious = book_formulas.stiffness(allowed_by_print, ZETA_0)[0]
    assert spurious == pytest.approx(-0.746, abs=5e-4)
    assert ringing(spurious) == pytest.approx(-(R_0 - 1.5), abs=1e-9)
    assert ringing(spurious) > 0.0
    refused = stiffness_from_frequency(R_0 - allowed_by_print, 0.0, damping_ratio_0=ZETA_0)
    assert refused.reasons[0] & Reason.NOT_POSITIVE
    assert np.isnan(refused.value[0])
    assert np.isnan(book_formulas.mass(allowed_by_print, ZETA_0)[0])
    assert np.isinf(book_formulas.mass_light_damping(one(1.0))[0])


def test_e24_the_error_has_the_same_sign_in_both_places():
    truth, theta = -0.2, one(0.01)
    d = book_formulas.distance(one(ringing(truth)) + theta, ZETA_0)
    right = book_formulas.stiffness_error_known(d, theta, ZETA_0)
    printed = -(d + theta) * (2 * R_0 - d + theta)
    assert right[0] == pytest.approx(truth)
    assert printed - right == pytest.approx(-2 * theta * (d + theta))


def test_e25_with_the_error_known_there_is_no_noise_left_to_plot():
    rng = np.random.default_rng(25)
    theta = 0.025 * rng.standard_normal(1000)
    noisy = ringing(-0.2) + theta
    d = book_formulas.distance(noisy, ZETA_0)
    known = book_formulas.stiffness_error_known(d, theta, ZETA_0)
    np.testing.assert_allclose(known, -0.2, atol=1e-14)
    found = stiffness_from_frequency(noisy, 0.025, damping_ratio_0=ZETA_0)
    assert np.std(book_formulas.stiffness(d, ZETA_0)) == pytest.approx(0.045, rel=0.1)
    np.testing.assert_allclose(
        found.value, book_formulas.stiffness(d, ZETA_0) - 0.025**2, atol=1e-14
    )


@pytest.mark.parametrize(("truth", "share"), [(0.0, 0.68), (-0.05, 0.47), (-0.10, 0.14)])
def test_e26_the_size_of_an_error_cannot_be_taken_off_a_single_reading(truth, share):
    sd = 0.025
    exact = ringing(truth)
    noisy = exact + sd * np.random.default_rng(26).standard_normal(100_000)
    d = book_formulas.distance(noisy, ZETA_0)
    assert np.mean(np.abs(d) < sd) == pytest.approx(share, abs=0.01)
    printed = book_formulas.stiffness_error_size_known(d, sd, ZETA_0) - truth
    right = stiffness_from_frequency(noisy, sd, damping_ratio_0=ZETA_0)
    assert np.mean(right.value) == pytest.approx(truth, abs=1e-3)
    assert np.mean(right.sd) == pytest.approx(np.std(right.value), rel=0.02)
    if truth:
        assert np.mean(printed) == pytest.approx(0.0155, abs=1.5e-3)
    if truth == -0.10:
        assert np.sqrt(np.mean(printed**2)) > 1.1 * np.std(right.value)


def test_e27_the_exact_mass_is_not_valid_for_any_damping():
    heavy, truth = 0.8, -0.2  # 1 + truth is below 2 heavy^2: the other branch
    ratio = one(ringing(mass=truth, zeta=heavy))
    other = book_formulas.mass(book_formulas.distance(ratio, heavy), heavy)[0]
    assert ringing(mass=other, zeta=heavy) == pytest.approx(ratio[0])
    assert abs(other - truth) > 0.5
    with pytest.raises(ValueError, match=r"outside \[0, 0\.7071\)"):
        mass_from_frequency(ratio, 0.0, damping_ratio_0=heavy)
    impossible = one(1.01 / (2 * 0.3))
    assert np.isnan(book_formulas.mass(book_formulas.distance(impossible, 0.3), 0.3)[0])
    found = mass_from_frequency(impossible, 0.0, damping_ratio_0=0.3)
    assert found.reasons[0] & Reason.NO_SUCH_MASS


@pytest.mark.parametrize(("zeta", "error"), [(0.05, -9.9e-4), (0.3, -3.6e-2)])
def test_e28_the_light_damping_mass_is_not_exact_and_the_caption_names_a_stiffness(zeta, error):
    truth = 0.25
    d = book_formulas.distance(one(ringing(mass=truth, zeta=zeta)), zeta)
    assert book_formulas.mass(d, zeta)[0] == pytest.approx(truth, abs=1e-13)
    off = book_formulas.mass_light_damping(d)[0] - truth
    assert off == pytest.approx(error, rel=0.03)
    assert off == pytest.approx(zeta**2 * (1 - (1 + truth) ** 1.5), abs=2 * zeta**4)
    assert book_formulas.stiffness(d, zeta)[0] < -0.1


def test_e29_the_noisy_mass_is_singular_at_one_and_its_error_is_relative():
    near = [book_formulas.mass_error_known(one(d), one(0.1))[0] for d in (0.89, 0.899)]
    assert near == pytest.approx([1e4 - 1, 1e6 - 1])
    spurious = book_formulas.mass_error_known(one(1.4), one(0.1))[0]
    assert ringing(mass=spurious, zeta=0.0) == pytest.approx(-(1 - 1.5))
    for nominal in (2.0, 20.0):
        theta = 0.5  # rad/s
        measured = nominal * ringing(mass=0.25, zeta=0.0) + theta
        d = (nominal - measured) / nominal
        assert book_formulas.mass_error_known(one(d), one(theta / nominal))[0] == pytest.approx(
            0.25
        )
        assert abs(book_formulas.mass_error_known(one(d), one(theta))[0] - 0.25) > 0.4


@pytest.mark.parametrize(("zeta", "impossible"), [(0.05, 0.19), (0.01, 0.49)])
def test_e31_natural_and_damped_frequency_together_do_not_tell_the_damping(zeta, impossible):
    rng = np.random.default_rng(31)
    natural, damped = 1 + 1e-3 * rng.standard_normal((2, 200_000))
    square = 1 - (damped * np.sqrt(1 - zeta**2) / natural) ** 2
    assert np.std(square) == pytest.approx(2.8e-3, rel=0.02)
    assert np.std(square) > zeta**2
    assert np.mean(square < 0) == pytest.approx(impossible, abs=0.01)
    # The other pair: what 10 % of damping make of mass and stiffness is 10 %.
    k, m = 0.8, 1.1
    ratio = np.sqrt(k / m) * natural
    measured = zeta / np.sqrt(k * m) * np.exp(0.1 * rng.standard_normal(natural.size))
    for found, truth in zip(
        book_formulas.stiffness_and_mass_from_ratios(ratio, measured, zeta), (k, m), strict=True
    ):
        assert np.std(np.log1p(found)) == pytest.approx(0.1, rel=0.01)
        assert np.median(found) == pytest.approx(truth - 1, abs=2e-3)


def test_e32_error_and_slow_time_of_the_examples_are_relative():
    draws = np.random.default_rng(32).standard_normal(20_000)
    exact = ringing(-0.2)

    def spread(nominal, sigma):
        noisy = exact + sigma / nominal * draws
        return np.std(book_formulas.stiffness(book_formulas.distance(noisy, ZETA_0), ZETA_0))

    assert spread(1.0, 0.025) > 9 * spread(10.0, 0.025)
    assert spread(1.0, 0.025) == pytest.approx(spread(10.0, 0.025 * 10.0))
    # Figure 5.3 ends at 0.35 for t_s / T_0 = 1000; for seconds it would depend on T_0.
    assert -evolution_functions.stiffness_change(one(1000.0))[0] == pytest.approx(
        0.3486, abs=5e-5
    )
    assert -evolution_functions.stiffness_change(one(1000.0 / 2.0))[0] < 0.3


def test_e33_what_the_chapter_derives_is_the_total_response():
    amplitude, omega = response.frequency_response(SPRING, one(1.3))[0], 1.3
    steady = (amplitude * np.exp(1j * omega * TIMES)).real
    total, _ = response.harmonic_response(SPRING, TIMES, omega, Q_0, V_0)
    # Two more states make cos(omega t): one matrix exponential is the whole motion.
    system = np.zeros((4, 4))
    system[0, 1] = 1.0
    system[1] = -SPRING.stiffness_n_per_m, -SPRING.damping_n_s_per_m, 1.0, 0.0
    system[2, 3], system[3, 2] = -omega, omega
    exact = [(expm(system * t) @ one(Q_0, V_0, 1.0, 0.0))[0] for t in TIMES]
    np.testing.assert_allclose(total, exact, atol=1e-12)
    assert np.abs(steady - exact).max() > 0.5


def test_e34_coefficients_of_a_filter_sum_to_one_only_if_it_smooths():
    level, ramp = np.full(20, 3.0), 0.5 * np.arange(20.0)
    np.testing.assert_allclose(filters.moving_average(level, 10)[9:], 3.0)
    difference = one(1.0, -1.0)
    assert difference.sum() == 0.0
    np.testing.assert_allclose(filters.fir(ramp, difference)[1:], 0.5)
    np.testing.assert_allclose(filters.fir(level, difference)[1:], 0.0, atol=1e-15)


# The page itself


def rows():
    """Cells of the items' rows: id, place, as printed, right, shown by."""
    lines = [line for line in PAGE.read_text().splitlines() if re.match(r"\| *E\d", line)]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]


def test_the_table_runs_from_e1_to_e34_without_a_gap():
    assert [row[0] for row in rows()] == [f"E{n}" for n in range(1, 35)]
    assert {len(row) for row in rows()} == {5}
    assert all(cell for row in rows() for cell in row)


def test_every_item_names_a_test_that_exists_or_is_editorial_and_every_test_is_named():
    named = {}
    for number, *_, shown in rows():
        if shown == "editorial":
            continue
        found = re.fullmatch(r"`tests/docs/test_errata\.py::(test_\w+)`", shown)
        assert found is not None, f"{number} is shown by {shown!r}"
        assert found[1].startswith(f"test_e{int(number[1:]):02d}_")
        named[number] = found[1]
    here = {name for name in globals() if re.match(r"test_e\d\d_", name)}
    assert set(named.values()) == here
    assert len(named) == len(here)


def test_only_slips_without_a_number_in_them_are_editorial():
    editorial = [row[0] for row in rows() if row[-1] == "editorial"]
    assert editorial == ["E12", "E30"]
