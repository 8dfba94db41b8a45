"""Features that came before their turn, and how many bytes they take."""

import heapq
from collections.abc import ItemsView, Iterator, MutableMapping
from typing import NamedTuple

from slowtime_schemas.messages import Features


class Arrival(NamedTuple):
    """One features message, checked, with its bytes."""

    features: Features
    payload: bytes
    replayed: bool = False
    age_s: float = 0.0
    """On arrival, where that is more than usual; else 0."""


class HeldBytes:
    """Bytes of all features of one asset that are held."""

    def __init__(self) -> None:
        self.total = 0


class HeldFeatures(MutableMapping[int, Arrival]):
    """Features of one boot by their sequence; the least is found without looking at all."""

    def __init__(self) -> None:
        self._arrivals: dict[int, Arrival] = {}
        self._order: list[int] = []
        """A heap; a sequence that was taken out stays in it until it is the least."""
        self._bytes = HeldBytes()

    def __len__(self) -> int:
        return len(self._arrivals)

    def __iter__(self) -> Iterator[int]:
        return iter(self._arrivals)

    def __getitem__(self, sequence: int) -> Arrival:
        return self._arrivals[sequence]

    def __setitem__(self, sequence: int, arrival: Arrival) -> None:
        before = self._arrivals.get(sequence)
        if before is None:
            heapq.heappush(self._order, sequence)
        self._arrivals[sequence] = arrival
        self._bytes.total += len(arrival.payload) - (len(before.payload) if before else 0)

    def __delitem__(self, sequence: int) -> None:
        self._bytes.total -= len(self._arrivals.pop(sequence).payload)
        while self._order and self._order[0] not in self._arrivals:
            heapq.heappop(self._order)

    def __contains__(self, sequence: object) -> bool:
        return sequence in self._arrivals

    def items(self) -> ItemsView[int, Arrival]:
        """Sequences and features, as they came."""
        return self._arrivals.items()

    @property
    def first(self) -> int | None:
        """Least sequence; None where nothing is held."""
        return self._order[0] if self._order else None

    def count_in(self, total: HeldBytes) -> None:
        """Count the bytes among those of an asset."""
        own = sum(len(arrival.payload) for arrival in self._arrivals.values())
        self._bytes.total -= own
        total.total += own
        self._bytes = total
