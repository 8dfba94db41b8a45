import dataclasses

import numpy as np
import pytest

from slowtime import history_diagnosis as slow
from slowtime.history_diagnosis.data.history import FeatureHistory
from slowtime.history_diagnosis.laws.terms import ScreenedHistory

DAY = np.arange(230.0)
PAST_EPOCHS = 160


@pytest.fixture(scope="module")
def adopted():
    rng = np.random.default_rng(2)
    warmth = 6.0 * np.cos(DAY / 25.0) + rng.normal(0.0, 3.0, len(DAY))
    value = -0.0011 * warmth + rng.normal(0.0, 0.002, len(DAY))
    sd = np.full(len(DAY), 0.002)
    report = slow.diagnose_history(
        DAY[:PAST_EPOCHS],
        value[:PAST_EPOCHS],
        sd[:PAST_EPOCHS],
        [slow.Covariate("temperature", warmth[:PAST_EPOCHS], "°C")],
    )
    return (
        report,
        DAY[PAST_EPOCHS:],
        value[PAST_EPOCHS:],
        sd[PAST_EPOCHS:],
        warmth[PAST_EPOCHS:],
    )


def told(warmth):
    return (slow.Covariate("temperature", warmth, "°C"),)


@pytest.mark.long
def test_what_is_adopted_foretells_better_and_undone_it_does_not(adopted):
    report, time, value, sd, warmth = adopted
    model = slow.adopt(report)
    nominal = slow.undo(model)
    after = slow.forecast(model, time, sd, told(warmth))
    before = slow.forecast(nominal, time, sd, told(warmth))
    assert np.mean(after.sd) < 0.5 * np.mean(before.sd)
    held = np.mean((value >= after.lo) & (value <= after.hi))
    assert 0.88 <= held <= 1.0
    with pytest.raises(ValueError, match="nothing was adopted"):
        slow.undo(nominal)


def test_undoing_goes_back_one_adoption_at_a_time_and_not_beyond_the_nominal_model():
    # `undo` reads nothing of a model but the one before it.
    past, readings = object.__new__(FeatureHistory), object.__new__(ScreenedHistory)
    nominal = slow.MixtureModel(past, readings, ())
    first = dataclasses.replace(nominal, names=("step",), before=nominal)
    second = dataclasses.replace(first, names=("step", "drift_linear"), before=first)
    assert slow.undo(second) is first
    assert slow.undo(slow.undo(second)) is nominal
    with pytest.raises(ValueError, match=r"nothing was adopted.*Undo a model that `adopt`"):
        slow.undo(nominal)


@pytest.mark.long
def test_following_without_readings_is_forecasting(adopted):
    report, time, _, sd, warmth = adopted
    model = slow.adopt(report)
    ahead = slow.forecast(model, time, sd, told(warmth))
    blind = slow.follow(model, time, np.full(len(time), np.nan), sd, told(warmth))
    np.testing.assert_array_equal(ahead.mean, blind.mean)
    assert not blind.accepted.any()


@pytest.mark.long
def test_following_in_parts_of_the_readings_expects_the_first_alike(adopted):
    report, time, value, sd, warmth = adopted
    model = slow.adopt(report)
    whole = slow.follow(model, time, value, sd, told(warmth))
    part = slow.follow(model, time[:30], value[:30], sd[:30], told(warmth[:30]))
    np.testing.assert_allclose(part.mean, whole.mean[:30], rtol=1e-9)
    np.testing.assert_allclose(part.sd, whole.sd[:30], rtol=1e-9)


def test_readings_followed_are_those_of_a_history_that_long(adopted):
    """Coefficients learnt one reading at a time are those of least squares over all."""
    report, time, value, sd, warmth = adopted
    still = next(member for member in report.augmented.members if member.process.sd == 0.0)
    one = slow.MixtureModel(report.augmented.past, report.augmented.readings, (still,))
    followed = slow.follow(one, time, value, sd, told(warmth))
    columns = np.column_stack(
        [np.ones(PAST_EPOCHS), report.augmented.past.covariates[0].values]
    )
    later = np.column_stack([np.ones(len(time)), warmth])
    past = report.augmented.past
    for i in (0, 20, 60):
        x = np.concatenate([columns, later[:i]])
        y = np.concatenate([past.value, value[:i]])
        used = np.concatenate([report.augmented.readings.mask, followed.accepted[:i]])
        line = np.linalg.lstsq(x[used], y[used], rcond=None)[0]
        assert followed.mean[i] == pytest.approx(later[i] @ line, abs=3e-4)


def test_a_missing_covariate_widens_the_band_and_nothing_else(adopted):
    report, time, _, sd, warmth = adopted
    gap = warmth.copy()
    gap[30:40] = np.nan
    model = slow.adopt(report)
    whole = slow.forecast(model, time, sd, told(warmth))
    holed = slow.forecast(model, time, sd, told(gap))
    assert np.all(holed.sd[30:40] > 1.3 * whole.sd[30:40])
    np.testing.assert_allclose(holed.mean[:30], whole.mean[:30], rtol=1e-6)


def test_a_wild_reading_is_passed_over_but_a_lasting_change_is_believed(adopted):
    report, time, value, sd, warmth = adopted
    model = slow.adopt(report)
    wild = value.copy()
    wild[20] += 0.05
    wild[50:] += 0.05
    followed = slow.follow(model, time, wild, sd, told(warmth))
    assert not followed.accepted[20]
    assert abs(followed.mean[21] - value[21]) < 0.01
    assert followed.accepted[55:].all()


def test_a_covariate_the_model_follows_has_to_be_given(adopted):
    report, time, _, sd, _ = adopted
    with pytest.raises(ValueError, match=r"follows \['temperature'\].*Give them too"):
        slow.forecast(slow.adopt(report), time, sd)


def test_later_epochs_are_later(adopted):
    report, time, _, sd, warmth = adopted
    with pytest.raises(ValueError, match="the history ends at 159"):
        slow.forecast(slow.adopt(report), time - 50.0, sd, told(warmth))
