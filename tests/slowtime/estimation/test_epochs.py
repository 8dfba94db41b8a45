"""Constants of the two nonlinear structures of Chapter 9, from records of five seconds."""

import dataclasses

import numpy as np
import pytest

from slowtime.dynamics.stochastic import Springs, examples, means
from slowtime.estimation.epochs import Watched, identify_epoch

DAYS = np.linspace(0.0, 10_000.0, 201)


def two(records, **settings):
    """What the twin takes two masses for: stiffness, damping and Duffing's alpha are wrong."""
    springs = Springs.of(examples.two_masses(90.0))
    wrong = springs.values * np.array([1.05, 0.95, 0.75, 1.5, 1.0, 1.0, 1.0])
    free = (
        ("stiffness", "k1"),
        ("stiffness", "k2"),
        ("damping", "k1"),
        ("damping", "k2"),
        ("effect", 0, "k3_n_per_m3"),
    )
    return watched(springs, wrong, free, examples.TWO_MASSES_WHITE, records, **settings)


def seven(records, **settings):
    """Likewise of seven masses."""
    springs = Springs.of(examples.seven_masses(90.0))
    wrong = springs.values.copy()
    wrong[:14] = [2100, 1900, 1050, -1050, 950, 950, 475, *[15.0] * 7]
    free = (
        *(("stiffness", f"k{i + 1}") for i in range(7)),
        *(("damping", f"k{i + 1}") for i in range(7)),
        ("effect", 0, "k3_n_per_m3"),
    )
    return watched(springs, wrong, free, examples.SEVEN_MASSES_WHITE, records, **settings)


def watched(springs, wrong, free, white, records, **settings):
    nodes = len(springs.nodes)
    wide = {"stiffness": 0.3, "damping": 0.8, "effect": 0.15}
    keywords = {
        "springs": dataclasses.replace(springs, values=wrong),
        "free": free,
        "log_sd": np.array([wide[name[0]] for name in free]),
        "step_s": records.step_s,
        "white": white,
        "force_sd": np.full(nodes, records.force_sd),
        "sensors": np.arange(nodes),
        "reading_sd": records.reading_sd,
        "start_sd": np.full(2 * nodes, 1e-3),
    }
    return Watched(**(keywords | settings))


CASES = {
    "two": (examples.two_masses, examples.TWO_MASSES_WHITE, two, 2),
    "seven": (examples.seven_masses, examples.SEVEN_MASSES_WHITE, seven, 7),
}


def campaign(name, seed, days, passes=2):
    """Errors over what was claimed, stiffness then damping; errors [N/m]; the result."""
    make, white, of_twin, count = CASES[name]
    true = Springs.of(make())
    rng, values = np.random.default_rng(seed), examples.aged(true, days)
    records = examples.record(true, values, white, rng)
    one = of_twin(records)
    found = identify_epoch(one, records.readings, records.forces, passes=passes)
    asked = true.where(one.free)[: 2 * count]
    truth = values[:, asked]
    error = np.log(found.value[:, : 2 * count] / truth)
    return error / found.log_sd[:, : 2 * count], found.value[:, : 2 * count] - truth, found


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_every_constant_is_found_within_its_band_as_often_as_the_band_says(name):
    days = DAYS[::20] if name == "two" else DAYS[::50]
    pull, _, found = campaign(name, 41, days)
    inside = np.abs(pull) < 1.96
    assert 0.85 <= inside.mean()
    assert np.sqrt(np.mean(pull**2)) < 1.3
    assert found.log_sd[:, : pull.shape[1] // 2].max() < 0.03
    np.testing.assert_allclose(found.surprise, 1.0, atol=0.12)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "every"), [("two", 2), ("seven", 10)])
def test_over_twenty_seeds_bands_hold_the_truth_as_they_claim(name, every):
    pulls = np.concatenate([campaign(name, 100 + s, DAYS[::every])[0] for s in range(20)])
    share = (np.abs(pulls) < 1.96).mean(axis=0)
    print(f"{name}: share inside {np.round(share, 3)}, {len(pulls)} epochs")
    half = len(share) // 2
    assert 0.92 <= share[:half].mean() <= 0.97
    assert 0.92 <= share[half:].mean() <= 0.97


