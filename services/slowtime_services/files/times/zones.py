"""Time zones as files state them: fixed offsets from UTC, and abbreviations of one meaning."""

import dataclasses
import re
from collections.abc import Sequence

MOST_LINES, LONGEST_LINE = 200, 300
_HOURS = {
    "UTC": 0, "GMT": 0, "Z": 0, "WET": 0, "WEST": 1, "CET": 1, "CEST": 2, "MEZ": 1, "MESZ": 2,
    "EET": 2, "EEST": 3, "OEZ": 2, "OESZ": 3, "MSK": 3, "SAST": 2, "HKT": 8, "SGT": 8, "JST": 9,
    "KST": 9, "AWST": 8, "ACST": 9.5, "ACDT": 10.5, "AEST": 10, "AEDT": 11, "NZST": 12,
    "NZDT": 13, "EST": -5, "EDT": -4, "MDT": -6, "PDT": -7, "AKST": -9, "AKDT": -8, "HST": -10,
}  # fmt: skip
"""Abbreviations of one meaning, in hours ahead of UTC; CST, IST and BST have several."""
ABBREVIATIONS = "|".join(sorted(_HOURS, key=len, reverse=True))
_SIGNED = r"[+\-−]\s?\d{1,2}(?::?\d{2})?"
_FIXED = re.compile(
    rf"(?:UTC|GMT)\s*{_SIGNED}(?![\d:])|(?<![\w.:])[+\-−]\d{{2}}:?\d{{2}}(?![\d:])"
)
_NAMED = re.compile(rf"(?<![^\W_])(?:{ABBREVIATIONS})(?![^\W_])")
_UNCLEAR = re.compile(
    r"(?<![^\W_])(?:(?:Europe|America|Asia|Africa|Australia|Pacific|Atlantic|Indian|US|Etc)"
    r"/[\w+-]+|CST|CDT|IST|BST|PST|MST|AST|ADT|"
    r"(?i:local|lokal\w*|ortszeit|heure\s+locale|hora\s+local))(?![^\W_])"
)
_KEY = re.compile(
    r"(?:(?:utc|gmt|time[\s_-]*zone)[\s_-]*offset|time[\s_-]*zone|zeitzone|"
    r"fuseau(?:\s+horaire)?|zona\s+horaria|fuso\s+orario|(?<![^\W_])tz(?![^\W_]))"
    r"\s*(?:[\[(](?P<unit>[^\])]*)[\])])?\s*(?P<mark>[:=;,\t ])\s*(?P<value>\S.*)$",
    re.I,
)
_NUMBER = re.compile(
    r"(?P<sign>[+\-−]?)(?P<h>\d{1,3})(?::?(?P<m>\d{2})|(?P<f>\.\d+))?\s*"
    r"(?P<unit>h|hrs?|hours?|std|stunden|min|minutes|minuten|)",
    re.I,
)
LONGEST_SAID = 40
"""Characters of words that are quoted as a zone."""
MOST_HOURS = 14
"""The zone furthest ahead of UTC [h]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Zone:
    """A time zone as a file states it.

    Parameters
    ----------
    text
        Its words.
    ahead_s
        Seconds ahead of UTC; None where the words do not tell.
    """

    text: str
    ahead_s: int | None

    @property
    def ahead_ns(self) -> int:
        """Nanoseconds ahead of UTC; 0 where the words do not tell."""
        return (self.ahead_s or 0) * 10**9

    @property
    def said(self) -> str:
        """Describe how times were read."""
        if self.ahead_s is None:
            return f"in UTC, because the time zone {self.text!r} was not understood"
        if self.ahead_s == 0:
            return "in UTC, as stated"
        hours, minutes = divmod(abs(self.ahead_s) // 60, 60)
        sign = "-" if self.ahead_s < 0 else "+"
        return f"in the stated time zone {self.text!r} (UTC{sign}{hours:02d}:{minutes:02d})"


def offset_s(text: str) -> int:
    """Return the seconds ahead of UTC of ``Z``, ``+02:00``, ``UTC-4`` or ``CEST``.

    Examples
    --------
    >>> offset_s("UTC+5:30"), offset_s("-0400"), offset_s("CEST")
    (19800, -14400, 7200)
    """
    if text in _HOURS:
        return round(3600 * _HOURS[text])
    digits = re.sub(r"[^\d:]", "", text)
    hours, _, minutes = digits.partition(":")
    if not minutes and len(hours) > 2:
        hours, minutes = hours[:-2], hours[-2:]
    seconds = int(hours) * 3600 + int(minutes or 0) * 60
    return -seconds if re.search(r"[-−]", text) else seconds


def zone_in(text: str) -> Zone | None:
    """Find the zone that the name of a column, or a line, contains.

    Examples
    --------
    >>> zone_in("Date Time, GMT-04:00"), zone_in("Timestamp (local)"), zone_in("Time")
    (Zone(text='GMT-04:00', ahead_s=-14400), Zone(text='local', ahead_s=None), None)
    """
    for form in (_FIXED, _NAMED):
        if found := form.search(text):
            ahead = offset_s(found.group())
            within = abs(ahead) <= MOST_HOURS * 3600
            return Zone(found.group(), ahead if within else None)
    unclear = _UNCLEAR.search(text)
    return Zone(unclear.group(), None) if unclear else None


def stated_zone(lines: Sequence[str]) -> Zone | None:
    """Find the zone that lines of a heading state; None where they state none, or several.

    Examples
    --------
    >>> stated_zone(["Time zone: UTC+2"]), stated_zone(["UTC offset (h): -4"])
    (Zone(text='UTC+2', ahead_s=7200), Zone(text='-4', ahead_s=-14400))
    """
    found: dict[int | None, Zone] = {}
    for line in lines[:MOST_LINES]:
        key = _KEY.search(line[:LONGEST_LINE].replace('"', ""))
        if key is not None:
            value = key["value"].strip(" \t;,")
            zone = zone_in(value) or _by_number(value, key["unit"] or "")
            if zone is None and key["mark"] in ":=":
                zone = Zone(value[:LONGEST_SAID], None)
            if zone is not None:
                found.setdefault(zone.ahead_s, zone)
    return found.popitem()[1] if len(found) == 1 else None


def _by_number(value: str, unit: str) -> Zone | None:
    number = _NUMBER.fullmatch(value)
    if number is None:
        return None
    hours = int(number["h"]) + int(number["m"] or 0) / 60 + float(number["f"] or 0)
    worth = 60 if (number["unit"] or unit).casefold().startswith("min") else 3600
    ahead = round(hours * worth) * (
        -1 if number["sign"] in ("-", "−") and number["sign"] else 1
    )
    return Zone(value, ahead) if abs(ahead) <= MOST_HOURS * 3600 else None
