"""Series that one table or file mixes: sensors whose rows alternate, and separate runs."""

import re
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from slowtime_services.files.reading_options import ReadingOptions
from slowtime_services.files.record import RecordError, Values
from slowtime_services.files.sheet import Column, Sheet
from slowtime_services.files.times.time_units import FIRST_EPOCH_S, is_time_name, words_of

MAX_SENSORS_IN_TURN = 64
"""Sensors whose rows may alternate in a file [1]."""
LOOKED_AT = 4096
"""Rows at the beginning in which alternation is looked for [1]."""
FEWEST_TURNS = 8
"""Rows of each sensor from which their distances are regular or not [1]."""
LEAST_SPAN = 0.75
"""Share of the rows [1] between the first and the last row of each sensor."""
REGULAR = 3.0
"""Largest distance of rows of one sensor over their mean distance [1]. Of a state that changes
at random, one of a hundred distances is 4.6 times the mean."""
MAX_UNNAMED = 4
"""Numbers of sensors that may take turns in a column that is not called one of sensors [1];
more of them are a counter, as of the teeth of a wheel."""
STEP_RATIO = 4.0
"""Mean square step between rows over that between rows of one sensor [1] from which rows are
of several sensors: within one signal, steps grow with the distance."""
_SENSOR_WORDS = frozenset(
    "id type typ sensor sensors sensorid sensortype kind node device dev channel ch chan kanal "
    "imu probe mote board addr address unit source axis station".split()
)
"""Words of which a column of numbers of sensors is named, as ``sensor_id``."""
_WORDS_OF_RECORDS = frozenset(
    "tag label msg message record packet name src signal data".split()
)
"""Words of which a column of words is named that tells of what each row is."""
_COUNTER_WORDS = frozenset(
    "seq sequence count counter cnt index idx row sample n no nr".split()
)
_GROUP = re.compile(r"(.+?)[/.]")
_RUN = re.compile(
    r"(?<![^\W_])(?:run|test|trial|take|shot|experiment|exp|event|measurement|meas|messung|"
    r"versuch|session|pass|rep|repetition|essai|ensayo|prova)[ _-]?\d+$",
    re.I,
)
"""Names of groups that are runs after one another, not sensors."""


def refuse_several_sensors(file: str, sheet: Sheet, used: frozenset[int]) -> None:
    """Ask about rows that are of one sensor after the other.

    Parameters
    ----------
    used
        Places of columns that the clock is read from.

    Raises
    ------
    RecordError
        Where stamps repeat and a column repeats a list of sensors, or where a column of few
        words, or of few whole numbers, alternates regularly.
    """
    clocks = [c for c in sheet.columns if c.stamps is not None or is_time_name(c.name)]
    again = any((np.diff(c.values) == 0).any() for c in clocks if c.kind != "word")
    for place, (name, column) in enumerate(zip(sheet.names, sheet.columns, strict=True)):
        if place in used or any(column is clock for clock in clocks):
            continue
        period = _period(column.values) if again else 0
        if period > 1:
            raise _several(
                file, name, f"repeats {_listed(column.values[:period])}", " at each time"
            )
        sensors = _alternating(column, name, sheet)
        if sensors:
            raise _several(file, name, f"alternates between {_listed(sensors)}", "")


def _several(file: str, name: str, does: str, at: str) -> RecordError:
    return RecordError(
        f"The rows of {file} list several sensors one after another{at} "
        f"(column {name!r} {does}). Rearrange the file to one row "
        "for each time and one column for each sensor. If each row is a sample "
        "of its own and the rows are evenly spaced in time, give --rate-hz."
    )


def _listed(values: Sequence[object] | Values) -> str:
    shown = (f"{v:g}" if isinstance(v, float) else str(v) for v in values)
    return ", ".join(shown)[:80]


