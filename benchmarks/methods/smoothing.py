"""What median and EWMA make of frequencies: how late, how alike, how robust, how often right.

    python -m benchmarks.methods.smoothing [--runs 200] [--seed 1]

Windows of a minute of an oscillator that white noise drives (3 Hz, 1 %, 50 Hz; its sampled
impulse response) are read by the FFT alone (`peak`) and by the likelihood (`ambient`). Each run
is long enough for the slowest smoother to settle; its last value counts.
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterator

import numpy as np
from scipy import signal
from scipy.stats import binomtest

from slowtime.identification import identify_ambient
from slowtime.identification.estimates import Identified
from slowtime.identification.single_mode.spectral_peak import peak
from slowtime.signals.smoother_choice import settled_sd
from slowtime.signals.smoothing import MedianEwma

RATE_HZ, WINDOW_S, FREQUENCY_HZ, DAMPING = 50.0, 60.0, 3.0, 0.01
SMOOTHERS = (
    MedianEwma(window=1, a=1.0), MedianEwma(window=5, a=1.0), MedianEwma(window=1, a=0.3),
    MedianEwma(window=5, a=0.3), MedianEwma(window=5, a=0.1), MedianEwma(window=9, a=0.1),
)  # fmt: skip
SETTLED = 30
"""[readings] A run's length: an EWMA of 0.1 has forgotten all but 4 % of its beginning."""
OUTLIER = 20.0
"""[sd of a reading] By how much two readings in a row are too high, six before the last."""
SLOPE = 0.1
"""[sd of a reading] Fall of the frequency from one reading to the next, where it drifts."""


def windows(count: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Yield records of the driven oscillator, one after the other."""
    omega = 2.0 * math.pi * FREQUENCY_HZ
    decay = math.exp(-DAMPING * omega / RATE_HZ)
    turn = omega * math.sqrt(1.0 - DAMPING**2) / RATE_HZ
    zeros, poles = [0.0, decay * math.sin(turn)], [1.0, -2.0 * decay * math.cos(turn), decay**2]
    samples = int(RATE_HZ * WINDOW_S)
    lead = int(RATE_HZ * 10.0 / (DAMPING * omega))
    force = rng.standard_normal(lead + count * samples)
    motion = signal.lfilter(zeros, poles, force)[lead:]
    motion += 0.02 * motion.std() * rng.standard_normal(len(motion))
    yield from motion.reshape(count, samples)


def readings(method: Callable[..., Identified], runs: int, each: int, seed: int) -> np.ndarray:
    """Return frequencies and their standard deviations [Hz], by run, reading and kind."""
    found = []
    for window in windows(runs * each, np.random.default_rng(seed)):
        one = method(window[:, None], RATE_HZ).frequency_hz
        found.append((one.value, one.sd))
    return np.array(found).reshape(runs, each, 2)


def last_values(smoother: MedianEwma, told: np.ndarray) -> np.ndarray:
    """Smoothed value and its standard deviation [Hz] at the end of each run."""
    ends = []
    for run in told:
        state = smoother.start()
        for value, sd in run:
            state, smooth = smoother.step(state, value, sd)
        ends.append((smooth.value, smooth.sd))
    return np.array(ends)


def held(ends: np.ndarray) -> str:
    """Share of values within 1.96 stated standard deviations, and its interval of 95 %."""
    hits = int((np.abs(ends[:, 0] - FREQUENCY_HZ) <= 1.96 * ends[:, 1]).sum())
    lo, hi = binomtest(hits, len(ends)).proportion_ci(method="wilson")
    return f"{100 * hits / len(ends):.0f} ({100 * lo:.0f} to {100 * hi:.0f})"


def to_ninety_percent(smoother: MedianEwma) -> int:
    """Count readings until 90 % of a sudden change is shown."""
    state = smoother.start()
    for number in range(-200, 1000):
        state, smooth = smoother.step(state, float(number > 0), 1.0)
        if smooth.value >= 0.9:
            return number
    raise AssertionError("the step was never shown")


def alike(smoother: MedianEwma) -> float:
    """Return the readings that one independent smoothed value takes, by its correlations."""
    rng = np.random.default_rng(0)
    noise = np.stack([rng.standard_normal(4000), np.ones(4000)], axis=1)
    state, course = smoother.start(), []
    for value, sd in noise:
        state, smooth = smoother.step(state, value, sd)
        course.append(smooth.value)
    x = np.array(course[200:]) - np.mean(course[200:])
    correlation = [float(x[k:] @ x[: len(x) - k]) / float(x @ x) for k in range(100)]
    return 1.0 + 2.0 * sum(correlation[1 : 1 + int(np.argmax(np.array(correlation) < 0.05))])


def main() -> int:
    """Print the table; 1 where a steady frequency is held too seldom."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    status = 0
    print(
        "| readings by | median, a | sd | lag | 90 % of a step | one independent value in | "
        "outliers in a row | steady [%] | with two outliers [%] | drifting [%] |"
    )
    print("|" + "---|" * 10)
    for name, method, smoothers in (
        ("FFT peak", peak, SMOOTHERS), ("likelihood", identify_ambient, SMOOTHERS[:1])
    ):  # fmt: skip
        told = readings(method, args.runs, SETTLED if len(smoothers) > 1 else 7, args.seed)
        one_sd = float(np.median(told[:, :, 1]))
        spoilt, falling = told.copy(), told.copy()
        spoilt[:, -7:-5, 0] += OUTLIER * one_sd
        falling[:, :, 0] -= SLOPE * one_sd * (np.arange(told.shape[1]) - told.shape[1] + 1)
        for smoother in smoothers:
            steady = last_values(smoother, told)
            print(
                f"| {name} | {smoother.window}, {smoother.a:g} | {settled_sd(smoother):.2f} | "
                f"{smoother.lag:.1f} | {to_ninety_percent(smoother)} | {alike(smoother):.1f} | "
                f"{smoother.window // 2} | {held(steady)} | "
                f"{held(last_values(smoother, spoilt))} | "
                f"{held(last_values(smoother, falling))} |",
                flush=True,
            )
            hits = np.abs(steady[:, 0] - FREQUENCY_HZ) <= 1.96 * steady[:, 1]
            status |= binomtest(int(hits.sum()), len(hits), 0.95, "less").pvalue < 0.005
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
