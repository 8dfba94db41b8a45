"""Decides whether the health of an agent has changed in a way that a person wants to know."""

from collections.abc import Mapping
from typing import NamedTuple

from slowtime_schemas.messages import FOREIGN_ACKS

STATES = ("sensor_silent_s",)
"""Counters of which only matters whether they are zero."""

TROUBLES = (
    FOREIGN_ACKS, "garbage_bytes", "not_sent", "not_spooled", "outliers", "rate_changes",
    "samples_dropped", "samples_lost", "samples_refused", "sensor_reconnects",
    "sensor_restarts", "source_restarts", "spool_damaged", "unidentified",
)  # fmt: skip
"""Counters of faults; news with the 1st, 2nd, 4th, 8th … fault: a flood costs little."""

TROUBLE_PREFIXES = ("failed_", "refused_")
"""Beginnings of the names of further such counters."""

SPOOL_STEP_BYTES = 2**20
"""Size of the spool that is news, and each doubling of it [bytes]."""

CLOCK_STEP_S = 1.0
"""Step of the computer's clock that is news [s], as large as the server tells agents apart."""


class HealthCondition(NamedTuple):
    """What matters of an agent's health; two that are equal need one message only."""

    states: tuple[str, ...]
    troubles: tuple[tuple[str, int], ...]
    spool: int
    connected: bool

    @classmethod
    def of(
        cls, counters: Mapping[str, int], spool_bytes: int, dropped: int, *, connected: bool
    ) -> "HealthCondition":
        """Reduce counters to what matters.

        Examples
        --------
        >>> one = HealthCondition.of({"samples_lost": 4, "blocks": 7}, 0, 0, connected=True)
        >>> one == HealthCondition.of({"samples_lost": 5, "blocks": 99}, 0, 0, connected=True)
        True
        """
        troubles = [
            (name, count.bit_length())
            for name, count in [*counters.items(), ("dropped", dropped)]
            if name in TROUBLES or name == "dropped" or name.startswith(TROUBLE_PREFIXES)
        ]
        return cls(
            states=tuple(name for name in STATES if counters.get(name)),
            troubles=tuple(sorted(trouble for trouble in troubles if trouble[1])),
            spool=(spool_bytes // SPOOL_STEP_BYTES).bit_length(),
            connected=connected,
        )
