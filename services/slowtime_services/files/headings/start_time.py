"""The time of the first sample, as a heading states it."""

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from slowtime_services.files.reading_options import DateOrder
from slowtime_services.files.times.stamps import read_stamps
from slowtime_services.files.times.time_units import words_of
from slowtime_services.files.times.zones import Zone, zone_in

MOST_LINES, LONGEST_LINE = 200, 300
_START = re.compile(
    r"(?:start|begin|beginn|d[ée]but|inicio|inizio|first[\s_]*sample|trigger|record(?:ing|ed)?|"
    r"acquisition|measurement|measured|mess|aufnahme|log|capture)[\s_]*"
    r"(?:of[\s_]+\w+[\s_]*)?(?:utc[\s_]*)?"
    r"(?P<what>date[\s_/]*(?:and[\s_]*)?time|time[\s_]*stamp|date|time|datum|zeit|on|at)?",
    re.I,
)
_PLAIN = re.compile(r"(?:date[\s_]*[/&]?[\s_]*time|datetime|t0|t_0)(?![a-z])", re.I)
_OTHER = re.compile(
    r"creat|export|saved|written|print|calib|modif|event|origin|epicent|end|stop|duration|"
    r"length|zone|offset|format|version|firmware|software|install|download|upload|commission|"
    r"deploy|servic|monitoring|campaign|project|power|boot",
    re.I,
)
"""Words of times that are of something else than the first sample."""
_BEGINS = re.compile(
    r"start|begin|beginn|d[ée]but|inicio|inizio|first[\s_]*sample|trigger", re.I
)
_OF_A_START = re.compile(
    r"record\w*|acqui\w*|measur\w*|messung|mess|messzeit|aufnahme\w*|aufzeichnung|log|logged|"
    r"logging|captur\w*|date|time|datum|zeit|uhrzeit|stamp|timestamp|datetime|on|at|of|the|and|"
    r"utc|gmt|vom|am|um|der|start|data|file|test|local|h|hh|mm|ss|dd|yyyy|yyyymmdd|hhmmss|"
    r"y|m|d|z|[a-z]{3,4}t",
    re.I,
)
"""Words of a key such as ``Recording date``; ``Logger firmware`` has others."""
_VALUE = re.compile(r"[:=;,\t]|\s{2,}|\s(?=\d)")
_CLOCK = re.compile(r"\d{1,2}:\d{2}")


class StatedStart(NamedTuple):
    """Time of the first sample [ns since 1970], the words that state it, and their zone."""

    ns: int | None
    said: str = ""
    zone: str = "in UTC"


def stated_start(
    lines: Sequence[str], order: DateOrder | None = None, zone: Zone | None = None
) -> StatedStart:
    """Read the time of the first sample from lines of a heading.

    Nothing is taken where lines state several times, or a date that may begin with the day or
    the month.

    Parameters
    ----------
    zone
        Time zone that the heading states; UTC if None.

    Examples
    --------
    >>> stated_start(["Start time: 2024-04-21 15:00:00"])[:2]
    (1713711600000000000, 'Start time: 2024-04-21 15:00:00')
    """
    found: dict[int, StatedStart] = {}
    dates: list[str] = []
    times: list[str] = []
    for text, value, what in _stated(lines):
        start = _start(value, order, zone_in(text[: text.find(value)]) or zone, text)
        if start is not None:
            found.setdefault(start.ns or 0, start)
        elif "date" in what or "datum" in what:
            dates.append(value)
        elif _CLOCK.search(value):
            times.append(value)
    if not found and len(dates) == len(times) == 1:
        text = f"{dates[0]} {times[0]}"
        start = _start(text, order, zone, text)
        if start is not None:
            found[start.ns or 0] = start
    return found.popitem()[1] if len(found) == 1 else StatedStart(None)


def _stated(lines: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Return lines that state a start, their value, and the word of its meaning."""
    for line in lines[:MOST_LINES]:
        text = " ".join(line[:LONGEST_LINE].replace('"', " ").strip("#%!;*/ \r\n,").split(" "))
        cut = re.search(r"\d", text)
        if cut is None:
            continue
        mark = _VALUE.search(text)
        key = _PLAIN.match(text) or _START.search(text[: mark.start() if mark else 0])
        named = re.match(r"[^\d:=;,\t]*_(?:YYYYMMDD\w*)\s*[:=]", text)
        if named is not None:
            value, key_text = text[named.end() :], named.group()
        elif key is not None and mark is not None:
            begin = max(mark.end(), key.end())
            value, key_text = text[begin:], text[:begin]
        else:
            continue
        if not _OTHER.search(key_text) and _is_start(key_text):
            what = (key.groupdict().get("what") or "") if key is not None else ""
            yield " ".join(text.split())[:60], value.strip(" :=;,\t"), what.casefold()


def _is_start(key: str) -> bool:
    """Whether a key speaks of a start, or all its words are of a recording."""
    if _PLAIN.match(key) or _BEGINS.search(key):
        return True
    words = [word for word in words_of(key) if not word.isdigit()]
    return all(map(_OF_A_START.fullmatch, words))


def _start(
    value: str, order: DateOrder | None, zone: Zone | None, text: str
) -> StatedStart | None:
    """Read a date with a time, however they are joined."""
    joined = re.sub(r"\s*[,;\t]\s*", " ", value.strip()).replace("_", " ")
    joined = re.sub(r"\s+", " ", joined)
    for one in dict.fromkeys((value.strip(), joined, joined.replace(" ", "T", 1))):
        try:
            stamps = read_stamps([one], order)
        except ValueError:
            continue
        if stamps.dated and not stamps.ambiguous and _CLOCK_OR_PACKED.search(one):
            if stamps.zoned or zone is None:
                return StatedStart(int(stamps.ns[0]), text)
            return StatedStart(int(stamps.ns[0]) - zone.ahead_ns, text, zone.said)
    return None


_CLOCK_OR_PACKED = re.compile(r"\d{1,2}:\d{2}|\d{8}[ _T]\d{6}")