def _period(values: Values) -> int:
    """Rows after which a column of few words or whole numbers repeats; 0 where it does not."""
    few = list(values[: 2 * MAX_SENSORS_IN_TURN])
    for period in range(2, min(MAX_SENSORS_IN_TURN, len(values) // 3) + 1):
        if few[period : 2 * period] == few[:period] and len(set(few[:period])) == period:
            return period if bool(np.all(values[period:] == values[:-period])) else 0
    return 0


def _alternating(column: Column, name: str, sheet: Sheet) -> list[object]:
    """Words or whole numbers of a column that take turns regularly; none where they do not."""
    values = column.values[:LOOKED_AT]
    if column.kind not in ("word", "number"):
        return []
    if column.kind == "number":
        numbers = values.astype(float)
        if not np.isfinite(numbers).all() or np.mod(numbers, 1).any():
            return []
    found, place = np.unique(values.astype(str), return_inverse=True)
    if not 1 < len(found) <= MAX_SENSORS_IN_TURN:
        return []
    for sensor in range(len(found)):
        rows = np.flatnonzero(place == sensor)
        distances = np.diff(rows)
        if len(distances) < FEWEST_TURNS or distances.max() > REGULAR * distances.mean():
            return []
        if np.ptp(rows) < LEAST_SPAN * len(place):
            return []  # a phase of the record
    known = _SENSOR_WORDS | _WORDS_OF_RECORDS if column.kind == "word" else _SENSOR_WORDS
    words = words_of(name)
    if not words or not known.issuperset(words):
        if len(found) > MAX_UNNAMED or _COUNTER_WORDS.intersection(words):
            return []
        if not _period(values) and not _are_of_several(sheet, column, place):
            return []
    first = {sensor: int(np.argmax(place == sensor)) for sensor in range(len(found))}
    return [column.values[row] for row in sorted(first.values())]


def _are_of_several(
    sheet: Sheet, column: Column, place: np.ndarray[tuple[int], np.dtype[np.intp]]
) -> bool:
    """Whether other columns step further from row to row than from turn to turn."""
    for other in sheet.columns:
        if other is column or other.kind != "number" or is_time_name(other.name):
            continue
        values = other.values[: len(place)].astype(float)
        if not np.isfinite(values).all():
            continue
        within = np.concatenate([np.diff(values[place == one]) for one in set(place.tolist())])
        steps = float(np.mean(np.diff(values) ** 2))
        if steps > STEP_RATIO * float(np.mean(within**2)) > 0:
            return True
    return False


def _groups_with_clocks(sheet: Sheet) -> frozenset[str]:
    """Return groups that have a time of their own, counted from their start."""
    found = set()
    for name, column in zip(sheet.names, sheet.columns, strict=True):
        group = _GROUP.match(name)
        if group is None or column.kind != "number" or column.values.dtype.kind not in "fiu":
            continue
        own = re.split(r"[/.]", name)[-1]
        rises = len(column.values) > 2 and bool((np.diff(column.values) > 0).all())
        if rises and is_time_name(own) and float(column.values[0]) < FIRST_EPOCH_S:
            found.add(group[1])
    return frozenset(found)


def refuse_separate_runs(
    file: str, sheet: Sheet, kept: Sequence[int], said: ReadingOptions
) -> None:
    """Ask which of several runs is meant, whose channels have the same names.

    Raises
    ------
    RecordError
        Where groups of the file are called ``run1``, ``run2`` or the like, or have each a
        time of their own from its start, and nobody has chosen channels.
    """
    if said.channels is not None:
        return
    names = sheet.names
    groups: dict[str, list[str]] = defaultdict(list)
    for name in (names[place] for place in kept):
        group = _GROUP.match(name)
        if group is not None:
            groups[group[1]].append(name)
    timed = _groups_with_clocks(sheet)
    runs = {
        group: channels
        for group, channels in groups.items()
        if _RUN.search(group) or (group in timed and len(timed) > 1)
    }
    if len(runs) > 1:
        first = next(iter(runs.values()))
        raise RecordError(
            f"{file} holds {', '.join(list(runs)[:8])}, which seem to be measured one after "
            "another, not at once. Choose the channels of one with --channels, such as "
            f"--channels {','.join(first[:3])}, or name all that were measured at once."
        )
