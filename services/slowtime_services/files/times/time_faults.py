"""Causes of times that are of no even clock: clocks set back, fractions, a change of rate."""

import numpy as np
from jaxtyping import Float

HOUR_S = 3600.0
NEAR_HOUR_S = 60.0
"""Difference of a step backwards from an hour [s] that daylight saving time explains."""
LEAST_PART_ROWS = 16
"""Rows of each part of a record between which the rate is said to change."""
EVEN_STEP = 0.1
"""Relative deviation of a step from the median of its part [1] that is none of another rate."""
EVEN_SHARE = 0.95
"""Share of the steps of a part [1] that are even."""
PAUSE_STEPS = 4.0
"""Step over the usual ones [1] from which there is a pause between two rates."""
LEAST_CHANGE = 0.02
"""Relative change of a rate [1] that is told."""
SET_STEPS = 0.1
"""Step of a clock [samples] from which it is told that the clock was set."""
SET_OVER_JITTER = 10.0
"""The same over the scatter of the other steps [1]."""
MOST_JITTER = 0.03
"""Scatter of steps [samples] up to which a step of the clock is told from a late stamp."""
LATE_ROWS = 4
"""Rows within which a late stamp is made up for."""
MOST_SETS = 0.01
"""Share of the rows [1] at which a clock may be set; more is jitter."""
_DAY_NS = 86_400_000_000_000


def written_time(value: np.generic, *, stamped: bool) -> str:
    """Write a time as a file has it: a number, or nanoseconds of a stamp as date or time.

    Examples
    --------
    >>> written_time(np.int64(1_713_711_600_500_000_000), stamped=True)
    '2024-04-21 15:00:00.5'
    >>> written_time(np.int64(54_000_000_000_000), stamped=True)
    '15:00:00'
    """
    if not stamped:
        return str(value)
    date, time = str(np.datetime64(int(value), "ns")).split("T")
    time = time.rstrip("0").removesuffix(".") if "." in time else time
    time = time + "00" if time.endswith(":") else time
    return time if 0 <= int(value) < _DAY_NS else f"{date} {time}"


def cause_of_back_steps(seconds: Float[np.ndarray, " time"], *, stamped: bool) -> str:
    """Return a sentence on why times run backwards; empty where nothing suggests a cause."""
    steps = np.diff(seconds)
    back = steps[steps < 0]
    if not back.size:
        return ""
    usual = float(np.median(steps))
    odd = np.count_nonzero(np.abs(steps / usual - 1) > EVEN_STEP) if usual > 0 else len(steps)
    set_back = ""
    # Rows out of order step forwards again, a clock that was set back does not.
    if odd == back.size <= MOST_SETS * len(steps):
        by_s = usual - back[0]
        set_back = (
            f" All other rows come evenly: if the clock was set back by {by_s:.4g} s while "
            f"sampling went on, give --rate-hz {1 / usual:.6g}."
        )
    if not stamped:
        return set_back
    if (np.abs(back + HOUR_S) <= NEAR_HOUR_S).all():
        return (
            " A step of one hour back is the end of daylight saving time: write times in UTC, "
            "or the record in two files."
        )
    if (back > -1).all():
        return (
            " Fractions of a second may lack their leading zeros, as in 15:00:00.5 for "
            "15:00:00.005: write them with as many digits in each row."
        )
    return set_back


def clock_set(
    seconds: Float[np.ndarray, " time"], missing: Float[np.ndarray, " step"], first_line: int
) -> str:
    """Return a sentence on where a clock was set while samples went on; empty for nowhere.

    Parameters
    ----------
    seconds
        Times of the rows [s].
    missing
        Samples taken to be missing before each row but the first.
    first_line
        Line of the first row; 0 where rows are no lines.
    """
    steps = np.diff(seconds)
    whole = missing == 0
    if np.count_nonzero(whole) < LEAST_PART_ROWS:
        return ""
    usual = float(np.median(steps[whole]))
    excess = steps / usual - np.round(steps / usual)
    jitter = 1.4826 * float(np.median(np.abs(excess)))
    if not 0 < usual or jitter > MOST_JITTER:
        return ""
    # A late stamp is followed by a short step, a clock that was set is not.
    sums = np.concatenate([[0.0], np.cumsum(excess)])
    rows = np.flatnonzero(np.abs(excess) > max(SET_STEPS, SET_OVER_JITTER * jitter))
    stays = [
        row
        for row in rows.tolist()
        if all(
            abs(sums[min(row + 1 + after, len(excess))] - sums[max(row - before, 0)])
            > abs(excess[row]) / 2
            for before in range(LATE_ROWS)
            for after in range(LATE_ROWS)
        )
    ]
    if not stays or len(rows) > MOST_SETS * len(steps):
        return ""
    row = int(stays[0]) + 1
    where = f"line {first_line + row}" if first_line else f"row {row}"
    more = f", and at {len(stays) - 1} other places" if len(stays) > 1 else ""
    taken = (
        f" {int(missing[row - 1])} samples are taken as missing there."
        if missing[row - 1]
        else ""
    )
    return (
        f"The clock was set at {where}{more}: a step of {steps[row - 1]:.4g} s is no whole "
        f"number of samples.{taken} --rate-hz {1 / usual:.6g} takes all rows as evenly spaced."
    )


def change_of_rate(
    seconds: Float[np.ndarray, " time"], first_line: int
) -> tuple[int, float, float] | None:
    """Find the row or line from which rows are evenly spaced at another rate, and both rates.

    Returns
    -------
    Line of the first row at the second rate, or its row from 0 where rows are no lines; the two
    rates [Hz]. None where the times are not of two such parts.
    """
    steps = np.diff(seconds)
    if len(steps) < 2 * LEAST_PART_ROWS or not (steps > 0).all():
        return None
    # Logarithms, so that a pause between the parts weighs little.
    logs = np.log(steps)
    excess = np.cumsum(logs - logs.mean())
    at = int(np.argmax(np.abs(excess[:-1]))) + 1
    if not LEAST_PART_ROWS <= at <= len(steps) - LEAST_PART_ROWS:
        return None
    before, after = float(np.median(steps[:at])), float(np.median(steps[at:]))
    even = [
        float(np.mean(np.abs(part / usual - 1) <= EVEN_STEP))
        for part, usual in ((steps[:at], before), (steps[at:], after))
    ]
    if min(even) < EVEN_SHARE or abs(before / after - 1) < LEAST_CHANGE:
        return None
    pause = steps[at] > PAUSE_STEPS * max(before, after)
    return first_line + at + int(pause), 1 / before, 1 / after
