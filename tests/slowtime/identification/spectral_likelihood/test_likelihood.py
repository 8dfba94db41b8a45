import dataclasses

import numpy as np
import pytest

from slowtime.identification.spectral_likelihood.fisher_information import (
    add_prior,
)
from slowtime.identification.spectral_likelihood.likelihood import (
    band_log_likelihood,
    fit_band_model,
    initial_model,
)
from slowtime.identification.spectral_likelihood.model import (
    BandData,
    BandModel,
    step_parameters,
)
from slowtime.identification.spectral_likelihood.score_test import AddedModeTest
from tests.slowtime.identification.spectral_likelihood.information import fisher_information

OMEGA = np.linspace(-30.0, 30.0, 301)
POLES = np.array([-1.0 - 4.0j, -1.5 + 6.0j])
LENGTH = 2 * np.pi / (OMEGA[1] - OMEGA[0])


def drawn(rng, *shape):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def model(poles=POLES, *, length=np.inf):
    """Modes driven by white forces of their own, over a flat background."""
    shape = np.array([[1.0, 0.6], [0.4, -1.0]], dtype=complex)[:, : len(poles)]
    force = shape * (0.5 / -poles.real)
    level = np.diag([0.02, 0.03]).astype(complex)
    whole = BandModel(poles, shape, force, level, 0.0002 * level, poles)
    turn = complex(np.exp(0.7j))
    return dataclasses.replace(whole, length=length, turn=turn)


def data_of(truth, density, number=1.0):
    number = np.full(len(OMEGA), number)
    return BandData(OMEGA, density, number, truth.length, truth.turn)


def periodogram(rng, truth):
    root = np.linalg.cholesky(truth.density(OMEGA))
    y = root @ drawn(rng, len(OMEGA), 2, 1) / np.sqrt(2.0)
    return data_of(truth, y @ y.conj().transpose(0, 2, 1) + 1e-6 * np.eye(2))


@pytest.mark.parametrize("length", [np.inf, 5.0])
def test_the_score_is_the_slope_of_the_likelihood(length):
    data = periodogram(np.random.default_rng(1), model(length=length))
    start = initial_model(data, POLES * 1.1, model().shape)
    _, score = fisher_information(data, start, start.density(OMEGA))
    size, step = len(score), 1e-6
    slopes = np.empty(size)
    for k, along in enumerate(step * np.eye(size)):
        both = [step_parameters(start, sign * along) for sign in (1.0, -1.0)]
        forth, back = (
            band_log_likelihood(data, each.density(OMEGA))
            - 0.5 * np.sum(np.square(np.divide(*each.ties())))
            for each in both
        )
        slopes[k] = (forth - back) / (2 * step)
    np.testing.assert_allclose(score, slopes, atol=1e-5 * np.abs(slopes).max())


def test_the_prior_adds_the_curvature_of_its_own_logarithm():
    start = dataclasses.replace(model(), expected=POLES * 1.1)
    data, size, step = data_of(start, start.density(OMEGA)), 2 * len(POLES), 1e-4
    information, score = add_prior(start, np.zeros((size, size)), np.zeros(size))
    _, of_all = fisher_information(data, start, start.density(OMEGA))
    along = step * np.eye(size, len(of_all))

    def log_prior(way):
        return -0.5 * np.sum(np.square(np.divide(*step_parameters(start, way).ties())))

    slopes = [(log_prior(way) - log_prior(-way)) / (2 * step) for way in along]
    np.testing.assert_allclose(score, slopes, rtol=1e-5)
    curvature = [
        [
            (log_prior(a + b) - log_prior(a - b) - log_prior(b - a) + log_prior(-a - b))
            / (2 * step) ** 2
            for a in along
        ]
        for b in along
    ]
    np.testing.assert_allclose(information, -np.array(curvature), rtol=1e-4, atol=1e-4)


def test_the_mean_response_is_that_of_a_finite_record():
    length, middle = 5.0, 0.3
    cycles = np.array([-3.0, 0.0, 2.0, 11.0])
    omega = 2 * np.pi * cycles / length - middle
    truth = dataclasses.replace(
        model(length=length), turn=complex(np.exp(1j * middle * length))
    )
    gain, bent = truth.gain(omega)
    lag = (np.arange(200_000) + 0.5) * length / 200_000
    decay = np.exp(POLES[:, None] * lag)
    waves = np.exp(-1j * omega[:, None] * lag) * (1 - lag / length) * length / 200_000
    np.testing.assert_allclose(gain, decay @ waves.T, rtol=1e-6)
    np.testing.assert_allclose(bent, (lag * decay) @ waves.T, rtol=1e-6)


def test_without_a_length_leakage_is_neglected():
    far, _ = model(length=1e7).gain(OMEGA)
    plain, _ = model().gain(OMEGA)
    np.testing.assert_allclose(far, plain, rtol=1e-6)


