"""Dates and times written as text, converted to nanoseconds."""

import dataclasses
import datetime
import functools
import re
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Int64

from slowtime_services.files.reading_options import DateOrder

from .zones import ABBREVIATIONS, offset_s

Kind = Literal["stamp", "date", "clock"]

FIRST_YEAR, LAST_YEAR = 1900, 2200
"""Years of records: within what 64 bits of nanoseconds hold, 1678 to 2262."""
DAY_NS = 86_400_000_000_000
LONGEST = 48
"""Characters of the longest stamp: "Wednesday, September 30, 2026 11:59:59.999999 PM +02:00"
is about as long as they come."""
_EPOCH = datetime.date(1970, 1, 1).toordinal()
_FEWEST_YEARS_TURN = 70
"""Two-digit years from here on are of the last century, as POSIX and Excel nearly have it."""

_TIME = (
    r"(?P<h>\d{1,2}):(?P<mi>\d{2})(?::(?P<s>\d{2}))?(?:[.,:](?P<f>\d{1,12}))?"
    r"(?:\s*(?P<ap>[AaPp])\.?[Mm]\.?)?"
)
_PACKED_TIME = r"(?P<h>\d{2})(?P<mi>\d{2})(?P<s>\d{2})(?:[.,](?P<f>\d{1,12}))?"
_ZONE = (
    r"(?:\s*\(?(?P<z>(?:UTC|GMT)\s?[+-]\d{1,2}(?::?\d{2})?|[+-]\d{2}(?::?\d{2})?|"
    rf"{ABBREVIATIONS})\)?)?"
)
_WEEKDAY = r"(?:[A-Za-z]{3,9}\.?,?\s+)?"
_DATES = (
    r"(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})",
    r"(?P<y>\d{4})[-,./](?P<j>\d{3})",
    r"(?P<d>\d{1,2})\.(?P<m>\d{1,2})\.(?P<y>\d{4}|\d{2})",
    r"(?P<a>\d{1,2})[/-](?P<b>\d{1,2})[/-](?P<y>\d{4}|\d{2})",
    _WEEKDAY + r"(?P<d>\d{1,2})[-\s/.]+(?P<mon>[^\W\d_]{3,9})\.?[-\s/,]+(?P<y>\d{4}|\d{2})",
    _WEEKDAY + r"(?P<mon>[^\W\d_]{3,9})\.?\s+(?P<d>\d{1,2}),?\s+(?P<y>\d{4})",
)
_JOIN = r"(?:[T_,;]\s*|\s+-?\s*|:)"
_PACKED = r"(?P<y>(?:19|20)\d{2})(?P<m>[01]\d)(?P<d>[0-3]\d)[T_\s-]" + _PACKED_TIME
_STAMPS = tuple(
    re.compile(form, re.ASCII if "[^" not in form else 0)
    for form in (*(date + _JOIN + _TIME + _ZONE for date in _DATES), _PACKED + _ZONE)
)
_ONLY_DATES = tuple(re.compile(date) for date in _DATES)
_CLOCK = re.compile(_TIME + _ZONE)
_MONTHS = {
    name: number
    for number, names in enumerate(
        (
            "jan january januar jän jänner janv janvier ene enero gen gennaio janeiro",
            "feb february februar févr février fév fevr febrero febbraio fev fevereiro",
            "mar march mär märz mrz mars marzo março maerz",
            "apr april avr avril abr abril aprile",
            "may mai mayo mag maggio maio",
            "jun june juni juin junio giu giugno junho",
            "jul july juli juil juillet julio lug luglio julho",
            "aug august août aout ago agosto",
            "sep sept september septembre septiembre set settembre setembro",
            "oct october okt oktober octobre octubre ott ottobre out outubro",
            "nov november novembre noviembre novembro",
            "dec december dez dezember déc décembre dic diciembre dicembre dezembro",
        ),
        start=1,
    )
    for name in names.split()
}


@dataclasses.dataclass(frozen=True, slots=True)
class Stamps:
    """A column of dates and times.

    Parameters
    ----------
    ns
        Nanoseconds since 1970-01-01 (UTC where a zone is stated, else as written); since
        midnight where `dated` is false.
    dated
        Whether a date is stated, and which it is.
    zoned
        Whether every stamp states its zone.
    quantum_ns
        Step of the last digit [ns].
    ambiguous
        The first date, where its parts could be exchanged; else empty.
    """

    ns: Int64[np.ndarray, " row"]
    dated: bool
    zoned: bool
    quantum_ns: int
    ambiguous: str = ""


def kind_of(text: str) -> Kind | None:
    """Whether `text` is a date with a time, a date, or a time of day.

    Examples
    --------
    >>> [kind_of(t) for t in ("2024-04-21T15:00:00.010Z", "21.04.2024", "15:00:00,5", "0.5")]
    ['stamp', 'date', 'clock', None]
    """
    if not 3 < len(text) <= LONGEST or ("/" not in text and not _MAYBE.search(text)):
        return None
    if any(form.fullmatch(text) for form in _STAMPS):
        return "stamp"
    if _CLOCK.fullmatch(text):
        return "clock"
    if any(form.fullmatch(text) for form in _ONLY_DATES):
        return "date"
    return None


_MAYBE = re.compile(r"\d[:T_ .-]\s?\w|[A-Za-z]{3}.*\d")


