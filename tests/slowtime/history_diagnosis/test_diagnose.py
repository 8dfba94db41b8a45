import dataclasses

import numpy as np
import pytest

from slowtime import history_diagnosis as slow
from tests.slowtime.history_diagnosis import battery
from tests.slowtime.history_diagnosis.histories import hidden

SAMPLE_SEED = 4711  # not used in development
FULL_SEED = 90210

DAY = np.arange(160.0)


def noise(seed=0, sd=0.002):
    return np.random.default_rng(seed).normal(0.0, sd, len(DAY))


def weather(seed=1):
    fresh = np.random.default_rng(seed).normal(0.0, 3.0, len(DAY))
    return 6.0 * np.cos(DAY / 25.0) + fresh


def diagnose(value, *covariates, sd=0.002, **settings):
    return slow.diagnose_history(DAY, value, np.full(len(DAY), sd), covariates, **settings)


def parameter(report, name, place=0):
    return report.effects[place].numbers[name]


@pytest.mark.parametrize(
    "truth", ["temperature_bilinear", pytest.param("sawtooth", marks=pytest.mark.slow)]
)
def test_a_hidden_effect_is_named_and_its_band_is_narrower_and_holds(truth):
    case = hidden((truth,), np.random.default_rng([SAMPLE_SEED, 0]), epochs=160)
    score = battery.judge(case)
    assert score.right
    assert score.width[1] < score.width[0]
    assert score.held[0] >= 0.85 * score.later


@pytest.mark.long
def test_plain_wandering_is_not_called_a_discovery():
    report = slow.diagnose_history(*_past(hidden((), np.random.default_rng(SAMPLE_SEED), 160)))
    assert report.verdict == "nothing_missing"
    assert report.effects == ()
    assert slow.adopt(report) is report.nominal


def _past(case):
    k = case.split
    return case.time[:k], case.value[:k], case.sd[:k], battery.covariates(case, 0, k)


@pytest.mark.long
def test_a_slope_over_temperature_is_told_with_its_unit_and_its_doubt():
    warmth = weather()
    report = diagnose(-0.0011 * warmth + noise(), slow.Covariate("temperature", warmth, "°C"))
    slope = parameter(report, "slope")
    assert slope.unit == "%/K"
    assert abs(slope.value + 0.11) < 3.0 * slope.sd < 0.02
    assert "Stiffness follows temperature, −0.1" in report.sentence
    assert report.residual_white


@pytest.mark.slow
def test_a_bend_at_freezing_is_found_there_with_both_slopes():
    warmth = weather()
    bent = -0.003 * np.minimum(warmth, 0.0) - 0.0005 * np.maximum(warmth, 0.0)
    report = diagnose(bent + noise(), slow.Covariate("temperature", warmth, "°C"))
    assert report.effects[0].effect.kind == "temperature_bilinear"
    for name, truth in (("slope_below", -0.3), ("slope_above", -0.05)):
        found = parameter(report, name)
        assert abs(found.value - truth) < 3.0 * found.sd
    assert abs(parameter(report, "kink").value) < 1.0


@pytest.mark.slow
def test_a_sawtooth_that_falls_back_when_it_likes_is_one_effect():
    falls = np.array([-12.0, 21.0, 60.0, 85.0, 128.0])
    tooth = DAY - falls[np.searchsorted(falls, DAY, side="right") - 1]
    report = diagnose(-0.0004 * tooth + noise())
    assert [e.effect.kind for e in report.effects] == ["sawtooth"]
    rate = parameter(report, "rate")
    assert abs(rate.value + 0.04) < 3.0 * rate.sd
    assert parameter(report, "last_reset_time").value == pytest.approx(128.0, abs=2.0)


@pytest.mark.long
def test_covariates_that_move_together_are_undecided_until_they_part():
    warmth = weather()
    value = -0.0011 * warmth + noise()
    load = 3.0 + 0.4 * warmth
    both = slow.Covariate("temperature", warmth, "°C"), slow.Covariate("load", load, "t")
    report = diagnose(value, *both)
    assert report.verdict == "undecided"
    assert {"temperature_linear", "load_linear"} <= {r.effect for r in report.undecided}
    assert "load and temperature do not move together" in report.experiment.sentence


@pytest.mark.slow
def test_of_covariates_that_move_apart_the_right_one_is_named():
    warmth = weather()
    load = 3.0 + 0.4 * warmth + np.random.default_rng(9).normal(0.0, 1.0, len(DAY))
    both = slow.Covariate("temperature", warmth, "°C"), slow.Covariate("load", load, "t")
    report = diagnose(-0.0011 * warmth + noise(), *both)
    assert [e.effect.kind for e in report.effects] == ["temperature_linear"]


@pytest.mark.long
def test_a_dependence_that_no_law_draws_is_unknown_and_its_curve_is_shown():
    warmth = weather()
    wave = 0.008 * np.sin(warmth / 2.2)
    report = diagnose(wave + noise(), slow.Covariate("temperature", warmth, "°C"))
    assert report.verdict == "unknown_effect"
    curve = report.curves[0]
    assert curve is not None
    inner = np.abs(curve.x - warmth.mean()) < warmth.std()
    truth = 0.008 * np.sin(curve.x[inner] / 2.2)
    assert np.corrcoef(curve.value[inner], truth)[0, 1] > 0.95


@pytest.mark.slow
def test_stated_errors_that_are_too_small_are_found_out():
    report = diagnose(noise(sd=0.003))
    assert report.verdict == "nothing_missing"
    assert report.noise_factor == pytest.approx(1.5, rel=0.12)


