"""Fatigue and virtual quantities that edges assess: kept, or remembered for a while."""

import collections
from collections.abc import Container, Sequence

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Fatigue, Virtual
from twin_server.persist import HOUR_NS, FatigueRow, Store

VIRTUAL_KEPT = 12
"""Windows of virtual quantities that are remembered of a twin; recordings hold all."""


class AssessedMessages:
    """Keeps fatigue messages in the store, and the latest virtual quantities in memory."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._virtual: dict[tuple[str, str], collections.deque[Virtual]] = {}

    def take(
        self, messages: Sequence[Fatigue | Virtual], twins: Container[tuple[str, str]]
    ) -> int:
        """Take messages of registered twins; give how many fatigue messages were kept."""
        rows = []
        for message in messages:
            key = message.site, message.asset
            if key not in twins:
                continue  # sums come again, once there is a twin
            if isinstance(message, Virtual):
                windows = self._virtual.setdefault(key, collections.deque(maxlen=VIRTUAL_KEPT))
                windows.append(message)
                continue
            rows.append(
                FatigueRow(
                    message.twin_id, message.boot, message.t_ns // HOUR_NS, message.sequence,
                    message.t_ns, encode(message),
                )
            )  # fmt: skip
        if rows:
            self._store.add_fatigue(rows)
        return len(rows)

    def virtual(self, key: tuple[str, str]) -> list[Virtual]:
        """Latest windows of virtual quantities of a twin, since this server began."""
        return list(self._virtual.get(key, ()))

    def forget(self, key: tuple[str, str]) -> None:
        """Forget the virtual quantities of a twin."""
        self._virtual.pop(key, None)
