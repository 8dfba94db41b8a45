import numpy as np
import pytest
import scipy.signal as sps

from slowtime.identification.subspace.correlations import (
    block_products,
    combine_products,
    correlation_matrices,
)


def test_means_are_the_lagged_products_averaged_over_all_pairs():
    rng = np.random.default_rng(1)
    series = rng.standard_normal((503, 2)) + 1j * rng.standard_normal((503, 2))
    found = correlation_matrices(series, series[:, :1], lags=5, rate_hz=1.0, draws=8)
    for lag in range(5):
        later, before = series[lag:], series[: len(series) - lag, :1]
        # Samples beyond the last whole block only lend themselves to pairs.
        used = 503 // 16 * 16
        pairs = min(used, 503 - lag)
        direct = later[:pairs].T @ before[:pairs].conj() / pairs
        np.testing.assert_allclose(found.mean[lag], direct, rtol=1e-12)


def test_draws_have_the_variance_of_the_mean_of_a_process_with_memory():
    rng = np.random.default_rng(2)
    spread, said = [], []
    for _ in range(300):
        process = sps.lfilter([1.0], [1.0, -0.9], rng.standard_normal(6000))[1000:, None]
        found = correlation_matrices(process, process, lags=3, rate_hz=1.0, draws=24)
        spread.append(found.mean[2, 0, 0])
        said.append(np.mean(found.draws[:, 2, 0, 0] ** 2))
    assert np.sqrt(np.mean(said)) == pytest.approx(np.std(spread), rel=0.12)


def test_blocks_of_two_lengths_and_weights_tell_the_same_as_equal_ones():
    rng = np.random.default_rng(3)
    series = rng.standard_normal((4000, 1))
    short = block_products(series, series, lags=2, length=50)
    long = short.reshape(40, 2, 2, 1, 1).sum(axis=1)
    mixed = np.concatenate([long[:20], short[40:]])
    pairs = np.repeat(
        np.concatenate([np.full(20, 100.0), np.full(40, 50.0)])[:, None], 2, axis=1
    )
    one = combine_products(short, np.full((80, 2), 50.0), rate_hz=1.0, draws=10)
    other = combine_products(mixed, pairs, rate_hz=1.0, draws=10)
    np.testing.assert_allclose(one.mean, other.mean, rtol=1e-12)
    # The slow draws see no difference; the fast ones see the longer steps.
    np.testing.assert_allclose(one.draws[:4], other.draws[:4], atol=0.1 * one.draws.std())


def test_a_series_too_short_for_its_lags_says_so():
    with pytest.raises(ValueError, match=r"20 instants.*for 30 lags.*record longer"):
        correlation_matrices(np.ones((20, 1)), np.ones((20, 1)), lags=30, rate_hz=1.0)