@pytest.mark.slow
def test_a_wrong_reading_on_the_coldest_day_is_no_law_of_cold_days():
    warmth = weather()
    warmth[70] = warmth.min() - 8.0
    value = noise()
    value[70] += 0.05
    report = diagnose(value, slow.Covariate("temperature", warmth, "°C"))
    assert report.effects == ()


@pytest.mark.long
def test_another_mode_read_in_the_place_of_this_one_is_a_fault_of_the_sensor():
    value = noise()
    odd = np.random.default_rng(3).choice(len(DAY), 10, replace=False)
    value[odd] += 0.08
    report = diagnose(value)
    assert report.verdict == "sensor_fault"
    assert report.effects[0].effect.kind == "mode_swap"
    assert set(report.swapped) == set(DAY[odd])


@pytest.mark.long
def test_a_mode_that_leaves_the_others_is_a_fault_of_its_sensor():
    three = np.column_stack([noise(seed) for seed in range(3)])
    three[100:, 1] += 0.01
    report = diagnose_many(three)
    assert report.verdict == "sensor_fault"
    assert [e.effect.kind for e in report.effects] == ["sensor_change"]
    assert parameter(report, "mode").value == 1
    assert parameter(report, "time").value == pytest.approx(99.5, abs=1.0)


@pytest.mark.slow
def test_all_modes_together_make_a_step_of_the_structure():
    three = np.column_stack([noise(seed) for seed in range(3)])
    three[100:] += 0.01 * np.array([1.0, 0.7, 1.2])
    report = diagnose_many(three)
    assert [e.effect.kind for e in report.effects] == ["step"]


def diagnose_many(values):
    return slow.diagnose_history(DAY, values, np.full(values.shape, 0.002))


@pytest.mark.slow
def test_two_effects_are_found_one_by_one_and_can_be_adopted_one_by_one():
    warmth = weather()
    value = -0.0011 * warmth + 0.01 * (DAY > 90) + noise()
    covariate = slow.Covariate("temperature", warmth, "°C")
    report = diagnose(value, covariate)
    assert {e.effect.kind for e in report.effects} == {"temperature_linear", "step"}
    place = [e.effect.kind for e in report.effects].index("step")
    model = slow.adopt(report, [place])
    assert model.names == ("step",)
    assert slow.undo(model) is report.nominal


@pytest.mark.slow
def test_order_unit_and_scale_of_the_readings_do_not_matter():
    warmth = weather()
    value = -0.0011 * warmth + noise()
    plain = diagnose(value, slow.Covariate("temperature", warmth, "°C"))
    turned = slow.diagnose_history(
        86400.0 * DAY[::-1],
        7.0 + 1e3 * value[::-1],
        np.full(len(DAY), 2.0),
        [slow.Covariate("temperature", warmth[::-1], "°C")],
        time_unit="s",
    )
    assert [e.effect.kind for e in turned.effects] == [e.effect.kind for e in plain.effects]
    first, second = (parameter(r, "slope") for r in (plain, turned))
    assert second.value == pytest.approx(1e3 * first.value, rel=1e-3)


@pytest.mark.slow
def test_inputs_are_left_as_they_were_and_the_answer_is_the_same_again():
    case = hidden(("load_linear",), np.random.default_rng(5), 200)
    kept = dataclasses.replace(case, value=case.value.copy(), time=case.time.copy())
    first = slow.diagnose_history(*_past(case))
    second = slow.diagnose_history(*_past(case))
    np.testing.assert_array_equal(case.value, kept.value)
    np.testing.assert_array_equal(case.time, kept.time)
    assert first.sentence == second.sentence
    assert first.effects[0].probability == second.effects[0].probability


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"sd": np.zeros(160)}, "Every standard deviation is 0.*Give that of each value"),
        ({"value": np.full(160, np.nan)}, "0 of 160 epochs.*At least 20.*wait"),
    ],
)
def test_histories_that_cannot_be_used_say_what_to_change(change, told):
    given = {"slow_time": DAY, "value": noise(), "sd": np.full(160, 0.002)} | change
    with pytest.raises(ValueError, match=told):
        slow.diagnose_history(**given)


def test_a_covariate_of_another_length_says_which():
    with pytest.raises(ValueError, match=r"160 slow times were given, but .*'load'.: 7"):
        diagnose(noise(), slow.Covariate("load", np.ones(7), "t"))


@pytest.mark.slow
def test_a_covariate_that_never_changes_is_said_to_be_ignored():
    report = diagnose(noise(), slow.Covariate("load", np.full(160, 3.0), "t"))
    assert report.ignored == ("load",)


@pytest.mark.slow
def test_progress_is_told_and_ends():
    told = []
    diagnose(noise(), progress=lambda word, share: told.append((word, share)))
    assert told[-1] == ("done", 1.0)
    assert [share for _, share in told] == sorted(share for _, share in told)


@pytest.mark.slow
def test_of_a_hundred_hidden_effects_nine_in_ten_are_named_and_their_bands_hold():
    scores = [battery.judge(case) for case in battery.cases("single", 100, FULL_SEED)]
    assert sum(s.right for s in scores) >= 90, battery.table("single", scores)
    adopted = [s for s in scores if s.named]
    later = sum(s.later for s in adopted)
    for held in (0, 1):
        assert 0.90 <= sum(s.held[held] for s in adopted) / later <= 0.98
    assert np.median([s.width[1] / s.width[0] for s in adopted]) < 0.7


@pytest.mark.slow
def test_of_150_histories_without_any_at_most_3_in_100_are_given_one():
    scores = [battery.judge(case) for case in battery.cases("none", 150, FULL_SEED)]
    assert sum(bool(s.named) for s in scores) <= 4, battery.table("none", scores)
