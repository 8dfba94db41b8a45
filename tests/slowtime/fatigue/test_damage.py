"""Curves, means, Miner's sum and spectral methods against closed forms and sampling."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from slowtime.fatigue.counter import Count, Counter
from slowtime.fatigue.curves import SNCurve
from slowtime.fatigue.cycles import Cycles, rainflow
from slowtime.fatigue.histogram import Histogram
from slowtime.fatigue.mean_stress import MeanStress
from slowtime.fatigue.miner import (
    Capacity,
    MinerSum,
    TimeToFailure,
    equivalent_range,
)
from slowtime.fatigue.spectral import METHODS, SpectralMoments, damage_rate, dirlik_density

ONE = SNCurve(constant=1e12, slope=3.0)
TWO = SNCurve(constant=1e12, slope=3.0, knee=60.0, lower_slope=5.0, cut_off=10.0)


def band(low, high, level=1.0):
    frequency = np.linspace(low, high, 4001)
    return SpectralMoments.of(frequency, np.full(len(frequency), level))


def test_a_curve_of_two_slopes_is_continuous_at_its_knee_and_ends_at_its_cut_off():
    about = np.array([60 * (1 - 1e-9), 60.0, 60 * (1 + 1e-9)])
    np.testing.assert_allclose(TWO.life(about), TWO.life(about)[1], rtol=1e-7)
    assert TWO.life(np.array([9.99]))[0] == np.inf
    np.testing.assert_allclose(TWO.life(np.array([120.0])), 1e12 / 120**3)
    np.testing.assert_allclose(TWO.life(np.array([30.0])) / TWO.life(np.array([60.0])), 2.0**5)


def test_a_detail_category_is_that_of_the_standard():
    curve = SNCurve.of_detail_category(71.0, characteristic=True)
    lives = curve.life(np.array([71.0, curve.knee, curve.cut_off]))
    np.testing.assert_allclose(lives, [2e6, 5e6, 1e8], rtol=1e-9)
    assert curve.knee == pytest.approx(52.3, abs=0.05)  # table of EN 1993-1-9: 52
    assert curve.cut_off == pytest.approx(28.7, abs=0.05)  # 29
    median = SNCurve.of_detail_category(71.0, log10_sd=0.2)
    ratio = median.constant / curve.constant
    assert stats.norm.cdf(math.log10(ratio) / 0.2) == pytest.approx(0.95, abs=1e-3)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"constant": -1.0, "slope": 3.0}, r"constant=-1.0 is not allowed. Give a positive"),
        ({"constant": 1.0, "slope": 3.0, "knee": 2.0}, "belong together"),
        ({"constant": 1.0, "slope": 3.0, "log10_sd": -0.1}, "log10_sd=-0.1"),
    ],
)
def test_a_curve_that_cannot_be_says_why(given, says):
    with pytest.raises(ValueError, match=says):
        SNCurve(**given)


def test_means_are_corrected_by_goodman_and_gerber():
    cycles = Cycles(np.full(4, 100.0), np.array([-50.0, 0.0, 100.0, 300.0]), np.ones(4))
    goodman = MeanStress(rule="goodman", strength=400.0).corrected(cycles).ranges
    gerber = MeanStress(rule="gerber", strength=400.0).corrected(cycles).ranges
    np.testing.assert_allclose(goodman, [100, 100, 100 / 0.75, 400])
    np.testing.assert_allclose(gerber, [100, 100, 100 / (1 - 1 / 16), 100 / (1 - 9 / 16)])
    shifted = MeanStress(rule="goodman", strength=400.0, constant_mean=100.0)
    assert shifted.corrected(cycles).ranges[1] == pytest.approx(goodman[2])
    with pytest.raises(ValueError, match="give the tensile strength"):
        MeanStress(rule="gerber")


def test_miners_sum_of_constant_amplitude_is_cycles_over_life():
    wave = 50.0 * np.sin(2 * np.pi * np.arange(0, 1000, 0.01) + 0.1)
    counter = Counter(curve=ONE)
    total = counter.miner(counter.step(Count(), wave))
    assert total.median == pytest.approx(1000 / (1e12 / 100**3), rel=2e-3)
    assert equivalent_range(Histogram.of(rainflow(wave)), 3.0) == pytest.approx(100, rel=0.03)


def test_the_sum_is_lognormal_as_sampled():
    rng = np.random.default_rng(1)
    total = MinerSum.of(ONE, 0.2, 0.2).with_stress_error(0.1, factor=1.05)
    lives = 10 ** (0.2 * rng.standard_normal(400_000))
    stress = 1.05 * np.exp(0.1 * rng.standard_normal(400_000))
    sampled = 0.2 * stress**3 / lives
    assert total.mean == pytest.approx(sampled.mean(), rel=5e-3)
    assert total.sd == pytest.approx(sampled.std(), rel=2e-2)
    low, high = total.interval(0.9)
    assert np.mean((sampled > low) & (sampled < high)) == pytest.approx(0.9, abs=2e-3)


def test_time_to_failure_is_as_sampled_among_those_that_stand():
    rng = np.random.default_rng(2)
    total = MinerSum.of(ONE, 0.4, 0.4)
    time = TimeToFailure.of(total, 1e-3, rate_variation=0.2)
    capacity = np.exp(Capacity().ln_sd * rng.standard_normal(2_000_000))
    bears = capacity * np.exp(ONE.ln_sd * rng.standard_normal(2_000_000))
    spread = math.sqrt(math.log1p(0.04))
    rate = 1e-3 * np.exp(spread * rng.standard_normal(2_000_000))
    stands = bears > 0.4
    left = (bears[stands] - 0.4) / rate[stands]
    for probability in (0.05, 0.5, 0.95):
        assert time.quantile(probability) == pytest.approx(
            np.quantile(left, probability), rel=8e-3
        )
        assert time.probability(time.quantile(probability)) == pytest.approx(probability)
    assert time.used_up == pytest.approx(1 - stands.mean(), abs=1e-3)
    assert TimeToFailure.of(total, 0.0).quantile(0.5) == math.inf


@pytest.mark.parametrize("slope", [1.0, 3.0, 5.0, 8.5])
def test_a_narrow_band_does_the_damage_of_the_closed_form_in_amplitudes(slope):
    moments = band(4.99, 5.01, 100.0)
    per_amplitude = 1e11
    curve = SNCurve(constant=per_amplitude * 2.0**slope, slope=slope)  # of ranges
    closed = (
        moments.zero_crossings_hz
        / per_amplitude
        * math.sqrt(2 * moments.m0) ** slope
        * math.gamma(1 + slope / 2)
    )
    assert damage_rate(moments, curve, "narrow_band") == pytest.approx(closed, rel=1e-12)
    for method in METHODS:
        assert damage_rate(moments, curve, method) == pytest.approx(closed, rel=0.03)


@pytest.mark.parametrize("curve", [ONE, TWO])
def test_a_narrow_band_is_integrated_for_any_curve(curve):
    moments = band(4.9, 5.1, 2000.0)
    sd = math.sqrt(moments.m0)

    def density(amplitude):
        damage = curve.damage(np.array([2 * amplitude]))[0]
        return damage * amplitude / sd**2 * np.exp(-(amplitude**2) / (2 * sd**2))

    whole = integrate.quad(density, 0, 12 * sd, points=[5.0, 30.0], limit=500)[0]
    assert damage_rate(moments, curve, "narrow_band") == pytest.approx(
        moments.zero_crossings_hz * whole, rel=1e-4
    )


def test_the_density_of_dirlik_integrates_to_one_and_is_rayleigh_for_a_narrow_band():
    amplitude = np.linspace(0, 15, 60_001)
    for moments in (band(0.1, 10), band(1, 3), band(4.9, 5.1)):
        density = dirlik_density(moments, amplitude)
        assert np.trapezoid(density, amplitude) == pytest.approx(1.0, abs=1e-4)


def test_methods_are_ordered_and_a_wrong_one_is_refused():
    moments = band(0.1, 10)
    narrow = damage_rate(moments, ONE, "narrow_band")
    for method in METHODS:
        assert damage_rate(moments, ONE, method) <= narrow * (1 + 1e-12)
    with pytest.raises(ValueError, match=r"Allowed: narrow_band.*dirlik"):
        damage_rate(moments, ONE, "rain")
    with pytest.raises(ValueError, match="negative, not finite"):
        SpectralMoments.of(np.array([1.0, 2.0]), np.array([1.0, -1.0]))
