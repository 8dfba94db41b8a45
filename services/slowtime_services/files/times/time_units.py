"""The unit in which a column of times is counted, by its name or its size."""

import dataclasses
import re

import numpy as np
from jaxtyping import Shaped

from slowtime_services.files.record import RecordError

Values = Shaped[np.ndarray, " time"]

SLOWEST_HZ, FASTEST_HZ = 0.5, 5e6
"""Rates that a record of vibration may have by its own figures; beyond them, a question. The
slowest is that of long-period structures sampled by satellite receivers, the fastest that of
acoustic emission."""
SLOWEST_UNSAID_HZ = 1.0
"""Rate from which a time without a unit is not taken for seconds: counted in milliseconds, it
would be one of vibration."""
FEWEST_DOUBTED = 20
"""Rows from which whole numbers that count one by one are not taken for seconds without a
question; shorter tables are typed by hand."""

TIME_WORDS = frozenset(
    "t time times timestamp timestamps zeit zeitstempel temps tiempo tempo seconds sec secs "
    "elapsed millis micros nanos epoch unixtime datetime uhrzeit heure hora fecha datum date "
    "timecode clock zeitpunkt время 时间 時間 日時 "
    "czas tijd tid secondes segundos".split()
)
_QUALIFIERS = frozenset(
    "s ms us µs μs ns sec secs second seconds msec usec nsec min mins minutes h hr hours "
    "millis micros nanos milliseconds microseconds nanoseconds millisecond microsecond "
    "relative rel abs absolute since start from boot on power system sensor device gps local "
    "utc gmt unix epoch stamp of day the sample record recording iso value axis vector elapsed "
    "time date and in raw col column data log logger measurement messzeit days day d 0 1 "
    "a clock "
    "pc host sys run running test acquisition".split()
)
_SCALES = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "sekunden": 1.0,
    "secondes": 1.0, "segundos": 1.0, "sek": 1.0, "seg": 1.0, "ms": 1e-3, "msec": 1e-3,
    "msecs": 1e-3, "millis": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3, "us": 1e-6,
    "µs": 1e-6, "μs": 1e-6, "usec": 1e-6, "usecs": 1e-6, "micros": 1e-6, "microsecond": 1e-6,
    "microseconds": 1e-6, "ns": 1e-9, "nsec": 1e-9, "nanos": 1e-9, "nanosecond": 1e-9,
    "nanoseconds": 1e-9, "min": 60.0, "mins": 60.0, "minutes": 60.0, "h": 3600.0, "hr": 3600.0,
    "hours": 3600.0, "d": 86400.0, "day": 86400.0, "days": 86400.0, "tage": 86400.0,
    "jours": 86400.0, "сек": 1.0, "мс": 1e-3, "мкс": 1e-6, "秒": 1.0, "毫秒": 1e-3,
    "微秒": 1e-6,
}  # fmt: skip
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""Units that a person may state, in seconds."""
_NAMES = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds",
          60.0: "minutes", 3600.0: "hours", 86400.0: "days"}  # fmt: skip

FIRST_EPOCH_S, LAST_EPOCH_S = 6.3e8, 2.9e9
"""1990 and 2061: within these, seconds since 1970."""
_FIRST_1904_S, _LAST_1904_S, _FROM_1904_S = 3.1e9, 4.2e9, 2_082_844_800
"""2002 and 2037 in seconds since 1904, as LabVIEW counts them, and what lies between."""
_DAY_COUNTS = (
    (20_000.0, 75_000.0, 25_569.0, "days since 1900, as spreadsheets count them"),
    (7.0e5, 7.8e5, 719_529.0, "days since year 0, as MATLAB counts them"),
    (2.43e6, 2.48e6, 2_440_587.5, "Julian days"),
)
"""Range, day of 1970-01-01, and what counts so."""
_GPS_FROM_1970_S = 315_964_800


@dataclasses.dataclass(frozen=True, slots=True)
class TimeScale:
    """Unit and kind of a column of times.

    Parameters
    ----------
    seconds
        Seconds per count.
    offset
        Count at 1970-01-01 UTC; None where the column does not tell the date.
    said
        Where that is known from, as a person is told.
    sure
        Whether the file or a person states it.
    """

    seconds: float
    offset: float | None
    said: str
    sure: bool


def words_of(name: str) -> list[str]:
    """Words of a name, lower case: ``"timeUs"`` and ``"Time (µs)"`` as time, us."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return [word for word in re.split(r"[\W_]+", apart.casefold()) if word]


def is_time_name(name: str) -> bool:
    """Whether a column of that name holds times.

    Examples
    --------
    >>> [is_time_name(name) for name in ("Time", "t [s]", "time_ms", "timeUs", "acc_t")]
    [True, True, True, True, False]
    """
    words = words_of(re.sub(r"[\[(].*$", "", name))
    known = [word for word in words if word in TIME_WORDS]
    return bool(known) and all(word in TIME_WORDS or word in _QUALIFIERS for word in words)


