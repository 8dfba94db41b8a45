"""From a column of times to a rate, a start, and what is missing; or to the reason why not."""

import dataclasses
import re

import numpy as np
from jaxtyping import Float, Shaped

from .record import Gap, RecordError

TIME_NAMES = frozenset(
    "t time times timestamp timestamps zeit temps tiempo tempo seconds sec secs time_s t_s "
    "time_ms t_ms time_us t_us time_ns t_ns elapsed".split()
)
_SCALES = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6,
    "µs": 1e-6, "ns": 1e-9, "min": 60.0,
}  # fmt: skip
# An absolute time of this century, by the unit it is counted in.
_EPOCHS = ((1e8, 1e10, 1.0), (1e11, 1e13, 1e-3), (1e14, 1e16, 1e-6), (1e17, 1e19, 1e-9))


@dataclasses.dataclass(frozen=True, slots=True)
class TimeAxis:
    """What a time column says."""

    rate_hz: float
    start_ns: int | None
    gaps: tuple[Gap, ...]
    jitter: float
    """Root mean square of the deviation from a constant step, in steps."""


def is_time_name(name: str) -> bool:
    """Whether a column of that name holds times.

    Examples
    --------
    >>> [is_time_name(name) for name in ("Time", "t [s]", "time_ms", "acc_t")]
    [True, True, True, False]
    """
    bare = re.sub(r"[\[(].*$", "", name).strip().casefold().replace(" ", "_")
    return bare in TIME_NAMES


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


def unit_scale(name: str, unit: str, values: Shaped[np.ndarray, " time"]) -> tuple[float, bool]:
    """Seconds per count of a time column, and whether it counts from 1970."""
    for low, high, scale in _EPOCHS:
        if low <= values[0] < high:
            return scale, True
    bracket = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]", name)
    suffix = name.rpartition("_")[2] if "_" in name else ""
    for word in (unit, bracket.group(1) if bracket else "", suffix):
        if word.strip("[]() ").casefold() in _SCALES:
            return _SCALES[word.strip("[]() ").casefold()], False
    return 1.0, False


def read_time(
    values: Shaped[np.ndarray, " time"],
    *,
    name: str = "time",
    unit: str = "",
    first_line: int = 0,
) -> TimeAxis:
    """Rate, start, gaps and jitter of a time column.

    Sample ``i`` is taken to belong to instant ``k_i`` of a constant clock, where ``k_i - i``
    grows by the number of samples that are missing. A clock printed with few digits is not
    mistaken for one that jitters: as long as all samples stay within half a step of a straight
    line, nothing is missing.

    Parameters
    ----------
    first_line
        Line of the first row in the file, for messages; 0 where rows are not lines.

    Raises
    ------
    RecordError
        Where the times repeat, run backwards, or are too uneven to be those of one clock.
    """
    _refuse_disorder(values, name, first_line)
    scale, absolute = unit_scale(name, unit, values)
    count = len(values)
    origin = values[0]
    seconds = np.asarray(values - origin, dtype=float) * scale
    step = _first_step(seconds)
    instants = np.arange(count)
    if np.abs(seconds / step - instants).max() > 0.5:
        step = float(np.median(np.diff(seconds)))
        for _ in range(3):
            instants = np.concatenate(([0], np.cumsum(np.round(np.diff(seconds) / step))))
            step = float(seconds @ instants / (instants @ instants))
    deviation = seconds / step - instants
    jitter = float(np.sqrt(np.mean((deviation - deviation.mean()) ** 2)))
    jumps = np.diff(instants) - 1
    if jitter > 0.25 or (jumps < 0).any():
        raise RecordError(
            f"The times in column {name!r} are too uneven for one sampling rate: they deviate "
            f"by {jitter:.2g} steps (rms) from a step of {step:.6g} s; at most 0.25 is "
            "allowed. Resample the record, or give --rate-hz if the column is not the clock."
        )
    gaps = tuple(Gap(int(row) + 1, int(jumps[row])) for row in np.flatnonzero(jumps))
    start_ns = _nanoseconds(origin, scale) if absolute else None
    return TimeAxis(_tidy_rate(step, seconds[-1]), start_ns, gaps, jitter)


def _refuse_disorder(values: Shaped[np.ndarray, " time"], name: str, first_line: int) -> None:
    if len(values) < 2:
        raise RecordError("One sample has no rate. Give a record of at least two rows.")
    bad = np.flatnonzero(~(np.diff(values) > 0))
    if bad.size:
        row = int(bad[0]) + 1
        where = f"line {first_line + row}" if first_line else f"row {row}"
        raise RecordError(
            f"Time does not run forwards at {where}: column {name!r} goes from "
            f"{values[row - 1]} to {values[row]} ({bad.size} such places). Remove the repeated "
            "or misplaced rows, or give --rate-hz if the column is not the samples' clock."
        )


def _nanoseconds(origin: np.generic, scale: float) -> int:
    """Exact where the times are whole numbers: float64 resolves only 256 ns in this century."""
    if origin.dtype.kind in "iu":
        return int(origin) * round(scale * 1e9)
    return round(float(origin) * round(scale * 1e9))


def _first_step(seconds: Float[np.ndarray, " time"]) -> float:
    return float(seconds[-1] / (len(seconds) - 1))


def _tidy_rate(step: float, duration: float) -> float:
    """Whole number of Hz, or of microseconds a step, that the printed times stand for."""
    rate = 1.0 / step
    tolerance = max(1e-9, 0.5 * step / duration * 1e-2)
    for candidate in (float(round(rate)), 1e6 / max(round(1e6 * step), 1)):
        if candidate > 0 and abs(candidate / rate - 1) < tolerance:
            return candidate
    return rate
