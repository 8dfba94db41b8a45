"""Values that are no measurements: stuck, clipped, too coarse, copies of others, hum.

The one check of values, for files, recordings, live sources and the twin. Samples that a hold
repeats are found by `slowtime.signals.repeated_samples`, times by the clock of each source.
"""

import math
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .mains_hum import find_hum
from .repeated_samples import Hold

STUCK_P_VALUE = 1e-6
"""[probability] That any run of a channel is as long by chance, below which it is a fault.
Source: one false alarm in a million channels."""

MIN_STUCK_SAMPLES = 6
"""[samples] Equal values in a row that may be a fault, however fine the resolution. Source:
judgement; no study is recorded."""

CLIPPED_RATIO = 4
"""[1] Times the samples on a neighbouring level, and samples, that clipping puts on the
extreme level at least. Source: judgement; no study is recorded."""

SAME_LEVEL = 1e-4
"""[1] Relative difference of two levels of one channel that are the same stop. Source: four
digits, as text files keep them."""
LEAST_SAMPLES = 64
"""[samples] From which channels are compared. Source: judgement; a few are
alike by chance."""
COPY_RESIDUAL = 1e-5
"""[share of the variance] That a copy leaves of the other. Source: what four digits leave."""
INTEGRAL_RESIDUAL = 1e-3
"""[share of the variance] That the differences of an integral leave of the other. Source: the
trapezoidal rule at twenty samples a period."""
COARSE_LEVELS = 4
"""[levels] Of a channel, up to which its noise is its resolution. Source: with four, the error
of rounding has a tenth of the variance."""
CLIPPED_SHARE = 1e-3
"""[share of the samples] At a stop from which that is said. Source: judgement; fewer change no
mode."""

FEWEST_CODES = 64
"""[levels] Of a channel from which a bit that never changes is a fault. Source: with so many,
each bit below a quarter of the range changes often."""
WHOLE = 1e-3
"""[steps] Within which values are whole multiples of the resolution. Source: four digits."""

SPECTRUM_DECADES = 3.0
"""[decades] Over which a channel of positive values spreads, at least, to be taken for the
magnitude of a spectrum. Source: a resonance of 1 % stands 34 dB above its foot, twice that in
power."""
SPECTRUM_ROUGHNESS = 0.3
"""[1] Deviation of the steps of its logarithm over that of the logarithm, at most. Source: of
independent values, 1.4."""


def stuck_samples(samples: Float[np.ndarray, " time"]) -> Bool[np.ndarray, " time"]:
    """Mask runs of equal values that are longer than the record's own repetitions allow."""
    starts, lengths = _runs(samples)
    ordinary = lengths[lengths < MIN_STUCK_SAMPLES]
    pairs, repeats = ordinary.sum(), (ordinary - 1).sum()
    habit = min(max((repeats + 1) / (pairs + 2), 1e-3), 0.99)
    longest = max(
        MIN_STUCK_SAMPLES, math.ceil(math.log(STUCK_P_VALUE / len(samples)) / math.log(habit))
    )
    found = np.zeros(len(samples), dtype=bool)
    for start, length in zip(starts, lengths, strict=True):
        if length >= longest:
            found[start : start + length] = True
    return found


def _runs(
    samples: Float[np.ndarray, " time"],
) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"]]:
    """First samples, and lengths, of runs of equal values."""
    changes = np.flatnonzero(samples[1:] != samples[:-1]) + 1
    starts = np.concatenate([[0], changes])
    return starts, np.diff(np.concatenate([starts, [len(samples)]]))


def clipped_samples(
    samples: Float[np.ndarray, " time"],
    there: Float[np.ndarray, " finite"],
    stops: Collection[float] = (),
) -> Bool[np.ndarray, " time"]:
    """Find samples on an extreme value that occurs far more often than the value next to it.

    A single run at an extreme is a stuck channel, unless the channel is clipped at its other
    extreme or at that level in other records.
    """
    levels, counts = np.unique(there, return_counts=True)
    piles: list[Bool[np.ndarray, " time"]] = []
    several = False
    if len(levels) >= 2 * CLIPPED_RATIO:
        for extreme, neighbours in (
            (0, counts[1:CLIPPED_RATIO]),
            (-1, counts[-CLIPPED_RATIO:-1]),
        ):
            if counts[extreme] >= CLIPPED_RATIO * max(neighbours):
                at = samples == levels[extreme]
                size = abs(float(levels[extreme]))
                rows = int(at[0]) + int(np.count_nonzero(at[1:] & ~at[:-1]))
                several = (
                    several
                    or rows > 1
                    or any(abs(size - stop) < SAME_LEVEL * stop for stop in stops)
                )
                piles.append(at)
    return np.any(piles, axis=0) if several else np.zeros(len(samples), dtype=bool)


def hold_note(hold: Hold) -> str:
    """Say that samples repeat the one before, with the cure."""
    return (
        f"{100 * hold.share:.0f} % of the samples repeat the one before in all channels: the "
        "sensor is polled faster than it measures, and images of modes will be taken for "
        f"modes. Poll it {hold.ratio:.3g} times more slowly, or by its own clock."
    )


