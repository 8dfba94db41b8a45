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
