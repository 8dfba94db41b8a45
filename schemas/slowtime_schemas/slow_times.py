"""Writes times and spans of slow time for people, with their unit."""

import datetime

UNIT_WORDS = {
    "T0": "natural periods", "s": "s", "min": "min", "h": "h", "d": "days", "day": "days",
    "month": "months", "year": "years", "cycle": "cycles",
}  # fmt: skip
"""Unit of slow time, as messages name it → the words for it."""

FIRST_CLOCK_S = 1e9
"""Slow times in seconds from here on (2001-09-09) are a clock that counts from 1970 [s]."""
LAST_CLOCK_S = 2.5e11
"""Moments beyond the year 9890 have no date [s]."""


def unit_in_words(unit: str | None) -> str:
    """Name a unit of slow time.

    Parameters
    ----------
    unit
        Unit as messages name it; None or empty where none was given.

    Returns
    -------
    The words for it, or the unit as it was given; empty where there is none.

    Examples
    --------
    >>> unit_in_words("T0"), unit_in_words("load cycles"), unit_in_words(None)
    ('natural periods', 'load cycles', '')
    """
    return UNIT_WORDS.get(unit, unit) if unit else ""


def one_unit_in_words(unit: str | None) -> str:
    """Name one unit of slow time, as in a rate per unit.

    Parameters
    ----------
    unit
        Unit as messages name it; None or empty where none was given.

    Returns
    -------
    The word for one of it.

    Examples
    --------
    >>> one_unit_in_words("T0"), one_unit_in_words("s"), one_unit_in_words(None)
    ('natural period', 's', 'unit of slow time')
    """
    words = unit_in_words(unit) or "unit of slow time"
    return words.removesuffix("s") if len(words) > 1 else words


def span_in_words(span: float, unit: str | None, digits: int = 4) -> str:
    """Write a span of slow time.

    Parameters
    ----------
    span
        Span, in `unit`.
    unit
        Unit as messages name it; None or empty where none was given.
    digits
        How many digits of the number are shown.

    Returns
    -------
    The span with its unit.

    Examples
    --------
    >>> span_in_words(12.5, "T0"), span_in_words(3.0, "d"), span_in_words(12.5, None)
    ('12.5 natural periods', '3 days', '12.5 units of slow time')
    """
    return f"{span:.{digits}g} {unit_in_words(unit) or 'units of slow time'}"


def time_in_words(time: float, unit: str | None) -> str:
    """Write an instant of slow time; as a date where slow time is the time of day.

    Parameters
    ----------
    time
        Slow time, in `unit`.
    unit
        Unit as messages name it; None or empty where none was given.

    Returns
    -------
    The instant with its unit, or its date in UTC.

    Examples
    --------
    >>> time_in_words(300.0, "T0"), time_in_words(1.7e9, "s")
    ('slow time 300 natural periods', '2023-11-14 22:13:20 UTC')
    >>> time_in_words(300.0, "")
    'slow time 300'
    """
    if unit == "s" and FIRST_CLOCK_S <= time < LAST_CLOCK_S:
        at = datetime.datetime.fromtimestamp(time, datetime.UTC)
        return f"{at:%Y-%m-%d %H:%M:%S} UTC"
    return f"slow time {time:.6g} {unit_in_words(unit)}".rstrip()
