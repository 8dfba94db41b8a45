import numpy as np
import pytest

from slowtime.evolution import learn_nominal

RUNS = 4_000


def test_the_mean_is_weighted_by_what_each_epoch_knows():
    nominal = learn_nominal(np.array([10.0, 10.3]), np.array([0.1, 0.2]))
    assert nominal.frequency == pytest.approx((10.0 * 100 + 10.3 * 25) / 125)
    assert nominal.epochs == 2


def test_the_stated_standard_deviation_is_honest():
    rng = np.random.default_rng(61)
    sd = rng.uniform(0.01, 0.05, 20)
    scores = []
    for _ in range(RUNS):
        nominal = learn_nominal(12.0 + sd * rng.standard_normal(20), sd)
        scores.append((nominal.frequency - 12.0) / nominal.frequency_sd)
    assert np.std(scores) == pytest.approx(0.96, abs=0.05)
    assert abs(np.mean(scores)) < 0.06


def test_scatter_beyond_the_stated_errors_widens_the_result():
    rng = np.random.default_rng(62)
    scores = []
    for _ in range(RUNS):
        nominal = learn_nominal(12.0 + 0.1 * rng.standard_normal(15), 0.01)
        scores.append((nominal.frequency - 12.0) / nominal.frequency_sd)
    assert np.std(scores) == pytest.approx(1.1, abs=0.15)


@pytest.mark.parametrize("wrong", [3.0, 80.0, np.nan, np.inf, -1.0])
def test_a_wrong_epoch_is_left_out_and_counted(wrong):
    rng = np.random.default_rng(63)
    frequency = 12.0 + 0.01 * rng.standard_normal(9)
    clean = learn_nominal(frequency, 0.01)
    dirty = learn_nominal(np.append(frequency, wrong), 0.01)
    assert dirty.frequency == pytest.approx(clean.frequency, abs=1e-12)
    assert dirty.rejected == clean.rejected + 1


def test_damping_is_learnt_beside_and_may_be_missing_here_and_there():
    frequency, damping = np.full(4, 10.0), np.array([0.02, np.nan, 0.022, 0.018])
    nominal = learn_nominal(frequency, 0.01, damping, 0.002)
    assert nominal.damping_ratio == pytest.approx(0.02)
    assert nominal.damping_ratio_sd == pytest.approx(0.002 / np.sqrt(3))
    assert nominal.damping_relative_sd == pytest.approx(0.1 / np.sqrt(3))
    assert nominal.frequency_relative_sd == pytest.approx(0.0005)
    assert np.isnan(learn_nominal(frequency, 0.01).damping_ratio)


def test_one_exact_epoch_is_enough():
    nominal = learn_nominal(np.array([7.0]), 0.0)
    assert nominal.frequency == 7.0
    assert nominal.frequency_sd == pytest.approx(0.0, abs=1e-8)


def test_the_unit_of_frequency_does_not_matter():
    hz, sd = np.array([9.9, 10.0, 10.2]), np.array([0.1, 0.05, 0.1])
    a, b = learn_nominal(hz, sd), learn_nominal(hz * 2 * np.pi, sd * 2 * np.pi)
    assert b.frequency == pytest.approx(a.frequency * 2 * np.pi)
    assert b.frequency_relative_sd == pytest.approx(a.frequency_relative_sd)


def test_nothing_to_learn_from_is_refused_with_the_cure():
    with pytest.raises(ValueError, match="give the nominal frequency"):
        learn_nominal(np.array([np.nan, -1.0]), 0.1)
