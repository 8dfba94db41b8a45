import numpy as np
import pytest

from slowtime.evolution import (
    Reason,
    explain,
    mass_from_frequency,
    stiffness_and_mass,
    stiffness_from_frequency,
)

ESTIMATORS = [stiffness_from_frequency, mass_from_frequency]
either = pytest.mark.parametrize("estimate", ESTIMATORS)


def has(found, reason):
    return (found.reasons & int(reason)) != 0


@either
def test_nonsense_readings_are_named_and_do_not_touch_their_neighbours(estimate):
    ratio = np.array([1.0, np.nan, np.inf, 0.0, -0.9, 0.98, 0.97])
    sd = np.array([0.001, 0.001, 0.001, 0.001, 0.001, np.nan, -0.001])
    found = estimate(ratio, sd)
    np.testing.assert_array_equal(has(found, Reason.NOT_FINITE), [0, 1, 1, 0, 0, 1, 0])
    np.testing.assert_array_equal(has(found, Reason.NOT_POSITIVE), [0, 0, 0, 1, 1, 0, 0])
    np.testing.assert_array_equal(has(found, Reason.NEGATIVE_SD), [0, 0, 0, 0, 0, 0, 1])
    np.testing.assert_array_equal(found.valid, [1, 0, 0, 0, 0, 0, 0])
    assert np.isfinite(found.value[0])
    assert np.isnan(found.value[1:]).all()
    alone = estimate(ratio[:1], 0.001)
    assert alone.value[0] == found.value[0]
    assert alone.hi[0] == found.hi[0]


@either
def test_beyond_three_tenths_an_estimate_is_given_but_not_valid(estimate):
    found = estimate(np.array([0.7001, 0.6999, 1.2999, 1.3001]), 0.0)
    np.testing.assert_array_equal(found.valid, [True, False, True, False])
    np.testing.assert_array_equal(has(found, Reason.BEYOND_RECOMMENDED), ~found.valid)
    assert np.isfinite(found.value).all()


@either
def test_the_distance_is_measured_from_the_nominal_damped_frequency(estimate):
    found = estimate(np.array([0.653, 0.655]), 0.0, damping_ratio_0=0.3)
    np.testing.assert_array_equal(has(found, Reason.BEYOND_RECOMMENDED), [True, False])


@either
def test_a_frequency_known_to_a_quarter_is_too_uncertain(estimate):
    found = estimate(np.array([1.0, 1.0]), np.array([0.19, 0.25]))
    np.testing.assert_array_equal(has(found, Reason.TOO_UNCERTAIN), [False, True])


@either
@pytest.mark.parametrize("extreme", [1e-300, 1e-60, 1e-40, 1e40, 1e200])
def test_absurd_frequencies_raise_nothing_and_are_not_valid(estimate, extreme):
    found = estimate(np.array([extreme, 1.0]), np.array([extreme, 0.001]))
    np.testing.assert_array_equal(found.valid, [False, True])


@either
def test_one_value_and_one_per_reading_mean_the_same(estimate):
    ratio = np.linspace(0.8, 1.2, 7)
    each = np.full(7, 0.01)
    one = estimate(ratio, 0.01, damping_ratio_0=0.05, nominal_relative_sd=0.002)
    per = estimate(ratio, each, damping_ratio_0=each * 5, nominal_relative_sd=each / 5)
    for field in ("value", "sd", "lo", "hi", "reasons"):
        np.testing.assert_allclose(getattr(one, field), getattr(per, field), rtol=1e-13)


@either
def test_the_inputs_are_left_as_they_were(estimate):
    ratio, sd = np.array([0.9, np.nan]), np.array([0.01, -1.0])
    before = ratio.copy(), sd.copy()
    estimate(ratio, sd, bounds=(-0.5, 0.5))
    np.testing.assert_array_equal(ratio, before[0])
    np.testing.assert_array_equal(sd, before[1])


@either
def test_no_readings_give_no_estimates(estimate):
    assert len(estimate(np.empty(0), np.empty(0))) == 0
    assert len(estimate(np.empty(0), 0.01, bounds=(-0.5, 0.5))) == 0


@either
@pytest.mark.parametrize(
    ("keywords", "cure"),
    [
        ({"level": 1.0}, "Give 0.95"),
        ({"damping_ratio_0": 2.0}, "not a percentage"),
        ({"damping_ratio_0": -0.1}, "not a percentage"),
        ({"nominal_relative_sd": 0.6}, "estimate it from more epochs"),
        ({"nominal_relative_sd": -0.1}, r"Give sd\(f0\)/f0"),
        ({"bounds": (0.0, -0.9)}, r"Give such as \(-0.9, 0.0\)"),
        ({"bounds": (-1.5, 0.0)}, "not below -1"),
        ({"bounds": (-0.5, np.inf)}, "both finite"),
    ],
)
def test_an_impossible_setting_is_refused_with_its_cure(estimate, keywords, cure):
    with pytest.raises(ValueError, match=cure):
        estimate(np.array([1.0]), 0.001, **keywords)


def test_every_reason_has_a_sentence_with_a_cure():
    for reason in Reason:
        (sentence,) = explain(int(reason))
        assert sentence.count(". ") + sentence.count("; ") >= 1
        assert sentence.endswith(".")


def test_reasons_that_come_together_are_explained_together():
    both = int(Reason.BEYOND_RECOMMENDED | Reason.NOT_SEPARABLE)
    assert explain(both) == explain(int(Reason.BEYOND_RECOMMENDED)) + explain(
        int(Reason.NOT_SEPARABLE)
    )


def test_bits_that_mean_nothing_are_refused():
    with pytest.raises(ValueError, match="bits that mean nothing"):
        explain(1 << 20)


def test_the_refusal_to_separate_says_what_would_separate():
    found = stiffness_and_mass(
        np.array([0.97]), 0.001, np.array([0.02]), 0.5, damping_ratio_0=0.02
    )
    words = " ".join(explain(int(found.mass.reasons[0])))
    for help_ in ("added mass", "measured force", "log of the mass", "static test"):
        assert help_ in words