def stated_scale(name: str, unit: str) -> float | None:
    """Seconds per count by the unit of a column or a word of its name; None if neither says.

    Examples
    --------
    >>> stated_scale("time_us", ""), stated_scale("Time", "ms"), stated_scale("time", "")
    (1e-06, 0.001, None)
    """
    bracket = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]", name)
    for text in (unit, bracket.group(1) if bracket else ""):
        words = words_of(text)
        if len(words) <= 2 and words and words[0] in _SCALES:
            return _SCALES[words[0]]
    words = words_of(re.sub(r"[\[(].*$", "", name))
    if len(words) > 1 or (words and words[0] not in ("s", "h", "d", "min")):
        for word in reversed(words):
            if word in _SCALES and not (word in ("d", "day", "days") and "of" in words):
                return _SCALES[word]
    return None


def scale_of(
    values: Values,
    name: str,
    unit: str,
    *,
    given: str | None = None,
    stated_rate_hz: float | None = None,
) -> TimeScale:
    """Return the unit and kind of a column of times.

    Parameters
    ----------
    given
        Unit that a person states, one of `UNITS`.
    stated_rate_hz
        Rate that the heading states, which can decide between units.

    Raises
    ------
    RecordError
        Where nothing states the unit, and seconds make no rate of vibration.
    """
    sure = UNITS[given] if given is not None else stated_scale(name, unit)
    first, step = float(values[0]), _typical_step(values)
    if sure is not None:
        whose = "as given" if given is not None else "by its name"
        said = f"{name!r} in {_NAMES[sure]} {whose}"
        if sure == 86400.0:
            return TimeScale(sure, _day_zero(first), said, sure=True)
        return TimeScale(sure, _epoch_zero(first * sure, sure, name), said, sure=True)
    rate = 1.0 / step if step > 0 else 0.0
    possible = [
        _Guess(s, rate / s, _epoch_zero(first * s, s, name)) for s in (1.0, 1e-3, 1e-6, 1e-9)
    ]
    dated = [g for g in possible if g.zero is not None and _is_sane(g.rate_hz)]
    if dated:
        best = dated[0]
        year = 1904 if best.zero else 1970
        said = f"{name!r} in {_NAMES[best.scale]} since {year}, by its size"
        return TimeScale(best.scale, best.zero, said, sure=False)
    for low, high, zero, counted in _DAY_COUNTS:
        if (
            low <= first < high
            and rate / 86400 >= SLOWEST_HZ
            and rate > 1000 * SLOWEST_UNSAID_HZ
        ):
            return TimeScale(86400.0, zero, f"{name!r} in {counted}, by its size", sure=False)
    if stated_rate_hz is not None:
        for guess in possible:
            if abs(guess.rate_hz / stated_rate_hz - 1) < 0.02:
                said = f"{name!r} in {_NAMES[guess.scale]}, for the heading states the rate"
                return TimeScale(guess.scale, None, said, sure=False)
    whole = bool(np.all(np.mod(values[: FEWEST_DOUBTED + 1].astype(float), 1) == 0))
    doubtful = rate < SLOWEST_UNSAID_HZ * (1 - 1e-9) or (
        whole and rate <= SLOWEST_UNSAID_HZ * (1 + 1e-9)
    )
    if rate > FASTEST_HZ or (doubtful and len(values) >= FEWEST_DOUBTED):
        others = [g for g in possible[1:] if _is_sane(g.rate_hz) and g.rate_hz >= 1]
        if rate > FASTEST_HZ:
            others = [_Guess(86400.0, rate / 86400, None)]
        would = "; ".join(
            f"in {_NAMES[g.scale]} it would be {g.rate_hz:.6g} Hz" for g in others
        )
        raise RecordError(
            f"The times in column {name!r} have no unit: in seconds the rate would be "
            f"{rate:.6g} Hz, seldom one of vibration{'; ' + would if would else ''}. Say "
            f"which with --reading time_unit={'|'.join(UNITS)} or in the column's name, as in "
            "t_ms; or give --rate-hz."
        )
    return TimeScale(1.0, None, f"{name!r} in seconds, because no unit is stated", sure=False)


@dataclasses.dataclass(frozen=True, slots=True)
class _Guess:
    scale: float
    rate_hz: float
    zero: float | None


def _is_sane(rate_hz: float) -> bool:
    return SLOWEST_HZ <= rate_hz <= FASTEST_HZ


def _typical_step(values: Values) -> float:
    steps = np.diff(values.astype(float) if values.dtype.kind == "f" else values)
    forwards = steps[steps > 0]
    if not forwards.size:
        return 0.0
    # Repeated times share one step between them.
    return float(np.median(forwards)) * (forwards.size / max(steps.size, 1))


def _epoch_zero(seconds: float, scale: float, name: str) -> float | None:
    words = words_of(name)
    if "gps" in words and FIRST_EPOCH_S <= seconds + _GPS_FROM_1970_S <= LAST_EPOCH_S:
        return None  # Leap seconds since 1980 depend on the receiver.
    if FIRST_EPOCH_S <= seconds <= LAST_EPOCH_S:
        return 0.0
    if _FIRST_1904_S <= seconds <= _LAST_1904_S:
        return _FROM_1904_S / scale
    return None


def _day_zero(first: float) -> float | None:
    return next((zero for low, high, zero, _ in _DAY_COUNTS if low <= first < high), None)


def unit_scale(name: str, unit: str, values: Values) -> tuple[float, bool]:
    """Seconds per count of a time column, and whether it counts from 1970."""
    try:
        scale = scale_of(values, name, unit)
    except RecordError:
        return stated_scale(name, unit) or 1.0, False
    return scale.seconds, scale.offset == 0.0
