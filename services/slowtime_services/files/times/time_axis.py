"""Rate, start and gaps of a column of times; or the reason why they are undecidable."""

import dataclasses

import numpy as np
from jaxtyping import Float, Shaped

from slowtime_services.files.record import Gap, RecordError

from .time_faults import cause_of_back_steps, change_of_rate, clock_set, written_time
from .time_units import is_time_name, unit_scale

__all__ = [
    "TimeAxis",
    "is_time_name",
    "looks_like_time",
    "read_time",
    "signed",
    "unit_scale",
    "unwrapped",
]

TOLD_JITTER_STEPS = 0.05
"""Root mean square deviation from a constant step [steps] from which it is told."""
MAX_JITTER_STEPS = 0.25
"""Root mean square deviation from a constant step [steps] beyond which samples may have
changed places with their neighbours' instants: a uniform deviation over half a step either way
has 0.29."""
BURST_MISSING_SHARE = 0.2
"""Share of instants without a sample [1] from which many short losses are bursts, not
losses."""
MOST_MISSING_SHARE = 0.5
"""Share of instants without a sample [1] up to which losses are plain where all samples lie on
an even clock, and its digits would show if they did not."""
FINE_DIGIT_STEPS = 0.1
"""Last digit [steps] below which stamps show that samples lie on an even clock."""
LONG_RUN_SAMPLES = 64
"""Median length of runs without a loss [samples] from which any share may be missing: pauses
between long runs are no bursts."""
PAUSE_STEPS = 4.0
"""Step over the median step [1] from which there is a pause between bursts."""
BURST_LENGTH_SCATTER = 0.3
"""Relative scatter of the lengths of bursts [1], beyond which they are called uneven
instead."""
REPEATED_TIME_SHARE = 0.3
"""Share of rows that repeat the time above them [1], from which the column has too few
digits."""
MAX_ROUNDING_DIGITS = 1.05
"""Range of deviations [units of the last digit] that rounding or cutting off leaves."""
MAX_DIGIT_SHARE = 2e-3
"""Last digit over the length of the record [1] that leaves the rate sure enough to be used
where times repeat."""
MAX_OFF_STEPS = 0.45
"""Distance of a row from its instant [steps] up to which its instant is sure. A rate that
drifts passes through half a step."""
MAX_SCATTER_STEPS = 0.7
"""Range of deviations from an even clock [steps] without a gap. A sample that is missing in the
middle of a record makes 1."""
STEADY_ROWS = 64
"""Rows [1] whose mean deviation from an even clock tells a loss from jitter: independent jitter
of `MAX_JITTER_STEPS` moves it by 0.03 steps."""
MAX_MEAN_STEPS = 0.25
"""Such a mean [steps] up to which no sample is missing. Source: one that is shifts all rows
behind it by a step, so that rows on one side are half a step off at least."""
ALIKE_STEPS = 0.1
"""Relative difference [1] from the median step within which steps are alike. Source: losses and
bursts of an even clock leave most steps so; jitter of `MAX_JITTER_STEPS` leaves a fifth."""
MAX_LOCAL_JITTER_STEPS = 0.1
"""Jitter of single stamps [steps, rms] up to which a rate that wanders is followed from step
to step, and samples are interpolated at even times. Source: judgement; it makes an error of
6 % of a sine of ten samples a period."""
_STAMPS_IN_SECOND_DIFFERENCE = 6.0**0.5
"""Standard deviation of second differences of independent jitter, in that of the jitter [1]:
1 - 2 + 1, squared and added."""
FIRST_ROWS = 64
"""Rows from which an even clock is first known [1]: their steps are rounded one by one, right
but once in 700 records where stamps jitter by 0.1 steps."""
WANDERING_PARTS = 8
"""Parts of a record [1] whose mean rates are told where the rate wanders."""
_WRAPS = (2.0**32, 2.0**31, 2.0**24, 2.0**16, 2.0**15, 2.0**8)
"""Counts at which the counters of loggers begin anew."""
_DECIMAL_PLACES = 12
"""Decimal places that are tried for the last digit of printed times [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class TimeAxis:
    """Rate, start and gaps by a time column."""

    rate_hz: float
    start_ns: int | None
    gaps: tuple[Gap, ...]
    jitter: float
    """Root mean square of the deviation from a constant step, in steps."""
    notes: tuple[str, ...] = ()
    seconds: Float[np.ndarray, " row"] | None = None
    """Times of the rows where their rate wanders, so that samples have to be interpolated at
    even times from the first on [s]; `gaps` are then those of the even times."""
    stamped: "TimeAxis | None" = None
    """Where stamps jitter about an even clock: the axis of rows that were sampled at their
    stamps. Only the samples can tell whether they were."""


class UnevenError(RecordError):
    """Times that are of no even clock; `mean_hz` is their rate on average."""

    def __init__(self, said: str, mean_hz: float) -> None:
        super().__init__(said)
        self.mean_hz = mean_hz


def looks_like_time(values: Float[np.ndarray, " time"]) -> bool:
    """Whether `values` grow by a step that hardly varies, and are not merely counting."""
    if len(values) < 3 or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    if not (steps > 0).all() or _is_counter(values):
        return False
    return bool(np.mean(np.abs(steps - np.median(steps)) <= 0.05 * np.median(steps)) > 0.98)


def _is_counter(values: Float[np.ndarray, " time"]) -> bool:
    return bool(values[0] in (0.0, 1.0) and (np.diff(values) == 1.0).all())


def signed(values: Shaped[np.ndarray, " time"]) -> Shaped[np.ndarray, " time"]:
    """Return whole numbers as int64, in which steps backwards are below zero.

    Steps across 2**63 and 2**64 are right, as int64 wraps; only the numbers themselves are then
    those minus 2**64.
    """
    return values.astype(np.int64) if values.dtype.kind in "iu" else values


def unwrapped(
    values: Shaped[np.ndarray, " time"], period: float | None = None
) -> tuple[Shaped[np.ndarray, " time"], float | None]:
    """Add the period after each restart of a counter; return the period, or None.

    A step backwards is a new beginning where a whole period added makes it a step forwards of
    ordinary length.

    Parameters
    ----------
    period
        The period, where it is known, as a day is for times of day.
    """
    if values.dtype.kind not in "fiu" or len(values) < 3:
        return values, None
    whole = signed(values)
    steps = np.diff(whole)
    back = np.flatnonzero(steps < 0)
    if not back.size or back.size > len(values) // 8:
        return values, None
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for wrap in (period,) if period is not None else _WRAPS:
        added = steps[back] + wrap
        if usual > 0 and np.all((added > 0) & (added <= max(20 * usual, 0.02 * wrap))):
            turns = np.zeros(len(values), whole.dtype)
            turns[back + 1] = round(wrap)
            return whole + np.cumsum(turns), wrap
    return values, None


def read_time(
    values: Shaped[np.ndarray, " time"],
    *,
    name: str = "time",
    scale: float = 1.0,
    origin_ns: int | None = None,
    quantum: float | None = None,
    first_line: int = 0,
) -> TimeAxis:
    """Rate, start, gaps and jitter of a time column.

    Sample ``i`` is taken to belong to instant ``k_i`` of a constant clock, where ``k_i - i``
    grows by the number of samples that are missing. A clock printed with few digits is not
    mistaken for one that jitters: as long as all samples stay within half a step of a straight
    line, nothing is missing.

    Parameters
    ----------
    scale
        Seconds per count.
    origin_ns
        Time of the first row since 1970-01-01 UTC; None where it is not known.
    quantum
        Step of the last digit of the column, in counts; found out if None.
    first_line
        Line of the first row in the file, for messages; 0 where rows are not lines.

    Raises
    ------
    RecordError
        Where the times run backwards, repeat without a system, come in bursts, or are too
        uneven to be those of one clock.
    """
    if len(values) < 2:
        raise RecordError("One sample has no rate. Give a record of at least two rows.")
    values = signed(values)
    seconds = np.asarray(values - values[0], dtype=float) * scale
    digit = (quantum if quantum is not None else printed_digit(values)) * scale
    notes: tuple[str, ...] = ()
    count = len(values)
    instants = np.arange(count)
    if not seconds[-1] > 0:
        _refuse_disorder(values, seconds, name, first_line, stamped=quantum is not None)
    even = _even_step(seconds, instants)
    # Where the last digit is the step itself, a step of two is a loss, not rounding.
    coarse = bool(digit) and abs(digit / even - 1) > 0.1 and (np.diff(seconds) >= 0).all()
    printed = coarse and _scatter(seconds, instants, even) <= MAX_ROUNDING_DIGITS * digit
    if (np.diff(seconds) == 0).any() and not (np.diff(seconds) < 0).any():
        spread = _spread_equal_times(seconds, name)
        if spread is not None:
            seconds, said = spread
            notes, even = (said,), _even_step(seconds, instants)
        elif not (printed and digit <= MAX_DIGIT_SHARE * seconds[-1]):
            _refuse_repeated(seconds, name, first_line)
    if not printed:
        _refuse_disorder(values, seconds, name, first_line, stamped=quantum is not None)
    step = even
    steady = _stays_with_even_clock(seconds, instants, even)
    if not (printed or steady) and _scatter(seconds, instants, even) > MAX_SCATTER_STEPS * even:
        step, instants = _instants(seconds)
    jumps = np.diff(instants) - 1
    deviation = seconds / step - instants
    jitter = float(np.sqrt(np.mean((deviation - deviation.mean()) ** 2)))
    plain = jitter <= TOLD_JITTER_STEPS and digit < FINE_DIGIT_STEPS * step
    scattered = not (plain and count > MOST_MISSING_SHARE * instants[-1])
    if scattered:
        _refuse_bursts(seconds, jumps, name)
        scattered = _are_scattered(jumps)
    wanders = jitter > MAX_JITTER_STEPS and not printed
    if wanders and not scattered and _is_locally_even(seconds, jumps):
        return _wandering(seconds, jumps, origin_ns, name, notes)
    if wanders and steady and not scattered:
        raise UnevenError(
            f"The times in column {name!r} are too uneven: they jitter by {jitter:.2g} steps "
            f"(rms, at most {MAX_JITTER_STEPS:g}) about a steady rate of {1 / step:.6g} Hz. "
            f"Give --rate-hz {1 / step:.6g} if samples were taken evenly and stamped late; "
            "resample the record at even times if they were taken at these.",
            1 / step,
        )
    if wanders or (jumps < 0).any() or scattered:
        raise UnevenError(
            f"The times in column {name!r} are too uneven for one sampling rate: they deviate "
            f"by {jitter:.2g} steps (rms) from a step of {step:.6g} s (at most "
            f"{MAX_JITTER_STEPS:g}), and {int(jumps[jumps > 0].sum())} samples would be "
            f"missing. {count} samples in {seconds[-1]:.6g} s are "
            f"{1 / _mean(seconds):.6g} Hz on average.{_change(seconds, first_line)} Resample "
            "the record, or give --rate-hz if the column is not the clock.",
            1 / _mean(seconds),
        )
    gaps = tuple(Gap(int(row) + 1, int(jumps[row])) for row in np.flatnonzero(jumps))
    said = "" if printed else clock_set(seconds, jumps, first_line)
    notes += (said,) if said else ()
    rate = _tidy_rate(step, seconds, instants, digit)
    axis = TimeAxis(rate, origin_ns, gaps, jitter, notes)
    jitters = jitter > TOLD_JITTER_STEPS and not printed and (np.diff(seconds) > 0).all()
    return _jittering(axis, seconds, jumps) if jitters else axis


def _jittering(
    axis: TimeAxis, seconds: Float[np.ndarray, " time"], jumps: Float[np.ndarray, " step"]
) -> TimeAxis:
    """Axis of stamps that jitter, with that of rows that were sampled at them."""
    notes = (*axis.notes, f"The clock jitters by {100 * axis.jitter:.0f} % of a step (rms).")
    said = "Samples jitter as their stamps do: they were interpolated at even times."
    stamped = dataclasses.replace(
        axis,
        gaps=_gaps_between(seconds, jumps, axis.rate_hz),
        notes=(*notes, said),
        seconds=seconds,
    )
    return dataclasses.replace(axis, notes=notes, stamped=stamped)


def _instants(
    seconds: Float[np.ndarray, " time"],
) -> tuple[float, Float[np.ndarray, " time"]]:
    """Step of the clock [s], and the instant of each row by it.

    By an even clock, where all rows are near its instants: known from the first rows, it
    numbers twice as many, and so on. Else steps are rounded one by one, which follows a rate
    that drifts, but takes a step that jitter doubles for a loss.
    """
    first = float(np.median(np.diff(seconds)))
    step, start, count = first, float(seconds[0]), min(FIRST_ROWS, len(seconds))
    instants = np.concatenate(([0.0], np.cumsum(np.round(np.diff(seconds[:count]) / step))))
    while True:
        if instants[-1] == 0:
            break
        step, start = np.polyfit(instants, seconds[:count], 1)
        instants = np.round((seconds[:count] - start) / step)
        if count == len(seconds):
            break
        count = min(2 * count, len(seconds))
        instants = np.round((seconds[:count] - start) / step)
    off = np.abs((seconds[:count] - start) / step - instants)
    if (np.diff(instants) > 0).all() and off.max() <= MAX_OFF_STEPS:
        return float(step), instants - instants[0]
    step = first
    for _ in range(3):
        instants = np.concatenate(([0.0], np.cumsum(np.round(np.diff(seconds) / step))))
        if instants[-1] == 0:
            break
        step = float(seconds @ instants / (instants @ instants))
    return step, instants


def _change(seconds: Float[np.ndarray, " time"], first_line: int) -> str:
    """Describe where the rate changes; empty where it does not do so once."""
    found = change_of_rate(seconds, first_line)
    if found is None:
        return ""
    at, before, after = found
    where = f"line {at}" if first_line else f"row {at}"
    return (
        f" The rate changes at {where} from {before:.6g} to {after:.6g} Hz: write each part to "
        "a file of its own."
    )


def _is_locally_even(
    seconds: Float[np.ndarray, " time"], jumps: Float[np.ndarray, " step"]
) -> bool:
    """Whether each step is near those beside it, as of a loop that takes more or less time.

    Where rows of an even clock are stamped late now and then, stamps do not drift away from
    an even clock. Where they do while neighbours hardly differ, they tell when rows were
    sampled.
    """
    steps = np.diff(seconds)
    if (jumps < 0).any() or not (steps > 0).all():
        return False
    beside = (jumps[1:] == 0) & (jumps[:-1] == 0)
    if np.count_nonzero(beside) < len(steps) / 2:
        return False
    bends = np.diff(steps)[beside] / np.median(steps)
    jitter = np.sqrt(np.mean(bends**2)) / _STAMPS_IN_SECOND_DIFFERENCE
    return bool(jitter <= MAX_LOCAL_JITTER_STEPS)


def _wandering(
    seconds: Float[np.ndarray, " time"],
    jumps: Float[np.ndarray, " step"],
    origin_ns: int | None,
    name: str,
    notes: tuple[str, ...],
) -> TimeAxis:
    """Even times in place of those of a rate that wanders, with the gaps that remain."""
    steps = np.diff(seconds)[jumps == 0]
    rate = 1 / float(np.mean(steps))
    gaps = _gaps_between(seconds, jumps, rate)
    part = max(len(steps) // WANDERING_PARTS, 1)
    means = [1 / float(np.mean(some)) for some in np.array_split(steps, len(steps) // part)]
    said = (
        f"The rate of column {name!r} wanders from {min(means):.4g} to {max(means):.4g} Hz: "
        f"samples were interpolated at even times, {rate:.6g} Hz. --rate-hz takes the rows "
        "as evenly spaced instead."
    )
    return TimeAxis(rate, origin_ns, gaps, 0.0, (*notes, said), seconds)


def _gaps_between(
    seconds: Float[np.ndarray, " time"], jumps: Float[np.ndarray, " step"], rate_hz: float
) -> tuple[Gap, ...]:
    """Gaps of even times: those half a step from both rows between which rows are missing."""
    even = even_times(seconds, rate_hz)
    rows, half = np.flatnonzero(jumps > 0), 0.5 / rate_hz
    first = np.searchsorted(even, seconds[rows] + half, side="right")
    missing = np.searchsorted(even, seconds[rows + 1] - half, side="left") - first
    lost = np.cumsum(missing) - missing
    return tuple(
        Gap(int(at - before), int(count))
        for at, before, count in zip(first, lost, missing, strict=True)
        if count > 0
    )


def even_times(
    seconds: Float[np.ndarray, " row"], rate_hz: float
) -> Float[np.ndarray, " sample"]:
    """Return times [s] from the first row on at a rate [Hz], within those of the rows."""
    count = int(np.floor(seconds[-1] * rate_hz + 1e-6)) + 1
    return np.asarray(np.minimum(np.arange(count) / rate_hz, seconds[-1]))


def _are_scattered(jumps: Float[np.ndarray, " gap"]) -> bool:
    """Whether much is missing, and in so many places that few samples follow each other."""
    places = np.flatnonzero(jumps > 0)
    much = jumps[places].sum() > BURST_MISSING_SHARE * (len(jumps) + 1 + jumps.sum())
    return bool(much and len(places) > 1 and np.median(np.diff(places)) < LONG_RUN_SAMPLES)


def _mean(seconds: Float[np.ndarray, " time"]) -> float:
    return float(seconds[-1] / (len(seconds) - 1))


def _refuse_disorder(
    values: Shaped[np.ndarray, " time"],
    seconds: Float[np.ndarray, " time"],
    name: str,
    first_line: int,
    *,
    stamped: bool,
) -> None:
    bad = np.flatnonzero(~(np.diff(seconds) > 0))
    if bad.size:
        row = int(bad[0]) + 1
        where = f"line {first_line + row}" if first_line else f"row {row}"
        raise RecordError(
            f"Time does not run forwards at {where}: column {name!r} goes from "
            f"{written_time(values[row - 1], stamped=stamped)} to "
            f"{written_time(values[row], stamped=stamped)} ({bad.size} such places)."
            f"{cause_of_back_steps(seconds, stamped=stamped)} Remove the repeated "
            "or misplaced rows, or give --rate-hz if the column is not the samples' clock."
        )


def _even_step(
    seconds: Float[np.ndarray, " time"], instants: Shaped[np.ndarray, " time"]
) -> float:
    """Fit the step of an even clock without gaps."""
    centred = instants - instants.mean()
    step = float(seconds @ centred / (centred @ centred))
    return step if step > 0 else float(seconds[-1] / max(len(seconds) - 1, 1)) or 1.0


def _stays_with_even_clock(
    seconds: Float[np.ndarray, " time"], instants: Shaped[np.ndarray, " time"], step: float
) -> bool:
    """Whether rows jitter about an even clock with no sample missing, however far they do."""
    parts, steps = len(seconds) // STEADY_ROWS, np.diff(seconds)
    if parts < 2 or _are_alike(steps):
        return False
    off = seconds / step - instants
    means = [float(part.mean()) for part in np.array_split(off - off.mean(), parts)]
    return bool(np.max(np.abs(means)) < MAX_MEAN_STEPS)


def _are_alike(steps: Float[np.ndarray, " step"]) -> bool:
    """Whether most steps are of one length."""
    typical = np.median(steps)
    return bool(np.mean(np.abs(steps - typical) <= ALIKE_STEPS * typical) > 0.5)


def _scatter(
    seconds: Float[np.ndarray, " time"], instants: Shaped[np.ndarray, " time"], step: float
) -> float:
    """Range of the deviations from an even clock [s]."""
    return float(np.ptp(seconds - instants * step))


def _spread_equal_times(
    seconds: Float[np.ndarray, " time"], name: str
) -> tuple[Float[np.ndarray, " time"], str] | None:
    """Spread times that equally many rows share, as of a clock printed to whole seconds.

    None where groups are not equally large, or their step is not that of a last digit: times
    may then be those at which a buffer was emptied.
    """
    edges = np.flatnonzero(np.diff(seconds) > 0) + 1
    sizes = np.diff(edges)
    if len(sizes) == 0:
        return None
    size, quantum = int(sizes[0]), float(np.median(np.diff(seconds[edges])))
    whole = (
        size > 1
        and (sizes == size).all()
        and np.allclose(np.diff(seconds[edges]), quantum, rtol=1e-6)
        and max(edges[0], len(seconds) - edges[-1]) <= size
    )
    if not whole or not _is_decimal(quantum):
        return None
    spread = (np.arange(len(seconds)) - edges[0]) * quantum / size + seconds[edges[0]]
    return spread, (
        f"{size} rows share each time in column {name!r}, {quantum:g} s apart: read as evenly "
        f"spaced, {size / quantum:g} Hz."
    )


def _refuse_repeated(seconds: Float[np.ndarray, " time"], name: str, first_line: int) -> None:
    """Ask about times that many rows share; of a few, the order is at fault."""
    steps = np.diff(seconds)
    if np.count_nonzero(steps == 0) < REPEATED_TIME_SHARE * len(seconds) or not steps.any():
        return
    edges = np.flatnonzero(steps > 0) + 1
    size, quantum = (
        float(np.median(np.diff(edges, prepend=0))),
        float(np.median(steps[edges - 1])),
    )
    mean = 1 / _mean(seconds)
    line = f" (line {first_line} on)" if first_line else ""
    raise UnevenError(
        f"The times in column {name!r}{line} repeat: about {size:g} rows share each, with "
        f"{quantum:.6g} s from one to the next, which are {mean:.6g} Hz on average. Either the "
        "column has too few digits, or rows were stamped as a buffer was emptied. If "
        f"samples are evenly spaced, give --rate-hz {mean:.4g} or the rate as it was set.",
        mean,
    )


def _is_decimal(quantum: float) -> bool:
    """Whether a step is that of a last digit: a power of ten of seconds."""
    power = np.log10(quantum) if quantum > 0 else 0.5
    return bool(abs(power - round(power)) < 1e-3) or abs(quantum - 60.0) < 1e-6


def _refuse_bursts(
    seconds: Float[np.ndarray, " time"], jumps: Float[np.ndarray, " step"], name: str
) -> None:
    """Refuse short runs of samples with long pauses between, which have no single rate."""
    lost = np.flatnonzero(jumps > 0)
    total = len(seconds) + float(jumps[lost].sum())
    if len(lost) < 3 or jumps[lost].sum() <= BURST_MISSING_SHARE * total:
        return
    if np.median(np.diff(lost)) >= LONG_RUN_SAMPLES:
        return
    steps = np.diff(seconds)
    pauses = np.flatnonzero(steps > PAUSE_STEPS * np.median(steps))
    runs = np.diff(pauses)
    if len(runs) < 2 or np.std(runs) > BURST_LENGTH_SCATTER * np.mean(runs):
        return
    mean = 1 / _mean(seconds)
    raise UnevenError(
        f"The times in column {name!r} come in bursts: {round(float(np.median(runs)))} samples "
        f"{np.median(steps):.4g} s apart, then a pause of {np.median(steps[pauses]):.4g} s; "
        f"{mean:.6g} Hz on average. They are too uneven for one sampling rate. If a buffer was "
        f"emptied at once and the sensor sampled evenly, give --rate-hz {mean:.4g} or the rate "
        "as it was set; else resample the record.",
        mean,
    )


def printed_digit(values: Shaped[np.ndarray, " time"]) -> float:
    """Step of the last digit in which times are written, in counts; 0 where they have all."""
    if values.dtype.kind in "iu":
        return 1.0
    part = np.asarray(values[:2000], dtype=float)
    for places in range(_DECIMAL_PLACES):
        if np.array_equal(np.round(part, places), part):
            return float(10.0**-places)
    return 0.0


def _tidy_rate(
    step: float,
    seconds: Float[np.ndarray, " time"],
    instants: Shaped[np.ndarray, " time"],
    digit: float,
) -> float:
    """Whole number of Hz, or of microseconds a step, that the printed times stand for."""
    rate = 1.0 / step
    tolerance = max(1e-9, 0.5 * step / float(seconds[-1]) * 1e-2)
    candidates = [float(round(rate)), 1e6 / max(round(1e6 * step), 1)]
    candidates += [float(round(rate, 1)), float(round(rate, 2))]
    for candidate, loose in zip(candidates, (True, True, False, False), strict=True):
        if candidate <= 0:
            continue
        if loose and abs(candidate / rate - 1) < tolerance:
            return candidate
        off = seconds - instants / candidate
        if digit and float(np.ptp(off)) <= 1.05 * digit and _few_digits(digit, step):
            return candidate
    return rate


def _few_digits(digit: float, step: float) -> bool:
    """Whether the last digit is coarse enough for a tidy rate to hide in it."""
    return digit > 1e-7 * step