@pytest.mark.slow
def test_a_second_pass_mends_what_a_wide_prior_has_bent_and_counts_nothing_twice():
    once = campaign("seven", 42, DAYS[::100], passes=1)
    twice, thrice = (campaign("seven", 42, DAYS[::100], passes=n) for n in (2, 3))
    assert np.mean(once[0] ** 2) > 1.5 * np.mean(twice[0] ** 2)
    np.testing.assert_allclose(thrice[2].log_sd, twice[2].log_sd, rtol=0.1)
    step = (thrice[2].log_ratio - twice[2].log_ratio) / thrice[2].log_sd
    assert np.sqrt(np.mean(step**2)) < 0.35


def bad_starts(runs, seed):
    """Records with noise, gaps and spikes, and a twin that starts anywhere."""
    true, rng = Springs.of(examples.two_masses()), np.random.default_rng(seed)
    values = examples.aged(true, rng.uniform(0.0, 1e4, runs))
    records = examples.record(true, values, examples.TWO_MASSES_WHITE, rng, every=20)
    readings = records.readings.copy()
    readings[rng.random(readings.shape) < 0.1] = np.nan
    for i in range(runs):
        gap = rng.integers(0, len(readings) - 40)
        readings[gap : gap + rng.integers(1, 40), i] = np.nan
    spikes = rng.random(readings.shape) < 0.002
    readings[spikes] += 100.0 * rng.standard_normal(spikes.sum())
    one = two(records, gate=1e-9)
    start = 0.5 * rng.standard_normal((runs, 5))
    found = identify_epoch(one, readings, records.forces, log_ratio=start)
    return found, values[:, true.where(one.free)], one


@pytest.mark.long
@pytest.mark.parametrize("runs", [40, pytest.param(1000, marks=pytest.mark.slow)])
def test_noise_gaps_spikes_and_bad_starts_break_nothing(runs):
    found, truth, _ = bad_starts(runs, 43)
    assert np.isfinite(found.log_ratio).all()
    assert (np.linalg.eigvalsh(found.log_covariance) > 0).all()
    error = np.abs(np.log(found.value[:, :2] / truth[:, :2]))
    assert np.median(error) < 0.05


def test_the_interval_holds_the_value_and_keeps_the_sign_of_what_is_negative():
    _, _, found = campaign("seven", 44, DAYS[::200], passes=1)
    lo, hi = found.interval()
    assert (lo < found.value).all()
    assert (found.value < hi).all()
    assert (found.value[:, 3] < 0).all()


@pytest.mark.long
def test_what_the_record_alone_tells_does_not_hang_on_the_prior():
    true = Springs.of(examples.two_masses())
    values = examples.aged(true, DAYS[::50])
    records = examples.record(
        true, values, examples.TWO_MASSES_WHITE, np.random.default_rng(46)
    )
    one = two(records)
    near = identify_epoch(one, records.readings, records.forces)
    start = np.array([0.2, -0.2, 0.6, 0.6, 0.0])
    far = identify_epoch(
        one, records.readings, records.forces, log_ratio=np.tile(start, (5, 1)), passes=3
    )
    damping = slice(2, 4)
    apart = (far.log_ratio - near.log_ratio)[:, damping]
    alone = (far.record_alone()[0] - near.record_alone()[0])[:, damping]
    assert np.mean(apart) > 0.01
    assert abs(np.mean(alone)) < 0.5 * np.mean(apart)
    # Of Duffing's constant the record says nothing, and the prior stays.
    np.testing.assert_array_equal(near.record_alone()[0][:, 4], near.log_ratio[:, 4])


def test_intervals_are_as_many_as_forces():
    records = examples.record(
        Springs.of(examples.two_masses()),
        examples.aged(Springs.of(examples.two_masses()), DAYS[:2]),
        examples.TWO_MASSES_WHITE,
        np.random.default_rng(45),
        every=50,
    )
    with pytest.raises(ValueError, match="mean of the force over each interval"):
        identify_epoch(two(records), records.readings, records.forces[1:])


def test_means_over_intervals_are_those_of_straight_lines():
    samples = np.arange(13.0)[:, None] ** 1.0
    np.testing.assert_allclose(means(samples, 4)[:, 0], [2.0, 6.0, 10.0])
