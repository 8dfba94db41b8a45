"""Channels whose values are no measurements of their own."""

import numpy as np
import scipy.integrate
import scipy.signal

from slowtime.signals.value_checks import value_notes

RNG = np.random.default_rng(11)
RATE = 200.0


def motion(count: int = 4000) -> np.ndarray:
    """Acceleration of two modes under random force."""
    force = RNG.standard_normal(count)
    low = scipy.signal.lfilter(*scipy.signal.iirpeak(4.0, 8.0, RATE), force)
    high = scipy.signal.lfilter(*scipy.signal.iirpeak(11.0, 8.0, RATE), force)
    return np.asarray(low + 0.5 * high)


def test_good_channels_of_one_structure_say_nothing():
    first = motion()
    second = 0.8 * first + 0.05 * RNG.standard_normal(len(first))
    assert value_notes(np.column_stack([first, second, motion()]), ("a", "b", "c")) == ()


def test_a_copy_is_named_whatever_its_gain_and_digits():
    first = motion()
    copy = np.round(-9.81 * first + 2.0, 5)
    (said,) = value_notes(np.column_stack([first, copy, motion()]), ("a", "b", "c"))
    assert said.startswith("Channel 'b' is a copy of 'a'")


def test_an_integral_is_named():
    first = motion()
    velocity = scipy.integrate.cumulative_trapezoid(first, dx=1 / RATE, initial=0)
    (said,) = value_notes(np.column_stack([velocity, first]), ("v", "a"))
    assert said.startswith("Channel 'v' is the integral of 'a'")


def test_a_clipped_a_stuck_and_a_coarse_channel_are_named():
    first = motion()
    clipped = np.clip(first, -1.5 * first.std(), 1.5 * first.std())
    stuck = motion()
    stuck[1000:1400] = stuck[1000]
    coarse = np.sign(np.round(motion() / first.std()))
    columns = np.column_stack([first, clipped, stuck, coarse])
    said = value_notes(columns, ("a", "b", "c", "d"))
    assert [text.split(" in ")[0].split(" has ")[0] for text in said] == [
        "Channel 'b' is clipped", "Channel 'c' is stuck", "Channel 'd'",
    ]  # fmt: skip


def test_a_bit_that_never_changes_is_named():
    codes = np.round(3000 * motion()).astype(np.int64)
    for bit in (2, 5):
        stuck = (codes & ~(1 << bit)) * 0.061
        (said,) = value_notes(np.column_stack([stuck, motion()]), ("a", "b"))
        assert said.startswith(f"Channel 'a': bit {bit} of its values never changes")
    assert value_notes(np.column_stack([codes * 0.061, motion()]), ("a", "b")) == ()


def hum(times, size, grid_hz=49.97):
    """Hum of a grid that wanders by a hundredth of a hertz, with a third multiple."""
    phase = 2 * np.pi * (grid_hz * times + 0.05 * np.sin(2 * np.pi * times / 40.0))
    return size * (np.sin(phase) + 0.1 * np.sin(3 * phase))


def test_hum_of_the_mains_is_named_folded_too():
    first = motion(12_000)
    times = np.arange(len(first)) / RATE
    (said,) = value_notes((first + hum(times, 0.5 * first.std()))[:, None], ("a",), RATE)
    assert said.startswith("Channel 'a' has hum of the mains (50 Hz)")
    # At 82 Hz, 59.9 Hz lie at 22.1 Hz.
    slow = scipy.signal.resample_poly(motion(12_000), 41, 100)
    times = np.arange(len(slow)) / 82.0
    (said,) = value_notes((slow + hum(times, slow.std(), 59.9))[:, None], ("a",), 82.0)
    assert "(60 Hz)" in said
    assert "at 22" in said


def test_a_mode_at_the_frequency_of_the_mains_is_no_hum():
    """Of 0.2 % damping, under a random force and in decay."""
    pole = np.exp((-0.002 + 1j) * 2 * np.pi * 50.0 / RATE)
    a = [1.0, -2 * pole.real, abs(pole) ** 2]
    random = scipy.signal.lfilter([1.0], a, RNG.standard_normal(24_000))
    decay = np.abs(pole) ** np.arange(24_000) * np.cos(np.angle(pole) * np.arange(24_000))
    assert value_notes(random[:, None], ("a",), RATE) == ()
    assert value_notes(decay[:, None] + 1e-3 * motion(24_000)[:, None], ("a",), RATE) == ()


def test_the_magnitude_of_a_spectrum_is_told_from_records_in_time():
    hz = np.arange(1, 1001) * 0.05
    power = sum(1 / ((f**2 - hz**2) ** 2 + (0.02 * f * hz) ** 2) for f in (5.0, 12.0, 31.0))
    noisy = power * RNG.chisquare(40, len(hz)) / 40
    (said,) = value_notes(noisy[:, None], ("a",))
    assert said.startswith("Channel 'a' is positive throughout")
    assert "Export the time histories" in said
    decay = np.exp(-np.arange(1000) / 60.0)
    envelope = np.abs(scipy.signal.hilbert(motion(1000)))
    assert value_notes(np.column_stack([decay, envelope, 9.81 + motion(1000)]), "dea") == ()
