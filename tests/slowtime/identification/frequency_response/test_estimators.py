"""H1, H2 and Hv, their random errors, and inputs that cannot be told apart."""

import numpy as np
import pytest

from slowtime.identification.frequency_response.estimators import (
    estimate_response,
    input_coherence,
    multiple_coherence,
    random_error,
    spectral_matrices,
)
from slowtime.identification.frequency_response.response import FrequencyResponse

BLOCKS, LINES = 24, 400
H = np.array([[2.0 - 1.0j, 0.5 + 0.3j], [-0.7j, 1.0 + 1.0j]])


def complex_noise(rng, *shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def blocks(seed, *, inputs=2, output_noise=0.0, input_noise=0.0):
    rng = np.random.default_rng(seed)
    u = complex_noise(rng, BLOCKS, LINES, inputs)
    y = u @ H[:, :inputs].T + output_noise * complex_noise(rng, BLOCKS, LINES, 2)
    return spectral_matrices(u + input_noise * complex_noise(rng, *u.shape), y)


@pytest.mark.parametrize("estimator", ["h1", "hv"])
def test_without_noise_every_estimator_is_exact(estimator):
    found = estimate_response(blocks(1), estimator)
    np.testing.assert_allclose(found, np.broadcast_to(H, found.shape), atol=1e-6)


def test_h2_without_noise_is_exact_and_is_for_one_input():
    found = estimate_response(blocks(1, inputs=1), "h2")
    np.testing.assert_allclose(found[:, :, 0], np.broadcast_to(H[:, 0], (LINES, 2)), atol=1e-9)
    with pytest.raises(ValueError, match=r"H2 was asked for with 2 inputs.*Choose 'h1'"):
        estimate_response(blocks(1), "h2")


def test_noise_in_the_input_lowers_h1_raises_nothing_in_h2_and_hv_lies_between():
    spectra = blocks(2, inputs=1, input_noise=0.3, output_noise=0.0)
    size = {
        name: np.mean(np.abs(estimate_response(spectra, name)[:, 0, 0]))
        for name in ("h1", "hv", "h2")
    }
    true = abs(H[0, 0])
    assert size["h1"] == pytest.approx(true / 1.09, rel=0.02)
    assert size["h2"] == pytest.approx(true, rel=0.02)
    assert size["h1"] < size["hv"] < size["h2"]


def test_random_errors_are_those_seen_over_lines():
    spectra = blocks(3, output_noise=0.4)
    error = np.abs(estimate_response(spectra) - H) ** 2
    told = random_error(spectra) ** 2
    np.testing.assert_allclose(error.mean(axis=0) / told.mean(axis=0), 1.0, atol=0.2)


def test_the_error_of_one_input_is_that_of_bendat_and_piersol():
    spectra = blocks(4, inputs=1, output_noise=1.0)
    coherence = multiple_coherence(spectra)
    relative = random_error(spectra)[:, :, 0] / np.abs(estimate_response(spectra)[:, :, 0])
    table = np.sqrt(1 - coherence) / np.sqrt(coherence * 2 * BLOCKS)
    # The complex error is sqrt(2) times that of the modulus; K / (K - 1) takes out the bias.
    expected = np.sqrt(2) * table * np.sqrt(BLOCKS / (BLOCKS - 1))
    np.testing.assert_allclose(relative, expected, rtol=1e-9)


def test_coherent_inputs_are_refused():
    rng = np.random.default_rng(5)
    u = complex_noise(rng, BLOCKS, LINES, 1)
    both = np.concatenate([u, 2 * u + 0.05 * complex_noise(rng, *u.shape)], axis=2)
    spectra = spectral_matrices(both, both)
    assert np.median(input_coherence(spectra)) > 0.99
    with pytest.raises(ValueError, match=r"coherent with the others.*independent signals"):
        estimate_response(spectra)


def test_fewer_blocks_than_inputs_are_refused():
    rng = np.random.default_rng(6)
    u = complex_noise(rng, 1, LINES, 2)
    with pytest.raises(ValueError, match=r"1 blocks were averaged.*2 inputs"):
        estimate_response(spectral_matrices(u, u))


@pytest.mark.parametrize(("lines", "enough"), [(3, False), (4, True)])
def test_a_band_holds_four_lines_at_least(lines, enough):
    hz = np.arange(1.0, 11.0)
    one = np.ones((len(hz), 1, 1))
    given = FrequencyResponse(
        frequency_hz=hz, response=one.astype(complex), sd=one, coherence=one[:, :, 0],
        averages=1, kind="acceleration",
    )  # fmt: skip
    if enough:
        assert given.within(2.0, 1.0 + lines).frequency_hz.tolist() == [2.0, 3.0, 4.0, 5.0]
    else:
        with pytest.raises(ValueError, match="holds 3 of the lines"):
            given.within(2.0, 1.0 + lines)
