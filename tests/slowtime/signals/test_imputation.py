"""Missing samples are drawn with the spectrum of the record, and measured ones stay."""

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.signals.gap_filling import bridge
from slowtime.signals.imputation import impute


def autoregression(poles, count, rng):
    return sps.lfilter([1.0], np.real(np.poly(poles)), rng.standard_normal(count))


def losses(count, share, rng, longest=40):
    present = np.ones(count, dtype=bool)
    while (~present).mean() < share:
        first = rng.integers(1, count - longest - 1)
        present[first : first + rng.integers(1, longest + 1)] = False
    return present


def test_measured_samples_stay_and_the_same_seed_gives_the_same_draws():
    rng = np.random.default_rng(1)
    samples = rng.standard_normal((5000, 2)) * [1.0, 1e6]
    present = losses(5000, 0.1, rng)
    one, other = (impute(samples, present, rng=np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.samples[present], samples[present])
    np.testing.assert_array_equal(one.samples, other.samples)
    assert np.isfinite(one.samples).all()


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_one_sample_within_an_autoregression_has_its_conditional_variance(phi):
    # Of x_k = phi x_{k-1} + e_k between two neighbours: var e / (1 + phi^2).
    rng, count = np.random.default_rng(2), 200_000
    series = autoregression([phi], count, rng)[:, None]
    present = np.arange(count) % 10 != 5
    made = impute(series, present, rng=rng)
    expected = (1 - phi**2) / (1 + phi**2)
    assert made.spread == pytest.approx(expected, rel=0.05)
    mean = phi / (1 + phi**2) * (series[4:-1:10] + series[6::10])
    error = (made.samples[5::10] - mean[: len(made.samples[5::10])]) / series.std()
    assert np.var(error) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("longest", [40, 400])
def test_draws_keep_the_width_of_a_resonance_where_predictions_narrow_it(longest):
    rng, count = np.random.default_rng(4), 60_000
    radius, turn = 0.99, 2.0
    poles = [radius * np.exp(1j * turn), radius * np.exp(-1j * turn)]
    series = autoregression(poles, count, rng)[:, None]
    present = losses(count, 0.2, rng, longest)

    def lost_coherence(samples):
        # Correlation after 40 samples, on the way of the decay.
        band = sps.hilbert(samples[:, 0])
        lag = np.vdot(band[:-40], band[40:]) / np.vdot(band, band)
        return -np.log(abs(lag)) / 40

    drawn = lost_coherence(impute(series, present, rng=rng).samples)
    assert drawn == pytest.approx(lost_coherence(series), rel=0.04)
    if longest == 40:
        assert lost_coherence(bridge(series, present).samples) < 0.96 * lost_coherence(series)


def test_draws_of_channels_that_move_together_move_together():
    rng, count = np.random.default_rng(5), 20_000
    motion = autoregression([0.8j, -0.8j], count, rng)
    samples = np.stack([motion, -2.0 * motion], axis=1)
    samples += 1e-3 * rng.standard_normal(samples.shape)
    present = losses(count, 0.2, rng)
    drawn = impute(samples, present, rng=rng).samples[~present]
    assert np.corrcoef(drawn.T)[0, 1] < -0.99


def test_a_long_gap_within_the_memory_of_a_mode_is_drawn_given_both_of_its_ends():
    # Its memory is 500 samples; from one end alone the draws are off by 0.68.
    rng, count = np.random.default_rng(7), 20_000
    poles = [0.998 * np.exp(1j), 0.998 * np.exp(-1j)]
    series = autoregression(poles, count, rng)[:, None]
    series = series / series.std() + 0.02 * rng.standard_normal(series.shape)
    present = (np.arange(count) % 1000 < 500) | (np.arange(count) % 1000 >= 700)
    drawn = impute(series, present, rng=np.random.default_rng(1)).samples
    assert (drawn - series)[~present].std() < 0.55


def test_without_a_generator_it_predicts():
    rng, count = np.random.default_rng(6), 5000
    decay = np.exp(-np.arange(count) / 1500) * np.cos(0.3 * np.arange(count))
    present = losses(count, 0.1, rng, 20)
    made = impute(decay[:, None], present, rng=None)
    assert np.abs(made.samples[:, 0] - decay).max() < 0.02


@pytest.mark.parametrize(
    "present",
    [np.arange(4000) % 3 == 0, np.arange(4000) > 0, np.arange(300) % 10 != 1],
)
def test_records_of_which_too_little_is_there_are_refused(present):
    with pytest.raises(ValueError, match="samples are there"):
        impute(np.ones((len(present), 1)), present, rng=None)
