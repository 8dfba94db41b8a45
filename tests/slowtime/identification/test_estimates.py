"""Real records: what was measured against what is known of the structures.

Run as a script, it prints the table of dwells, truth, estimate and standard deviation.
"""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import median_filter, uniform_filter1d

from slowtime.identification import all_modes, first_mode, identify_windows

RATE = 5000.0
VOLTS, HERTZ = np.array(
    [[1.2, 26.27], [1.6, 28.23], [2.1, 30.82], [2.5, 33.87], [2.9, 37.55], [3.4, 41.96]]
).T
TRIALS = ["slow10_test0.txt", "slow10_test1.txt"]
FIRST_OF_ALL = [TRIALS[0], pytest.param(TRIALS[1], marks=pytest.mark.slow)]


def load(path):
    return np.loadtxt(path, skiprows=9)


def dwells(position, longer_than_s):
    """(start, end, known frequency) of every rest of the roller, moves and all excluded."""
    smooth = uniform_filter1d(median_filter(position, 51), 51)
    speed = np.abs(smooth[100:] - smooth[:-100]) * RATE / 100
    resting = np.concatenate([[False] * 50, speed < 0.6, [False] * 50])
    resting[:50], resting[-50:] = resting[50], resting[-51]
    edges = np.flatnonzero(np.diff(resting.astype(int), prepend=0, append=0))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first > longer_than_s * RATE:
            volts = np.median(position[first:last])
            yield first / RATE, last / RATE, HERTZ[np.argmin(np.abs(VOLTS - volts))]


def rows(path, window_s, hop_s=None, offset=0):
    """Give of each dwell start, end, truth, and the windows that lie mostly in it."""
    record = load(path)
    epochs = identify_windows(record[offset:, :2], RATE, window_s=window_s, hop_s=hop_s)
    for start, end, truth in dwells(record[:, 2], 0.8):
        inside = [
            epoch
            for epoch in epochs
            if min(end, epoch.end_s + offset / RATE) - max(start, epoch.start_s + offset / RATE)
            > 0.75 * window_s
        ]
        yield start, end, truth, inside


@pytest.mark.long
@pytest.mark.data
@pytest.mark.parametrize(
    ("window_s", "offset"), [(1.0, 0), pytest.param(0.5, 301, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("trial", FIRST_OF_ALL)
def test_the_first_frequency_is_right_on_every_dwell_however_windows_fall(
    data, trial, window_s, offset
):
    seen = 0
    for start, end, truth, inside in rows(
        data / "moving_roller" / trial, window_s, window_s / 4, offset
    ):
        assert inside, f"no window in the dwell from {start} s to {end} s"
        for epoch in inside:
            assert epoch.modes, f"nothing found in the window from {epoch.start_s} s"
            found = epoch.modes[0].frequency_hz
            error = abs(found.value - truth)
            assert error < 0.5 or error < 2.5 * found.sd < 2.5, (epoch.start_s, truth, found)
        seen += 1
    assert seen >= 9


@pytest.mark.long
@pytest.mark.data
@pytest.mark.parametrize("trial", FIRST_OF_ALL)
def test_no_window_at_all_jumps_to_the_second_mode(data, trial):
    record = load(data / "moving_roller" / trial)
    epochs = identify_windows(record[:, :2], RATE, window_s=1.0, hop_s=0.37)
    found = [mode.frequency_hz.value for epoch in epochs for mode in epoch.modes]
    assert len(found) > 0.85 * len(epochs)
    assert 20.0 < min(found)
    assert max(found) < 45.0


@pytest.mark.long
@pytest.mark.data
def test_the_published_modes_of_the_steel_frame_are_found(data):
    record = np.load(data / "steel_frame" / "measurement_1.npy")[:, 3:5]
    first = first_mode(record, 256.0)
    assert first is not None
    assert abs(first.frequency_hz.value - 1.2283) < 2.5 * first.frequency_hz.sd
    assert first.frequency_hz.sd < 0.004
    modes = all_modes(record, 256.0, band_hz=(0.8, 10.0))
    published = [1.2283, 1.4358, 2.1000, 4.0175, 4.7704, 6.6824, 7.6157, 9.6653]
    assert len(modes) == len(published)
    for mode, truth in zip(modes, published, strict=True):
        assert abs(mode.frequency_hz.value - truth) < 3 * mode.frequency_hz.sd


if __name__ == "__main__":
    folder = Path(os.environ.get("SLOWTIME_DATA", Path(__file__).parents[4] / "shared/data"))
    for name in TRIALS:
        print(f"{name}\n   dwell [s]      known     estimate of the window deepest in it")
        for begin, stop, known, within in rows(folder / "moving_roller" / name, 1.0):
            deepest = max(within, key=lambda e: min(stop, e.end_s) - max(begin, e.start_s))
            mode = deepest.modes[0]
            f = mode.frequency_hz
            print(
                f"{begin:6.2f}-{stop:5.2f}  {known:8.2f}  {f.value:8.3f} +- {f.sd:.3f} Hz  "
                f"zeta {mode.damping_ratio.value:.4f}  {mode.method} {' '.join(mode.flags)}"
            )
