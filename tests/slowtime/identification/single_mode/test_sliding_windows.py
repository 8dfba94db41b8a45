import pickle

import numpy as np
import pytest

from slowtime.identification import Tracker, first_mode, identify_windows
from slowtime.identification.single_mode.sliding_windows import dependence

RATE = 400.0


def hopping(rng):
    """Two seconds at 20 Hz, then two at 26 Hz, each set off by a blow, and two of silence."""
    times = np.arange(800) / RATE
    parts = [np.exp(-1.5 * times) * np.cos(2 * np.pi * f * times) for f in (20.0, 26.0)]
    record = np.concatenate([*parts, np.zeros(800)])
    return record + 2e-3 * rng.standard_normal(len(record))


@pytest.mark.long
def test_windows_follow_a_jump_and_claim_nothing_in_silence():
    record = hopping(np.random.default_rng(1))
    epochs = identify_windows(record, RATE, window_s=1.0, hop_s=0.25)
    assert [epoch.start_s for epoch in epochs] == pytest.approx(np.arange(0, 5.01, 0.25))
    for epoch in epochs:
        assert epoch.end_s - epoch.start_s == pytest.approx(1.0)
        if epoch.start_s >= 4.0:
            assert epoch.modes == ()
        elif not 1.2 < epoch.start_s < 2.0 and epoch.end_s <= 4.0:
            truth = 20.0 if epoch.end_s <= 2.5 else 26.0
            assert epoch.modes[0].frequency_hz.value == pytest.approx(truth, abs=0.1)


@pytest.mark.long
def test_the_steps_of_the_tracker_give_what_the_whole_record_gives():
    record = hopping(np.random.default_rng(2))
    epochs = identify_windows(record, RATE, window_s=1.0, hop_s=0.5, follow=True)
    tracker = Tracker(rate_hz=RATE, follow=True)
    state = tracker.start()
    for epoch in epochs:
        first = round(epoch.start_s * RATE)
        # A state that was stored and read back goes on as if it never had been.
        state = pickle.loads(pickle.dumps(state))
        state, mode = tracker.step(state, record[first : first + 400])
        assert ((mode,) if mode else ()) == epoch.modes


@pytest.mark.long
def test_without_following_every_window_stands_alone():
    record = hopping(np.random.default_rng(3))
    for epoch in identify_windows(record, RATE, window_s=1.0, hop_s=0.7):
        first = round(epoch.start_s * RATE)
        mode = first_mode(record[first : first + 400], RATE)
        assert epoch.modes == ((mode,) if mode else ())


def test_windows_touch_unless_they_are_told_to_overlap():
    record = np.random.default_rng(5).standard_normal(2400)
    epochs = identify_windows(record, RATE, window_s=2.0, method="peak")
    assert [(e.start_s, e.end_s) for e in epochs] == [(0.0, 2.0), (2.0, 4.0), (4.0, 6.0)]


@pytest.mark.parametrize("overlap", [1, 4, 5])
def test_overlapping_windows_count_for_what_their_samples_are_worth(overlap):
    """The mean of windows, taken for independent with that variance, is as sure as it says."""
    rng, count = np.random.default_rng(6), 40 * overlap
    samples = rng.standard_normal((2000, count + overlap - 1))
    means = np.stack([samples[:, k : k + overlap].mean(axis=1) for k in range(count)], axis=1)
    starts = np.arange(count, dtype=float)
    factor = dependence(starts, starts + overlap)
    said = np.sqrt(np.sum(factor / overlap)) / count
    assert np.std(means.mean(axis=1)) == pytest.approx(said, rel=0.06)


def test_a_gap_spoils_its_own_windows_only_and_says_why():
    record = hopping(np.random.default_rng(4))
    record[850] = np.nan
    epochs = identify_windows(record, RATE, window_s=1.0, hop_s=1.0)
    assert [bool(epoch.refused) for epoch in epochs] == [
        False,
        False,
        True,
        False,
        False,
        False,
    ]
    assert "NaN" in (epochs[2].refused or "")
    assert epochs[0].modes
    with pytest.raises(ValueError, match=r"Not one window could be used.*NaN"):
        identify_windows(np.full(2000, np.nan), RATE, window_s=1.0)
