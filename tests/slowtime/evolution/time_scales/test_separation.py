"""Two slow scales: eq. 5.12 and 5.13 superposed, read with an error of 0.025."""

import numpy as np
import pytest

from slowtime.dynamics.evolution_functions import mass_change, stiffness_change
from slowtime.estimation import filtering
from slowtime.estimation.hyperparameters import fit
from slowtime.evolution.time_scales import mixture_of_experts, separation

ERROR = 0.025


def series(count, seed):
    time = np.linspace(0.0, 1000.0, count)
    truth = stiffness_change(time) + mass_change(time)
    value = truth + ERROR * np.random.default_rng(seed).standard_normal(count)
    return time, truth, value, np.full(count, ERROR)


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


def table(count, seeds):
    """Root mean square errors: readings, one process, additive, mixture; share covered."""
    rows = []
    for seed in range(seeds):
        time, truth, value, sd = series(count, seed)
        one = max(
            (fit(time, value, sd, smoothness=s) for s in (0.5, 1.5, 2.5)),
            key=lambda found: found.log_likelihood,
        )
        single = filtering.smooth(one.process, time, value, sd)
        choice = separation.choose(time, value, sd)
        both, mixed = choice.additive, choice.mixture
        rows.append(
            (
                rms(value - truth),
                rms(single.mean - truth),
                rms(both.mean - truth),
                rms(mixed.mean - truth),
                np.mean(np.abs(both.mean - truth) < 1.96 * both.sd),
                np.mean(np.abs(mixed.mean - truth) < 1.96 * mixed.sd),
                choice.log_odds > 0,
            )
        )
    return np.array(rows, dtype=float)


@pytest.mark.slow
@pytest.mark.parametrize("count", [51, 201])
def test_two_scales_over_twenty_seeds(count):
    rows = table(count, 20)
    print(f"{count} readings: {rows.mean(axis=0).round(4)}")
    readings, single, both, mixed, inside, _, better = rows.mean(axis=0)
    assert both < 1.03 * readings
    assert both < 1.05 * single
    assert 0.90 <= inside <= 0.99
    if count == 201:
        assert both < 0.5 * min(readings, single)
        assert both < mixed
        assert better > 0.9


@pytest.mark.long
def test_the_long_scale_is_told_from_the_short_one():
    time, truth, value, sd = series(201, 3)
    parts = separation.additive(time, value, sd)
    assert parts.kind == "teeth"
    np.testing.assert_allclose(parts.long + parts.short, parts.mean, atol=1e-9)
    long = stiffness_change(time)
    # What is constant belongs to neither.
    assert rms(parts.long - long - np.mean(parts.long - long)) < 0.02
    assert rms(parts.mean - truth) < 0.5 * rms(value - truth)
    assert np.mean(np.abs(parts.mean - truth) < 1.96 * parts.sd) > 0.88
    period = np.exp(parts.process.logs)[list(parts.process.free).index("period")]
    assert period == pytest.approx(2 * np.pi / 0.15, rel=0.01)


@pytest.mark.long
def test_a_smooth_wave_has_no_teeth():
    rng = np.random.default_rng(8)
    time, sd = np.arange(80.0), np.full(80, 0.02)
    wave = 0.2 * np.cos(2 * np.pi * time / 11.0)
    parts = separation.additive(time, wave - 0.01 * time + sd * rng.standard_normal(80), sd)
    assert parts.kind == "repeating"
    assert rms(parts.short - wave) < 0.02


@pytest.mark.long
def test_where_nothing_repeats_itself_the_short_scale_is_rough():
    rng = np.random.default_rng(61)
    time = np.arange(80.0)
    value = -0.01 * time + np.cumsum(0.03 * rng.standard_normal(80))
    parts = separation.additive(time, value, np.full(80, 0.02))
    assert parts.kind == "rough"
    assert np.isfinite(parts.log_predictive)


@pytest.mark.long
def test_a_mixture_gives_each_regime_its_expert():
    rng = np.random.default_rng(62)
    time = np.arange(90.0)
    truth = np.where(time < 45, 0.2 * np.sin(time / 14), np.sin(1.3 * time))
    sd = np.full(90, 0.1)
    found = mixture_of_experts.fit(time, truth + 0.1 * rng.standard_normal(90), sd, starts=2)
    np.testing.assert_allclose(found.responsibility.sum(axis=0), 1.0)
    first = found.responsibility[:, :35].mean(axis=1)
    last = found.responsibility[:, 55:].mean(axis=1)
    assert np.abs(first - last).max() > 0.8
    assert rms(found.mean - truth) < 0.09
    again = mixture_of_experts.fit(time, truth, sd, starts=1, rounds=2)
    np.testing.assert_array_equal(
        again.mean, mixture_of_experts.fit(time, truth, sd, starts=1, rounds=2).mean
    )


@pytest.mark.slow
def test_the_choice_goes_to_what_foretells_the_readings_better():
    time, _, value, sd = series(51, 5)
    choice = separation.choose(time, value, sd)
    assert choice.log_odds == pytest.approx(
        choice.additive.log_predictive - choice.mixture.log_predictive
    )
    assert (choice.best == "additive") == (choice.log_odds >= 0)


@pytest.mark.parametrize(
    ("spoil", "cure"),
    [
        (lambda t, v, s: (t[:5], v[:5], s[:5]), "at least 8"),
        (lambda t, v, s: (t[::-1].copy(), v, s), "ascending in slow time"),
        (lambda t, v, s: (t, v, 0 * s), "the standard deviation they have"),
    ],
)
def test_what_cannot_be_taken_apart_is_refused_with_the_cure(spoil, cure):
    time, _, value, sd = series(20, 1)
    with pytest.raises(ValueError, match=cure):
        separation.additive(*spoil(time, value, sd))
