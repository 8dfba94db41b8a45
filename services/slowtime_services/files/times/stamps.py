"""Dates and times written as text, converted to nanoseconds."""

import dataclasses
import datetime
import functools
import re
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Int64

Kind = Literal["stamp", "date", "clock"]
DateOrder = Literal["dmy", "mdy"]

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
_ZONE = r"(?:\s*(?P<z>Z|UTC|GMT|[+-]\d{2}(?::?\d{2})?))?"
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
        The first date, where day and month could be exchanged; else empty.
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
        Whether the day or the month comes first in dates such as 04/05/2024; None to find out
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
    day_first, ambiguous = _day_first(found, order) if "a" in groups else (True, "")
    dated = "y" in groups
    timed = "h" in groups
    minutes_first = timed and all(p["s"] is None for p in found) and any(p["f"] for p in found)
    ns = np.empty(len(found), np.int64)
    digits = 0
    zoned = timed
    for row, part in enumerate(found):
        try:
            value = _days(part.groupdict(), day_first) * DAY_NS if dated else 0
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
    return Stamps(ns, dated, zoned, 10 ** max(9 - digits, 0), ambiguous)


def _form_of(text: str) -> re.Pattern[str]:
    for form in (*_STAMPS, _CLOCK, *_ONLY_DATES):
        if form.fullmatch(text):
            return form
    raise ValueError(f"{text[:40]!r} is no date or time that is known", 0)


def _day_first(found: Sequence[re.Match[str]], order: DateOrder | None) -> tuple[bool, str]:
    """Whether the day is first; and the first date, if nothing decides."""
    if order is not None:
        return order == "dmy", ""
    firsts = {int(part["a"]) for part in found}
    seconds = {int(part["b"]) for part in found}
    if max(firsts) > 12:
        return True, ""
    if max(seconds) > 12:
        return False, ""
    # From one day to the next the day changes, the month seldom does.
    if len(firsts) != len(seconds):
        return len(firsts) > len(seconds), ""
    if firsts == seconds and len(firsts) == 1:
        return True, ""
    if "ap" in found[0].re.groupindex and found[0]["ap"]:
        return False, ""  # Hours of twelve and a day in second place are American.
    part = found[0]
    return True, f"{part['a']}/{part['b']}/{part['y']}"


def _days(part: dict[str, str | None], day_first: bool) -> int:
    get = part.get
    if get("a"):
        day, month = (get("a"), get("b")) if day_first else (get("b"), get("a"))
        return _ordinal(get("y") or "", month or "", day or "", "", "")
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
    if zone in ("Z", "UTC", "GMT"):
        return 0
    digits = zone[1:].replace(":", "")
    seconds = int(digits[:2]) * 3600 + int(digits[2:] or 0) * 60
    return (-seconds if zone[0] == "-" else seconds) * 10**9
