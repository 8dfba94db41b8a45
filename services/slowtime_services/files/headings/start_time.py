"""The time of the first sample, as a heading states it."""

import re
from collections.abc import Iterator, Sequence

from slowtime_services.files.times.stamps import DateOrder, read_stamps

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
    r"length|zone|offset|format|version",
    re.I,
)
"""Words of times that are of something else than the first sample."""
_VALUE = re.compile(r"[:=;,\t]|\s{2,}|\s(?=\d)")
_CLOCK = re.compile(r"\d{1,2}:\d{2}")


def stated_start(
    lines: Sequence[str], order: DateOrder | None = None
) -> tuple[int | None, str]:
    """Read the time of the first sample [ns since 1970], and the words that state it.

    Nothing is taken where lines state several times, or a date that may begin with the day or
    the month.

    Examples
    --------
    >>> stated_start(["Start time: 2024-04-21 15:00:00"])
    (1713711600000000000, 'Start time: 2024-04-21 15:00:00')
    """
    found: dict[int, str] = {}
    dates: list[str] = []
    times: list[str] = []
    for text, value, what in _stated(lines):
        stamp = _stamp(value, order)
        if stamp is not None:
            found.setdefault(stamp, text)
        elif "date" in what or "datum" in what:
            dates.append(value)
        elif _CLOCK.search(value):
            times.append(value)
    if not found and len(dates) == len(times) == 1:
        stamp = _stamp(f"{dates[0]} {times[0]}", order)
        if stamp is not None:
            found[stamp] = f"{dates[0]} {times[0]}"
    if len(found) != 1:
        return None, ""
    stamp, text = found.popitem()
    return stamp, text


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
        if not _OTHER.search(key_text):
            what = (key.groupdict().get("what") or "") if key is not None else ""
            yield " ".join(text.split())[:60], value.strip(" :=;,\t"), what.casefold()


def _stamp(value: str, order: DateOrder | None) -> int | None:
    """Read a date with a time, however they are joined."""
    joined = re.sub(r"\s*[,;\t]\s*", " ", value.strip()).replace("_", " ")
    joined = re.sub(r"\s+", " ", joined)
    for text in dict.fromkeys((value.strip(), joined, joined.replace(" ", "T", 1))):
        try:
            stamps = read_stamps([text], order)
        except ValueError:
            continue
        if stamps.dated and not stamps.ambiguous and _CLOCK_OR_PACKED.search(text):
            return int(stamps.ns[0])
    return None


_CLOCK_OR_PACKED = re.compile(r"\d{1,2}:\d{2}|\d{8}[ _T]\d{6}")