def test_a_fit_to_what_a_model_predicts_finds_the_model():
    truth = model(length=40.0)
    data = data_of(truth, truth.density(OMEGA), number=10.0)
    near = POLES + np.array([0.4 - 0.3j, -0.5 + 0.6j])
    found = fit_band_model(data, initial_model(data, near, truth.shape + 0.1))
    assert found.converged
    np.testing.assert_allclose(found.model.pole, POLES, atol=5e-3)
    lost = band_log_likelihood(data, truth.density(OMEGA)) - found.log_likelihood
    assert lost < 0.05


@pytest.mark.long
def test_the_poles_scatter_by_what_the_covariance_says():
    truth, rng = model(length=LENGTH), np.random.default_rng(2)
    errors = []
    for _ in range(60):
        data = periodogram(rng, truth)
        found = fit_band_model(data, initial_model(data, POLES, truth.shape))
        sd = np.sqrt([np.diag(found.pole_covariance(k)) for k in range(2)])
        log_decay = np.log(found.model.pole.real / POLES.real)
        errors.append(np.column_stack([log_decay, found.model.pole.imag - POLES.imag]) / sd)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(errors), axis=(0, 1))), 1.0, atol=0.2)


def test_what_a_weak_mode_promises_is_what_it_adds():
    weak = np.array([-1.5 + 6.0j])
    truth = model()
    force = truth.force * np.array([1.0, 0.02])
    data = data_of(truth, dataclasses.replace(truth, force=force).density(OMEGA), number=20.0)
    one = fit_band_model(data, initial_model(data, POLES[:1], truth.shape[:, :1]))
    promised, shape = AddedModeTest(data, one.model).gain(complex(weak[0]), truth.shape[:, 1])
    both = fit_band_model(data, one.model.with_modes(weak, shape[:, None]))
    gained = both.log_likelihood - one.log_likelihood
    assert gained > 5.0
    assert promised == pytest.approx(gained, rel=0.3)


def test_a_mode_is_promised_much_however_wrong_the_shape_it_is_asked_with():
    truth = model()
    data = data_of(truth, truth.density(OMEGA), number=5.0)
    one = fit_band_model(data, initial_model(data, POLES[:1], truth.shape[:, :1]))
    right = truth.shape[:, 1]
    wrong = np.array([right[1].conj(), -right[0].conj()])
    prospects = AddedModeTest(data, one.model)
    asked = prospects.gain(complex(POLES[1]), wrong)
    assert asked[0] == pytest.approx(prospects.gain(complex(POLES[1]), right)[0], rel=0.2)
    overlap = (
        np.abs(np.vdot(asked[1], right)) / np.linalg.norm(right) / np.linalg.norm(asked[1])
    )
    assert overlap > 0.99


def test_poles_that_are_held_stay_and_the_others_move():
    truth = model()
    data = data_of(truth, truth.density(OMEGA))
    found = fit_band_model(data, initial_model(data, POLES + 0.2j, truth.shape, held=1))
    assert found.model.pole[1] == POLES[1] + 0.2j
    assert abs(found.model.pole[0] - POLES[0]) < abs(0.2j)


@pytest.mark.parametrize("length", [np.inf, 5.0])
def test_a_group_is_predicted_as_the_mean_over_its_width(length):
    truth, width = model(length=length), 1.7
    fine = (np.arange(2000) + 0.5) / 2000 - 0.5
    omega = np.array([-4.3, 0.0, 5.0, 30.0])
    across = truth.density((omega[:, None] + width * fine).reshape(-1))
    mean = across.reshape(len(omega), len(fine), 2, 2).mean(axis=1)
    np.testing.assert_allclose(truth.density(omega, np.full(4, width)), mean, rtol=1e-5)
    np.testing.assert_allclose(truth.density(omega, np.zeros(4)), truth.density(omega))
    gain, bent = truth.gain(omega, np.full(4, width))
    moved = dataclasses.replace(truth, pole=truth.pole + 1e-6)
    slope = (moved.gain(omega, np.full(4, width))[0] - gain) / 1e-6
    np.testing.assert_allclose(bent, slope, rtol=1e-4, atol=1e-9)


def test_wide_groups_move_no_pole():
    truth, size = model(), 30
    omega = np.linspace(-60.0, 60.0, 3600)
    density = truth.density(omega).reshape(-1, size, 2, 2).mean(axis=1)
    middle = omega.reshape(-1, size).mean(axis=1)
    number = np.full(len(middle), float(size))
    data = BandData(middle, density, number, width=number * (omega[1] - omega[0]))
    found = fit_band_model(data, initial_model(data, POLES + 0.1, truth.shape))
    np.testing.assert_allclose(found.model.pole, POLES, atol=2e-3)
