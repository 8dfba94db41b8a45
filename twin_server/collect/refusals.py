"""Counts refused messages by reason, and logs them at a bounded rate."""

import logging
import threading
import time
from collections import Counter
from collections.abc import Mapping
from types import MappingProxyType

from slowtime_schemas import codec

logger = logging.getLogger(__name__)

REASONS: Mapping[str, str] = MappingProxyType(
    {
        **codec.REASONS,
        "future_clock": "the sender's clock, or a live sensor's time, lies in the future",
        "stale_clock": "the sender's clock lies too far in the past",
        "unset_clock": "the sensor's time lies before any that is believed",
        "clock_not_increasing": "the sensor's time does not increase within a boot",
        "duplicate": "the features are known already",
        "measured_before": "another boot of the asset has sent the same window of time",
        "too_late": "the features were given up as lost, and the order has moved on",
        "closed_boot": "a later boot of the same asset has begun",
        "two_agents": "another agent has sent other features under the same boot and sequence",
        "sequence_jump": "the sequence is impossibly far ahead",
        "stated_sequence": "an agent states a newest sequence that is impossibly far ahead",
        "too_many_boots": "the asset has as many boots as are allowed",
        "too_many_assets": "the site has as many assets as are taken without registration",
        "held_full": "too much is out of order; it is asked for again",
        "inbox_full": "the server is behind; it is asked for again",
        "not_registered": "no twin is registered for the asset",
        "quarantine_full": "too many messages of the asset are set aside; its edge keeps them",
        "failed": "the server failed on it: a fault of ours",
        "unexpected": "a message of a kind that the twin does not take",
    }
)
"""Why the twin refuses a message: a word to count by, and what it means."""


class Refusals:
    """Counts of refused messages, and a log of them with a bounded rate.

    Parameters
    ----------
    quiet_s
        After a line in the log, silence about the same reason for so long.
    """

    def __init__(self, quiet_s: float = 10.0) -> None:
        self._quiet_s = quiet_s
        self._counts: Counter[str] = Counter()
        self._told: dict[str, tuple[float, int]] = {}
        self._lock = threading.Lock()

    def refuse(self, reason: str, sentence: str) -> None:
        """Count one refusal, and log it unless its reason has just been logged."""
        if reason not in REASONS:
            raise KeyError(f"{reason!r} is not a valid reason. Allowed: {', '.join(REASONS)}.")
        now = time.monotonic()
        with self._lock:
            self._counts[reason] += 1
            count = self._counts[reason]
            before, told = self._told.get(reason, (-self._quiet_s, 0))
            if now - before < self._quiet_s:
                return
            self._told[reason] = now, count
        since = f" ({count - told - 1} more like it meanwhile)" if count > told + 1 else ""
        logger.warning("Refused, %s: %s%s", reason, sentence, since)

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of refusals for each reason, zeros included."""
        with self._lock:
            return {reason: self._counts[reason] for reason in REASONS}