def value_notes(
    columns: Float[np.ndarray, "time channel"],
    names: Sequence[str],
    rate_hz: float | None = None,
) -> tuple[str, ...]:
    """Describe channels whose values are no measurements of their own.

    Parameters
    ----------
    columns
        Samples of all channels, in any unit; not finite ones are left out.
    names
        Of the channels.
    rate_hz
        Sampling rate [Hz]; None to leave out what needs one.

    Returns
    -------
    A sentence for each finding.
    """
    rows = columns[np.isfinite(columns).all(axis=1)]
    if len(rows) < LEAST_SAMPLES:
        return ()
    notes = []
    moves = (np.diff(rows, axis=0, prepend=rows[:1]) != 0).sum(axis=1)
    for name, series in zip(names, rows.T, strict=True):
        stuck = float((stuck_samples(series) & (moves > 0)).mean())
        clipped = float(clipped_samples(series, series).mean())
        values = np.unique(series)
        levels = len(values)
        if clipped > CLIPPED_SHARE:
            notes.append(
                f"Channel {name!r} is clipped in {100 * clipped:.2g} % of its samples: "
                "harmonics of its modes may be taken for modes. Use a wider range, or leave it "
                "out."
            )
        elif stuck > CLIPPED_SHARE and len(names) > 1 and levels > COARSE_LEVELS:
            notes.append(
                f"Channel {name!r} is stuck in {100 * stuck:.2g} % of its samples, while "
                "others move. Check the sensor, or leave it out with --channels."
            )
        elif 1 < levels <= COARSE_LEVELS:
            notes.append(
                f"Channel {name!r} has {levels} different values: its resolution is as large "
                "as its signal. Use a finer range, or leave it out."
            )
        elif (bit := stuck_bit(values)) is not None:
            notes.append(
                f"Channel {name!r}: bit {bit} of its values never changes, while higher and "
                "lower ones do. Check the converter and its cable, or leave it out."
            )
        if looks_like_spectrum(series):
            notes.append(
                f"Channel {name!r} is positive throughout, and smooth over "
                f"{SPECTRUM_DECADES:g} decades or more, as the magnitude of a spectrum: if its "
                "rows are frequencies, this is no record in time. Export the time histories, "
                "or frequency responses with both parts."
            )
        hum = None if rate_hz is None else find_hum(series, rate_hz)
        if hum is not None:
            lines = ", ".join(f"{hz:.4g}" for hz in hum.lines_hz)
            notes.append(
                f"Channel {name!r} has hum of the mains ({hum.mains_hz:g} Hz), "
                f"{100 * hum.share:.2g} % of its variance, at {lines} Hz: lines there are no "
                "modes. Check earth and shield of its cable."
            )
    return (*notes, *_likeness_notes(rows, names))


def looks_like_spectrum(series: Float[np.ndarray, " time"]) -> bool:
    """Whether a channel is like the magnitude of a spectrum: positive, smooth, with peaks.

    Decays, which are smooth and may be positive, have no maximum beyond their beginning.
    """
    if series.min() <= 0:
        return False
    level = np.log10(series)
    if np.ptp(level) < SPECTRUM_DECADES or np.argmax(level) < len(level) // 100:
        return False
    return bool(np.diff(level).std() < SPECTRUM_ROUGHNESS * level.std())


def stuck_bit(values: Float[np.ndarray, " level"]) -> int | None:
    """Find a bit of a converter that never changes, while higher and lower ones do.

    Parameters
    ----------
    values
        Different values of a channel, ascending.

    Returns
    -------
    The lowest such bit, from 0; None where there is none, or values are no whole multiples of
    one step.
    """
    if len(values) < FEWEST_CODES:
        return None
    step = float(np.diff(values).min())
    codes = values / step
    if np.abs(codes).max() > 2**40 or np.abs(codes - np.rint(codes)).max() > WHOLE:
        return None
    whole = np.rint(codes).astype(np.int64)
    low, high = np.quantile(whole, (0.05, 0.95))
    changes = np.bitwise_or.reduce(whole) & ~np.bitwise_and.reduce(whole)
    for bit in range(1, 40):
        if 4 * 2**bit > high - low:
            break
        if not changes >> bit & 1 and changes & (2**bit - 1):
            return bit
    return None


def _likeness_notes(
    rows: Float[np.ndarray, "time channel"], names: Sequence[str]
) -> tuple[str, ...]:
    """Sentences on channels that repeat or integrate another one."""
    centred = rows - rows.mean(axis=0)
    steps = np.diff(rows, axis=0)
    mean = (centred[1:] + centred[:-1]) / 2
    notes, gone = [], set()
    for second in range(rows.shape[1]):
        for first in range(rows.shape[1]):
            if first == second or first in gone:
                continue
            if first < second and _left(centred[:, first], centred[:, second]) < COPY_RESIDUAL:
                how = "is a copy of"
            elif _left(mean[:, first], steps[:, second]) < INTEGRAL_RESIDUAL:
                how = "is the integral of"
            else:
                continue
            gone.add(second)
            notes.append(
                f"Channel {names[second]!r} {how} {names[first]!r}: it tells nothing new. "
                "Leave it out with --channels."
            )
            break
    return tuple(notes)


def _left(first: Float[np.ndarray, " time"], second: Float[np.ndarray, " time"]) -> float:
    """Share of the variance of the second series that the first, scaled, leaves."""
    power, own = float(first @ first), float(second @ second)
    if not power or not own:
        return 1.0
    return 1.0 - float(first @ second) ** 2 / (power * own)
