import math

import numpy as np
import pytest

from slowtime.discrepancy.data.screening import screen, screen_records
from slowtime.discrepancy.records import Trial

RATE = 100.0


def wave(seed=0, samples=3000, noise=0.01):
    rng = np.random.default_rng(seed)
    times = np.arange(samples) / RATE
    return np.sin(2 * np.pi * 1.3 * times) + noise * rng.standard_normal(samples)


def screened(samples, inputs=None):
    inputs = np.zeros((len(samples), 0)) if inputs is None else inputs
    trial = Trial(inputs=inputs, outputs=samples[:, None], rate_hz=RATE, start_s=5.0)
    return screen(trial, ["x"])


def found(samples, inputs=None):
    return [finding.fault for finding in screened(samples, inputs).findings]


@pytest.mark.parametrize("seed", range(100))
def test_a_sound_channel_has_no_findings(seed):
    assert found(wave(seed)) == []


@pytest.mark.parametrize("step", [0.3, 0.1, 0.01])
def test_a_coarse_converter_is_no_fault(step):
    assert found(np.round(wave(1) / step) * step) == []


@pytest.mark.parametrize("held", [2, 3, 5])
def test_a_row_is_stuck_once_the_record_s_own_repeats_make_it_one_in_a_million(held):
    """A converter that tells each value `held` times repeats itself by a share 1 - 1 / held."""
    count = 3000
    coarse = np.repeat(wave(2)[: count // held], held)
    longest = math.log(1e-6 / count) / math.log(1.0 - 1.0 / held)

    def with_a_row_of(length):
        samples = coarse.copy()
        samples[1200 : 1200 + round(length)] = 0.31
        return found(samples)

    assert with_a_row_of(0.9 * longest) == []
    assert with_a_row_of(1.1 * longest) == ["stuck"]


@pytest.mark.parametrize("held", [6, 7, 12])
def test_a_slow_converter_that_holds_every_value_alike_is_no_fault(held):
    """No row is shorter than the rows in question, so that nothing is known of its habit."""
    assert found(np.repeat(wave(3)[:60], held)) == []


@pytest.mark.parametrize(("value", "fault"), [(0.0, "zero"), (0.7, "stuck")])
def test_a_value_that_stays_is_masked_to_the_sample(value, fault):
    samples = wave()
    samples[1000:1080] = value
    result = screened(samples)
    assert [finding.fault for finding in result.findings] == [fault]
    assert result.findings[0].spans_s == ((15.0, 15.8),)
    assert set(np.flatnonzero(~result.trial.used)) == set(range(1000, 1080))


def test_an_instant_is_known_to_a_sample_and_a_level_to_its_scatter():
    samples = wave()
    samples[1000:1080] = 0.0
    (silent,) = screened(samples).findings
    # An end that lies anywhere between two samples, told as the later of them.
    assert silent.instant_sd == pytest.approx(1 / RATE / np.sqrt(3))
    assert (silent.level, silent.level_sd) == (0.0, 0.0)
    (clipped,) = screened(np.clip(wave(), -0.8, 0.8)).findings
    assert clipped.level == 0.8
    assert clipped.level_sd == pytest.approx(0.8 * np.finfo(np.float32).eps)
    (uneven,) = screened(np.clip(wave(), -0.80, 0.79)).findings
    assert uneven.level_sd == pytest.approx(0.005, rel=0.1)


def test_clipping_is_found_on_either_side_and_masked():
    samples = wave()
    for clipped in (np.minimum(samples, 0.8), np.maximum(samples, -0.8)):
        result = screened(clipped)
        assert [finding.fault for finding in result.findings] == ["clipped"]
        level, used = np.abs(clipped) == 0.8, result.trial.used[:, 0]
        assert not used[level].any()
        # What lies beside a peak is left out with it, and nothing else.
        assert not used[np.flatnonzero(level[1:] & ~level[:-1])].any()
        assert used[np.abs(clipped) < 0.6].all()


def topped(value, size=0.75):
    """A wave that stays once, at its highest, for a moment."""
    samples = size * wave() / np.abs(wave()).max()
    once = int(np.argmax(samples))
    samples[once - 5 : once + 6] = value
    return samples


def test_where_one_stop_is_reached_a_single_row_at_the_other_is_one_too():
    assert found(topped(0.8)) == ["stuck"]
    assert found(np.maximum(topped(0.8), -0.7)) == ["clipped"]


def test_what_one_record_tells_of_a_stop_holds_in_all_of_a_campaign():
    trials = [
        Trial(inputs=np.zeros((len(x), 0)), outputs=x[:, None], rate_hz=RATE)
        for x in (topped(0.8), np.clip(wave(), -0.8, 0.8), topped(0.77))
    ]
    told = [[f.fault for f in one.findings] for one in screen_records(trials, ["a"])]
    assert told == [["clipped"], ["clipped"], ["stuck"]]
    (alone,) = screen_records(trials[:1], ["a"])
    assert [f.fault for f in alone.findings] == ["stuck"]


def test_numbers_that_are_none_are_told_and_masked():
    samples = wave()
    samples[10:20] = np.nan
    samples[50] = np.inf
    result = screened(samples)
    assert [finding.fault for finding in result.findings] == ["missing"]
    assert result.findings[0].spans_s == ((5.1, 5.2), (5.5, 5.51))
    assert result.findings[0].share == pytest.approx(11 / 3000)


def test_a_channel_that_never_moves_is_masked_throughout():
    result = screened(np.full(500, 3.2))
    assert [finding.fault for finding in result.findings] == ["constant"]
    assert not result.trial.used.any()


def test_rest_before_the_input_moves_is_no_fault():
    samples, inputs = wave(), np.ones((3000, 1))
    samples[:400], inputs[:400] = 0.0, 0.0
    assert found(samples, inputs) == []
    assert found(samples) == ["zero"]


def test_the_record_itself_is_left_as_it_was():
    samples = wave()
    samples[1000:1080] = 0.0
    trial = Trial(inputs=np.zeros((3000, 0)), outputs=samples[:, None], rate_hz=RATE)
    screen(trial)
    assert trial.used.all()


@pytest.mark.parametrize("step", [0.05, 0.005])
@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_what_is_left_beside_a_clipped_peak_is_not_what_noise_pulled_down(noise, step):
    rng = np.random.default_rng(4)
    clean = np.sin(step * np.arange(40_000.0))
    level = 0.8
    wrong = np.clip(clean + noise * rng.standard_normal(len(clean)), -level, level)
    trial = Trial(inputs=np.zeros((len(clean), 0)), outputs=wrong[:, None], rate_hz=100.0)
    screened = screen(trial, ["x"])
    (finding,) = screened.findings
    assert finding.fault == "clipped"
    assert finding.share == pytest.approx(np.mean(np.abs(wrong) == level))
    beside = np.abs(np.abs(clean) - level) < 3 * noise
    left = (wrong - clean) * np.sign(clean)

    def bias(use):
        seen = left[use & beside]
        return seen.mean() / (noise / np.sqrt(max(len(seen), 1))) if len(seen) > 3 else 0.0

    assert abs(bias(screened.trial.used[:, 0])) < 4.0
    assert bias(np.abs(wrong) < level) < -6.0


@pytest.mark.parametrize("step", [0.2, 0.8, 1.5, 2.0])
def test_however_fast_it_moves_no_more_is_masked_than_lies_beside_a_peak(step):
    rng = np.random.default_rng(9)
    clean = np.sin(step * np.arange(3000.0)) + 0.002 * rng.standard_normal(3000)
    result = screened(np.clip(clean, -0.98, 0.98))
    clipped = np.mean(np.abs(clean) > 0.98)
    assert [finding.fault for finding in result.findings] == ["clipped"]
    assert 1 - result.trial.used.mean() < 4 * clipped


def test_where_every_other_sample_is_missing_nothing_is_said_of_noise():
    samples = np.clip(wave(), -0.8, 0.8)
    samples[::2] = np.nan
    assert "clipped" in found(samples)


@pytest.mark.parametrize("others", [[], [700]])
def test_who_is_stuck_at_the_highest_value_is_not_cut_off_there(others):
    samples = wave()
    for begin in (int(np.argmax(samples)), *others):
        samples[begin : begin + 60] = samples[begin]
    assert found(samples) == ["stuck"]
