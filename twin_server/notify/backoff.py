"""The delay before the next attempt: doubled each time, with random jitter.

Chance keeps many messages that failed together from being tried together; it is drawn from
the seed, the message and the number of the attempt, so that the same run has the same pauses.
"""

import random

from twin_server.events.receivers import AlarmSettings

LONGEST_WAIT_S = 3_600.0
"""Longest wait that a receiver may ask for [s]."""


def retry_delay_s(settings: AlarmSettings, delivery_id: str, tries: int) -> float:
    """Return the delay after so many failed attempts [s].

    Examples
    --------
    >>> settings = AlarmSettings(backoff_s=2.0, max_backoff_s=60.0)
    >>> [2 ** n <= 2 * retry_delay_s(settings, "5f@ops", n) <= 2 ** (n + 1) for n in (1, 2, 3)]
    [True, True, True]
    >>> 30.0 <= retry_delay_s(settings, "5f@ops", 1_000) <= 60.0
    True
    """
    longest = settings.backoff_s * 2.0 ** min(tries - 1, 60)
    chance = random.Random(f"{settings.seed} {delivery_id} {tries}").uniform(0.5, 1.0)
    return min(longest, settings.max_backoff_s) * chance
