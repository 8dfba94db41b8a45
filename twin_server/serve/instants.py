"""Parses instants of requests: RFC 3339, nanoseconds, or slow time."""

import datetime
import math
import re
from typing import Annotated, NamedTuple

from fastapi import Query

from .http.problems import ProblemError

_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
_SPACE_BEFORE_OFFSET = re.compile(r" (?=\d\d:?\d\d$)")
_FRACTION = re.compile(r"\.(\d+)")


MomentText = Annotated[
    str | None,
    Query(
        description="RFC 3339 (2026-11-20T12:00:00Z), nanoseconds since 1970-01-01 UTC, or "
        "slow time (slow:812.5).",
        examples=["slow:812.5"],
    ),
]


class Moment(NamedTuple):
    """Sensor time or slow time; the other one is None."""

    t_ns: int | None = None
    slow_time: float | None = None


class MomentError(ValueError):
    """Text that is not an instant."""


def parse_moment(text: str) -> Moment:
    """Read a moment.

    Examples
    --------
    >>> parse_moment("slow:12.5").slow_time
    12.5
    >>> parse_moment("2026-01-01T00:00:00.000000001Z") == parse_moment("1767225600000000001")
    True
    """
    try:
        if text.startswith("slow:"):
            slow = float(text.removeprefix("slow:"))
            if math.isfinite(slow):
                return Moment(slow_time=slow)
        elif re.fullmatch(r"[0-9]{1,19}", text) and int(text) < 2**63:
            return Moment(t_ns=int(text))
        else:
            return Moment(t_ns=_from_rfc3339(text))
    except ValueError:
        pass
    raise MomentError(
        f"{text:.60} is not a valid date and time. Give RFC 3339 with a time zone, such as "
        "2026-11-20T12:00:00Z; nanoseconds since 1970-01-01 UTC, such as "
        "1795176000000000000; or slow time, such as slow:812.5."
    )


def moment_of(name: str, text: str | None) -> Moment | None:
    """Read the moment of a query.

    Raises
    ------
    ProblemError
        Where it is none.
    """
    if text is None:
        return None
    try:
        return parse_moment(text)
    except MomentError as error:
        raise ProblemError(422, "not-valid", f"At query.{name}, {error}") from error


def _from_rfc3339(text: str) -> int:
    """Nanoseconds since 1970; a "+" that became a space on its way in a URL is put back."""
    text = _SPACE_BEFORE_OFFSET.sub("+", text)
    fraction = _FRACTION.search(text)
    digits = fraction.group(1) if fraction else ""
    whole = datetime.datetime.fromisoformat(_FRACTION.sub("", text))
    if whole.tzinfo is None:
        raise ValueError("no time zone")
    seconds = round((whole - _EPOCH).total_seconds())
    t_ns = seconds * 10**9 + int(digits[:9].ljust(9, "0") or 0)
    if not 0 <= t_ns < 2**63:
        raise ValueError("out of range")
    return t_ns
