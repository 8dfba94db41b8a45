"""Slopes and information of the posterior against differences and dense matrices."""

import dataclasses

import numpy as np
import pytest

from slowtime.identification.bayes import likelihood
from slowtime.identification.bayes.band import Band
from slowtime.identification.bayes.likelihood import (
    gradient,
    gradient_and_information,
    log_posterior,
)
from slowtime.identification.bayes.model import BandModes, modes_from_vector, parameter_vector
from slowtime.identification.bayes.resonances import cross_periodograms


def start(*, own=2, guests=1, channels=3, seed=1):
    rng = np.random.default_rng(seed)
    count = own + guests
    root = np.tril(rng.standard_normal((count, count)))
    root = root + 1j * np.tril(rng.standard_normal((count, count)), -1)
    root[np.diag_indices(count)] = 1.0 + np.abs(np.diag(root))
    if guests == 0:
        root[0] = np.eye(count)[0]
    return BandModes(
        log_frequency=np.log(np.linspace(2.9, 3.1, count)),
        log_damping=np.log(np.linspace(0.008, 0.02, count)),
        shapes=rng.standard_normal((channels, count)),
        mixing=root,
        log_noise=np.log(0.01 * (1 + np.arange(channels))),
        noise_exponent=np.linspace(-2.0, 4.0, channels),
        guests=guests,
    )


def band(modes, *, seed=2, derivatives=2, background=True):
    rng = np.random.default_rng(seed)
    frequency = np.arange(150, 181) / 55.0
    channels = len(modes.log_noise)
    each = rng.standard_normal((2, len(frequency), channels, 4))
    columns = each[0] + 1j * each[1]
    return Band(
        frequency_hz=frequency,
        scatter=columns @ np.swapaxes(columns, 1, 2).conj(),
        number=rng.integers(1, 4, len(frequency)).astype(float),
        duration_s=55.0,
        derivatives=derivatives,
        background=0.02 * np.tile(np.eye(channels) + 0j, (len(frequency), 1, 1))
        if background
        else None,
    )


CASES = [
    pytest.param({"own": 1, "guests": 0, "channels": 1}, id="one mode, one channel"),
    pytest.param({"own": 1, "guests": 2}, id="one mode and guests"),
    pytest.param({"own": 3, "guests": 0}, id="close modes"),
    pytest.param({"own": 2, "guests": 2, "channels": 2}, id="close modes and guests"),
]


def spectral_matrices(vector, modes, data):
    """By the definition, entry by entry."""
    here = modes_from_vector(vector, modes)
    crossed = cross_periodograms(data, here.log_frequency, here.log_damping)
    rung = np.einsum("ci,ij,kij,dj->kcd", here.shapes, here.coherence, crossed, here.shapes)
    middle = np.sqrt(data.frequency_hz[0] * data.frequency_hz[-1])
    slope = (data.frequency_hz[:, None] / middle) ** here.noise_exponent
    whole = rung + np.eye(len(here.log_noise)) * (np.exp(here.log_noise) * slope)[:, None]
    return whole if data.background is None else whole + data.background


def log_prior_by_definition(here, modes):
    own = slice(max(modes.guests, 1), None)
    length = np.linalg.norm(here.mixing[own], axis=1)
    noise = (here.log_noise - modes.log_noise) / likelihood.NOISE_PRIOR_SD
    exponent = here.noise_exponent / likelihood.NOISE_EXPONENT_SD
    coherent = likelihood.OWN_FORCES * np.linalg.slogdet(here.coherence)[1]
    squares = np.sum((length - 1.0) ** 2) + np.sum(noise**2) + np.sum(exponent**2)
    return coherent - 0.5 * squares


@pytest.mark.parametrize("case", CASES)
def test_the_log_posterior_is_that_of_complex_gaussians(case):
    modes = start(**case)
    data = band(modes)
    vectors = parameter_vector(modes), parameter_vector(modes) + 0.01
    expected = []
    for vector in vectors:
        matrices = spectral_matrices(vector, modes, data)
        logs = [np.log(np.linalg.det(m).real) for m in matrices]
        fit = np.trace(np.linalg.inv(matrices) @ data.scatter, axis1=1, axis2=2).real
        expected.append(-data.number @ logs - fit.sum())
        expected[-1] += log_prior_by_definition(modes_from_vector(vector, modes), modes)
    found = [log_posterior(data, vector, modes) for vector in vectors]
    assert found[1] - found[0] == pytest.approx(expected[1] - expected[0], rel=1e-8)


@pytest.mark.parametrize("derivatives", [0, 1, 2])
@pytest.mark.parametrize("case", CASES)
def test_the_slope_is_that_of_the_log_posterior(case, derivatives):
    modes = start(**case)
    data = band(modes, derivatives=derivatives)
    at = parameter_vector(modes) + 0.01 * np.random.default_rng(3).standard_normal(
        len(parameter_vector(modes))
    )
    found = gradient(data, at, modes)
    differences = []
    for i in range(len(at)):
        move = np.zeros_like(at)
        move[i] = 1e-6
        after, before = (log_posterior(data, at + s * move, modes) for s in (1, -1))
        differences.append((after - before) / 2e-6)
    np.testing.assert_allclose(found, differences, rtol=1e-4, atol=1e-5 * np.abs(found).max())


@pytest.mark.parametrize("background", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_the_information_is_that_of_dense_matrices(case, background):
    modes = start(**case)
    data = band(modes, background=background)
    at = parameter_vector(modes)
    slopes = []
    for i in range(len(at)):
        move = np.zeros_like(at)
        move[i] = 1e-5
        after, before = (spectral_matrices(at + s * move, modes, data) for s in (1, -1))
        slopes.append((after - before) / 2e-5)
    inverse = np.linalg.inv(spectral_matrices(at, modes, data))
    turned = inverse @ np.stack(slopes)
    expected = np.einsum("k,akcd,bkdc->ab", data.number, turned, turned).real
    _, found = gradient_and_information(data, at, modes)
    of_prior = found - expected
    mixed = slice(2 * modes.number, 2 * modes.number + len(modes.free_mixing))
    channels = len(modes.log_noise)
    last = np.arange(len(at))[-2 * channels :]
    prior_sd = [likelihood.NOISE_PRIOR_SD, likelihood.NOISE_EXPONENT_SD]
    only = np.zeros_like(found)
    only[mixed, mixed] = of_prior[mixed, mixed]
    only[last, last] = np.repeat(prior_sd, channels) ** -2.0
    scale = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    np.testing.assert_allclose(of_prior / scale, only / scale, atol=2e-6)
    assert (np.linalg.eigvalsh(only[mixed, mixed]) > 0).all()


@pytest.mark.parametrize("case", CASES)
def test_the_vector_and_the_modes_are_two_forms_of_one(case):
    modes = start(**case)
    vector = parameter_vector(modes) + np.arange(len(parameter_vector(modes)))
    np.testing.assert_allclose(parameter_vector(modes_from_vector(vector, modes)), vector)
    unchanged = modes_from_vector(vector, modes)
    guests = modes.guests
    np.testing.assert_array_equal(
        unchanged.log_frequency[:guests], modes.log_frequency[:guests]
    )
    np.testing.assert_array_equal(unchanged.mixing[:guests], modes.mixing[:guests])


def test_forces_have_unit_power_whatever_the_length_of_their_rows():
    modes = start(own=3, guests=2)
    longer = dataclasses.replace(modes, mixing=3.0 * modes.mixing)
    np.testing.assert_allclose(np.diag(modes.coherence), 1.0)
    np.testing.assert_allclose(longer.coherence, modes.coherence)
