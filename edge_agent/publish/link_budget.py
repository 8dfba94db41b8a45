"""Bytes that a link may carry in a calendar month: what is spent, and when more may be."""

import datetime
import json
import logging
from pathlib import Path
from typing import NamedTuple

from slowtime_services.documents.json_documents import read_json
from slowtime_services.link_profiles import (
    CONNECTION_BYTES,
    KEEP_ALIVE_BYTES,
    MESSAGE_BYTES,
)

logger = logging.getLogger(__name__)

RESERVE = 0.1
"""Share of the budget that regular batches leave to urgent messages and health [1]."""

HEAD_START_NS = 86_400 * 10**9
"""Time by which regular batches may be ahead of an even rate over the month [ns], so that a
budget is of use in its first hours."""


class Month(NamedTuple):
    """A calendar month (UTC)."""

    name: str
    start_ns: int
    end_ns: int

    @classmethod
    def of(cls, now_ns: int) -> "Month":
        """Return the month of an instant.

        Examples
        --------
        >>> Month.of(1_796_000_000 * 10**9).name
        '2026-11'
        """
        now = datetime.datetime.fromtimestamp(now_ns // 10**9, datetime.UTC)
        start = now.replace(day=1, hour=0, minute=0, second=0)
        following = (start + datetime.timedelta(days=32)).replace(day=1)
        return cls(f"{now:%Y-%m}", *(int(t.timestamp()) * 10**9 for t in (start, following)))


class LinkBudget:
    """The bytes of the current month, kept across restarts, and the rate at which to spend.

    Regular batches are spread evenly: they wait while more is spent than an even rate allows,
    so that batches become longer. Urgent messages wait only once the whole budget is spent.

    Parameters
    ----------
    budget_bytes
        Of a month; None without a bound.
    keep_alive_s
        Time from one keep-alive to the next [s].
    """

    def __init__(self, path: Path, budget_bytes: int | None, keep_alive_s: float) -> None:
        self._path, self.budget_bytes = path, budget_bytes
        self._idle_rate = KEEP_ALIVE_BYTES / keep_alive_s
        self._month, self._spent = _read(path)
        self._kept = self._spent

    def spend(self, payload_bytes: int) -> None:
        """Note a message that was sent or received."""
        self._spent += payload_bytes + MESSAGE_BYTES

    def connect(self) -> None:
        """Count the opening of a connection."""
        self._spent += CONNECTION_BYTES

    def pass_time(self, seconds: float) -> None:
        """Count the keep-alives of a time, which no setting of the clock changes [s]."""
        self._spent += self._idle_rate * seconds

    def spent(self, now_ns: int) -> int:
        """Return the bytes of the month so far."""
        month = Month.of(now_ns).name
        if self._month not in ("", month):
            self._spent = self._kept = 0.0
        self._month = month
        return round(self._spent)

    def ready_ns(self, payload_bytes: int, now_ns: int, *, urgent: bool = False) -> int:
        """Return the time from which a message of so many bytes may be sent [ns]."""
        if self.budget_bytes is None:
            return now_ns
        month = Month.of(now_ns)
        length_ns = month.end_ns - month.start_ns
        idle_left = self._idle_rate * (month.end_ns - now_ns) / 1e9
        total = self.spent(now_ns) + idle_left + payload_bytes + MESSAGE_BYTES
        if urgent:
            return now_ns if total <= self.budget_bytes else month.end_ns
        # Keep-alives of the rest of the month are set aside; the rest is spread evenly.
        free = (1.0 - RESERVE) * (self.budget_bytes - self._idle_rate * length_ns / 1e9)
        used = total - self._idle_rate * length_ns / 1e9
        if free <= 0 or used > free:
            return month.end_ns
        even_ns = used / free * (length_ns + HEAD_START_NS) - HEAD_START_NS
        return max(now_ns, month.start_ns + round(even_ns))

    def keep(self, now_ns: int) -> None:
        """Write the sum to the disk where it has changed; a full disk may prevent it."""
        self.spent(now_ns)  # in a new month it begins anew
        if self._spent == self._kept:
            return
        new = self._path.with_suffix(".new")
        try:
            new.write_text(json.dumps({"month": self._month, "bytes": round(self._spent)}))
            new.replace(self._path)
            self._kept = self._spent
        except OSError:
            logger.exception("%s cannot be written; the sum is kept in memory.", self._path)


def _read(path: Path) -> tuple[str, float]:
    try:
        content = read_json(path.read_text())
        return str(content["month"]), float(content["bytes"])
    except FileNotFoundError:
        return "", 0.0
    except (ValueError, KeyError, TypeError) as error:
        logger.warning("%s cannot be read and is started again: %r", path, error)
        return "", 0.0
