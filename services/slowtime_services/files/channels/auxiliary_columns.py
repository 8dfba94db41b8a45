"""Columns that are no sensor channels: counters, second clocks, magnitudes, and words."""

import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime_services.files.record import NAMES_ACCELERATION, NAMES_SLOW, UNITS_SLOW
from slowtime_services.files.sheet import Column
from slowtime_services.files.times.time_axis import looks_like_time
from slowtime_services.files.times.time_units import is_time_name, words_of

MIN_ROWS = 8
"""Rows from which the values of a column tell what it is [1]."""
SPARSE_SHARE = 0.5
"""Share of missing values [1] from which a column was sampled more slowly than the record."""
COUNTER_STEP_SHARE = 0.9
"""Least share of equal steps of a counter [1]; the rest is lost rows and restarts."""
MAGNITUDE_ROWS = 256
"""Rows on which magnitudes are looked for [1]."""
MAGNITUDE_TOLERANCE = 2e-3
"""Deviation from the square root of a sum of squares over its largest value [1]: what printing
with four digits leaves."""
MAX_MAGNITUDE_COLUMNS = 12
"""Columns among which the components of a magnitude are looked for [1]."""

SLOW = "slow by its name or unit, as a temperature or a battery, and no vibration"
"""Reason for which a column that tells of surroundings is set aside."""
UNITS_DEGREES = frozenset(("°c", "degc", "deg c", "°f", "degf", "%rh", "hpa", "mbar"))
SLOW_STEP_RATIO = 0.05
"""Mean square step over the variance [1], up to which a column whose unit says little is
slow."""
COUNTER = "a counter"
"""Reason for which a column that counts rows is set aside."""
_COUNTER_WORDS = frozenset(
    "count counter cnt index idx row rows no nr num number sample samples n i seq sequence "
    "packet packets frame frames record records rec id unnamed lfd point points scan scans "
    "tick ticks line entry msg message messung zähler zaehler muestra échantillon punkt "
    "序号".split()
)
_BESIDE_COUNTER = frozenset("of the 0 1 data loop total raw global".split())
MIN_FORWARD_SHARE = 0.02
"""Share of forward steps [1] below which a column that is called a counter is taken for a
state."""
_MAGNITUDE = re.compile(
    r"absolut|magnitude|resultant|betrag|vector\s*sum|"
    r"(?<![a-z])(?:norm|total|modulus|amag|svm|rss|vm)(?![a-z])|\|",
    re.I,
)


def aside(
    columns: Sequence[Column],
    names: Sequence[str],
    clocks: frozenset[int],
    *,
    sparse: bool = True,
    unnamed_clocks: bool = True,
) -> Mapping[int, str]:
    """Return the columns that are no channels, with the reason for each.

    Parameters
    ----------
    clocks
        Places of columns that are clocks already, which are not looked at.
    sparse
        Whether columns are set aside for lacking most of their values.
    unnamed_clocks
        Whether a column without a name of time is set aside for growing as evenly as a clock;
        false where a person says that there is none.
    """
    found: dict[int, str] = {}
    for place, column in enumerate(columns):
        if place not in clocks:
            reason = _reason(column, names[place], sparse, unnamed_clocks)
            if reason:
                found[place] = reason
    rest = [i for i in range(len(columns)) if i not in clocks and i not in found]
    slow = [i for i in rest if is_slow(columns[i], names[i])]
    if len(slow) < len(rest):
        found.update(dict.fromkeys(slow, SLOW))
    rest = [i for i in rest if i not in found]
    magnitudes = _magnitudes([columns[i] for i in rest], [names[i] for i in rest])
    found.update({rest[i]: reason for i, reason in magnitudes.items()})
    rest = [i for i in rest if i not in found]
    constant = [i for i in rest if _is_constant(columns[i])]
    if len(constant) < len(rest):
        found.update(dict.fromkeys(constant, "never changes, check the sensor"))
    return dict(sorted(found.items()))


def is_slow(column: Column, name: str) -> bool:
    """Whether a column is a temperature, a battery or the like, by its name and unit.

    Examples
    --------
    >>> is_slow(Column("Temp", "", np.arange(9.0)), "Temp")
    True
    """
    if column.kind != "number" or NAMES_ACCELERATION.search(name):
        return False
    unit = column.unit.strip("[]() ").casefold()
    if NAMES_SLOW.search(name) or unit in UNITS_DEGREES:
        return True
    if unit not in UNITS_SLOW:
        return False
    values = np.asarray(column.values, dtype=float)
    spread = float(np.var(values))
    return float(np.mean(np.diff(values) ** 2)) <= SLOW_STEP_RATIO * spread if spread else True


