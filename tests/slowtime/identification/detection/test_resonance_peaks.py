import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import find_peaks

from slowtime.identification.detection import resonance_peaks
from slowtime.identification.detection.resonance_peaks import (
    SMOOTHING,
    detect_peaks,
    separate_peaks,
)


def by_comparing_all(level_db, tops, valley_db):
    """From the highest down, the peaks with a valley on the way to each higher one kept."""
    kept: list[int] = []
    for place in np.argsort(-level_db[tops]).tolist():
        top, ceiling = tops[place], level_db[tops[place]] - valley_db[place]
        if all(level_db[min(top, k) : max(top, k)].min() < ceiling for k in kept):
            kept.append(top)
    return sorted(kept)


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(3, 600),
    steps=st.sampled_from([0.0, 1.0, 3.0]),
    valley=st.floats(0.0, 20.0),
)
def test_separate_peaks_are_those_that_comparing_all_of_them_leaves(seed, count, steps, valley):
    rng = np.random.default_rng(seed)
    level = np.cumsum(rng.standard_normal(count)) + 3 * rng.standard_normal(count)
    # Whole decibels make peaks of equal height, and valleys that just reach.
    level = level if steps == 0 else np.round(level / steps) * steps
    tops = find_peaks(level)[0]
    needed = np.round(valley + rng.uniform(0.0, 4.0, len(tops)))
    assert separate_peaks(level, tops, needed) == by_comparing_all(level, tops, needed)


def test_a_spectrum_without_peaks_has_none_that_are_separate():
    assert separate_peaks(np.zeros(9), np.array([], dtype=int), np.array([])) == []


def test_the_work_of_separating_peaks_grows_in_proportion_to_their_number(monkeypatch):
    looked_at: list[int] = []
    inner = resonance_peaks._least

    def counted(*given):
        looked_at.append(0)
        return inner(*given)

    monkeypatch.setattr(resonance_peaks, "_least", counted)

    def comparisons(count):
        looked_at.clear()
        level = np.random.default_rng(1).standard_normal(2 * count)
        tops = find_peaks(level)[0]
        separate_peaks(level, tops, np.zeros(len(tops)))
        return len(looked_at) / len(tops)

    assert comparisons(8000) <= 2.0
    assert comparisons(8000) < 1.1 * comparisons(1000)


def test_peaks_of_a_long_record_are_those_of_its_modes():
    seconds = np.arange(400_000) / 1000.0
    rng = np.random.default_rng(2)
    lines = sum(np.cos(2 * np.pi * hz * seconds) for hz in (7.3, 31.0, 200.5))
    record = 0.3 * lines + rng.standard_normal(len(seconds))
    found = detect_peaks(record[:, None], 1000.0, 1.0, 450.0)
    assert len(found) == 3
    for one, hz in zip(found, (7.3, 31.0, 200.5), strict=True):
        assert abs(one.frequency_hz / hz - 1) <= SMOOTHING