def read_stamps(texts: Sequence[str], order: DateOrder | None = None) -> Stamps:
    """Read a column of stamps, all of which are of one form.

    Parameters
    ----------
    order
        Order of day, month and year in dates such as 04/05/2024 or 24/04/21; None to find out
        from the dates themselves.

    Raises
    ------
    ValueError
        Where a text is not of the form of the first, or names a date that does not exist. Its
        arguments are a sentence and the row.
    """
    form = _form_of(texts[0])
    parts = [form.fullmatch(text) for text in texts]
    for row, part in enumerate(parts):
        if part is None:
            raise ValueError(f"{texts[row][:40]!r} is not written as {texts[0][:40]!r} is", row)
    found = [part for part in parts if part is not None]
    groups = form.groupindex
    dates: tuple[DateOrder, str] = _order_of(found, order) if "a" in groups else ("dmy", "")
    dated = "y" in groups
    timed = "h" in groups
    minutes_first = timed and all(p["s"] is None for p in found) and any(p["f"] for p in found)
    ns = np.empty(len(found), np.int64)
    digits = 0
    zoned = timed
    for row, part in enumerate(found):
        try:
            value = _days(part, dates[0]) * DAY_NS if dated else 0
            if timed:
                value += _clock_ns(part, minutes_first)
                digits = max(digits, len(part["f"] or ""))
                zoned = zoned and part["z"] is not None
                value -= _offset_ns(part["z"] or "Z")
        except (ValueError, OverflowError) as error:
            raise ValueError(
                f"{texts[row][:40]!r} is not a valid date or time: {error}", row
            ) from None
        ns[row] = value
    return Stamps(ns, dated, zoned, 10 ** max(9 - digits, 0), dates[1])


def _form_of(text: str) -> re.Pattern[str]:
    for form in (*_STAMPS, _CLOCK, *_ONLY_DATES):
        if form.fullmatch(text):
            return form
    raise ValueError(f"{text[:40]!r} is no date or time that is known", 0)


_DAY_IS: dict[DateOrder, str] = {"dmy": "a", "mdy": "b", "ymd": "y"}
"""Which part of a date such as 24/04/21 is the day."""


def _order_of(found: Sequence[re.Match[str]], given: DateOrder | None) -> tuple[DateOrder, str]:
    """Return the order of dates in three numbers; and the first date, if nothing decides."""
    short = all(len(part["y"]) == 2 for part in found)
    if given is not None and (short or given != "ymd"):
        return given, ""
    values = {name: {int(part[name]) for part in found} for name in "aby"}
    possible = _possible_orders(values, short)
    # From one day to the next the day changes, the month and the year seldom do.
    changes = sorted(values, key=lambda name: len(values[name]))
    if len(values[changes[-1]]) > len(values[changes[-2]]):
        possible = [o for o in possible if _DAY_IS[o] == changes[-1]] or possible
    if "mdy" in possible and "ap" in found[0].re.groupindex and found[0]["ap"]:
        return "mdy", ""  # Hours of twelve and a day in second place are American.
    if len({tuple(_date_in(part, o) for part in (found[0], found[-1])) for o in possible}) == 1:
        return possible[0], ""
    part = found[0]
    return possible[0], part.group()[part.start("a") : part.end("y")]


def _possible_orders(values: dict[str, set[int]], short: bool) -> list[DateOrder]:
    """Return the orders in which all numbers are days and months; one at least."""
    most = {name: max(some) for name, some in values.items()}
    orders: list[DateOrder] = []
    if most["b"] <= 12:
        orders.append("dmy")
    if most["a"] <= 12:
        orders.append("mdy")
    if short and most["b"] <= 12 and most["y"] <= 31 and 0 not in values["y"]:
        orders.append("ymd")
    if most["a"] > 31 and "ymd" in orders:
        orders.remove("dmy")
    return orders or ["dmy"]


def _date_in(part: re.Match[str], order: DateOrder) -> tuple[str, str, str]:
    """Year, month and day of a date in three numbers."""
    a, b, y = part["a"], part["b"], part["y"]
    return (y, b, a) if order == "dmy" else (y, a, b) if order == "mdy" else (a, b, y)


def _days(part: re.Match[str], order: DateOrder) -> int:
    if "a" in part.re.groupindex:
        return _ordinal(*_date_in(part, order), "", "")
    get = part.groupdict().get
    return _ordinal(
        get("y") or "", get("m") or "", get("d") or "", get("mon") or "", get("j") or ""
    )


@functools.lru_cache(maxsize=64)
def _ordinal(year: str, month: str, day: str, name: str, of_year: str) -> int:
    number = int(year)
    if len(year) == 2:
        number += 1900 if number >= _FEWEST_YEARS_TURN else 2000
    if not FIRST_YEAR <= number <= LAST_YEAR:
        raise ValueError(f"years from {FIRST_YEAR} to {LAST_YEAR} are read")
    if of_year:
        return datetime.date(number, 1, 1).toordinal() + int(of_year) - 1 - _EPOCH
    if name:
        found = _MONTHS.get(name.casefold())
        if found is None:
            raise ValueError(f"{name!r} is no month that is known")
        month = str(found)
    return datetime.date(number, int(month), int(day)).toordinal() - _EPOCH


def _clock_ns(part: re.Match[str], minutes_first: bool) -> int:
    first, second, third = int(part["h"]), int(part["mi"]), int(part["s"] or 0)
    fraction = int(((part["f"] or "") + "000000000")[:9])
    if minutes_first:
        first, second, third = 0, first, second
    names = part.re.groupindex
    if "ap" in names and part["ap"]:
        if not 1 <= first <= 12:
            raise ValueError("hours of a.m. and p.m. run from 1 to 12")
        first = first % 12 + (12 if part["ap"] in "Pp" else 0)
    if second > 59 or third > 60:
        raise ValueError("minutes and seconds end at 59")
    return ((first * 60 + second) * 60 + third) * 10**9 + fraction


@functools.lru_cache(maxsize=64)
def _offset_ns(zone: str) -> int:
    return offset_s(zone) * 10**9