def _reason(column: Column, name: str, sparse: bool, unnamed_clocks: bool) -> str:
    if column.kind == "word":
        return "text"
    if column.kind != "number":
        return "a second column of times"
    values = np.asarray(column.values)
    if values.dtype.kind not in "fiu":
        return ""
    numbers = values.astype(float)
    lost = float((~np.isfinite(numbers)).mean())
    if lost == 1 and sparse:
        return "empty"
    if lost > SPARSE_SHARE and sparse:
        return f"sampled more slowly, {100 * lost:.0f} % of its rows are empty"
    if lost:
        return ""
    steps = np.diff(numbers)
    onwards = steps.any() and (steps >= 0).mean() > COUNTER_STEP_SHARE
    if onwards and is_time_name(name):
        return "a second column of times"
    if is_counter(numbers, name):
        return COUNTER
    if unnamed_clocks and len(numbers) >= 2 * MIN_ROWS and looks_like_time(numbers):
        return "grows as evenly as a clock"
    return ""


def is_counter(values: Float[np.ndarray, " time"], name: str) -> bool:
    """Whether a column counts rows, packets or the like.

    Examples
    --------
    >>> is_counter(np.arange(10.0), "a"), is_counter(np.array([0.0, 0, 1, 1]), "packet")
    (True, True)
    """
    if len(values) < 3 or not np.isfinite(values).all() or np.mod(values, 1).any():
        return False
    steps = np.diff(values)
    words = words_of(name)
    said = any(word in _COUNTER_WORDS for word in words)
    named = all(word in _COUNTER_WORDS or word in _BESIDE_COUNTER for word in words)
    back, forth = np.count_nonzero(steps < 0), np.count_nonzero(steps > 0)
    if said and named and forth > 50 * back and forth > MIN_FORWARD_SHARE * len(steps):
        return True
    return len(values) >= MIN_ROWS and float((steps == 1).mean()) >= COUNTER_STEP_SHARE


def _is_constant(column: Column) -> bool:
    values = np.asarray(column.values)
    return len(values) > 2 and bool((values == values[0]).all())


def _magnitudes(columns: Sequence[Column], names: Sequence[str]) -> dict[int, str]:
    """Columns that are the length of a vector of others."""
    found: dict[int, str] = {}
    numbers = [np.asarray(c.values, dtype=float) for c in columns]
    if len(columns) < 3 or len(numbers[0]) < MIN_ROWS:
        return found
    whole = np.flatnonzero(np.isfinite(np.column_stack(numbers)).all(axis=1))
    if len(whole) < MIN_ROWS:
        return found
    rows = whole[np.linspace(0, len(whole) - 1, min(MAGNITUDE_ROWS, len(whole))).astype(int)]
    sample = [values[rows] for values in numbers]
    for place, values in enumerate(sample):
        if not (values >= 0).all() or not values.any():
            continue
        others = [i for i in range(len(sample)) if i != place and i not in found]
        parts = _components(values, [sample[i] for i in others[:MAX_MAGNITUDE_COLUMNS]])
        if parts is not None:
            of = ", ".join(names[others[i]] for i in parts)
            found[place] = f"the magnitude of {of}"
        elif _MAGNITUDE.search(names[place]) and len(others) >= 2:
            signed = sum(bool((sample[i] < 0).any()) for i in others)
            if signed >= 2:
                found[place] = "a magnitude by its name"
    return found


def _components(
    values: Float[np.ndarray, " row"], others: Sequence[Float[np.ndarray, " row"]]
) -> tuple[int, ...] | None:
    """Which of `others` make up a magnitude, if any two or three do."""
    squares = [other**2 for other in others]
    target = values**2
    bound = MAGNITUDE_TOLERANCE * float(target.max())
    for size in (3, 2):
        for parts in itertools.combinations(range(len(others)), size):
            if np.abs(sum(squares[i] for i in parts) - target).max() <= bound and all(
                squares[i].max() > bound for i in parts
            ):
                return parts
    return None
