"""Buckets of consecutive states: mean, extremes and their places for each quantity.

A bucket of buckets is made like a bucket of states, so that a pyramid of them tells what a
million states show at the cost of a few hundred. The arrays are kept byte by byte (see
`LAYOUT` of `twin_server.persist.layout`).
"""

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np
from jaxtyping import Float, Int, Shaped
from pydantic_core import from_json

from slowtime.evolution import extremes

from .details import Bodies
from .states import ESTIMATES, States, shown

HEAD = np.dtype(
    [
        ("first", "<i8"),
        ("last", "<i8"),
        ("count", "<i8"),
        ("valid", "<i8"),
        ("t_ns", "<i8", (2,)),
        ("slow_time", "<f8", (2,)),
    ]
)
"""Of one bucket: keys of its first and last state, how many, and their times."""

QUANTITY = np.dtype(
    [
        ("count", "<i8"),
        ("sum", "<f8"),
        ("min", "<f8"),
        ("max", "<f8"),
        ("lo", "<f8"),
        ("hi", "<f8"),
        ("keys", "<i8", (4,)),
        ("truth", "<f8", (2,)),
    ]
)
"""Of one quantity in a bucket: NaN where there is no estimate.

`keys` are of the states with the least and the greatest value, the least `lo` and the greatest
`hi`; `truth` is the least and the greatest true value of a simulated structure.
"""

_LEAST = {"min": 0, "lo": 2}
_GREATEST = {"max": 1, "hi": 3}
_NO_KEY = -1
"""Key of an extreme where there is none."""

_PER_BUCKET = 4
"""States that show the extremes of one quantity in one bucket."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Buckets:
    """Some buckets in order.

    Parameters
    ----------
    head
        An array of `HEAD`.
    quantities
        Of each bucket, an array of `QUANTITY`: `ESTIMATES`, then the free parameters of a twin
        of elements.
    """

    head: Shaped[np.ndarray, " bucket"]
    quantities: Shaped[np.ndarray, "bucket quantity"]

    def __len__(self) -> int:
        return len(self.head)

    @classmethod
    def of_states(
        cls,
        keys: Sequence[int],
        states: States,
        changes: Float[np.ndarray, "time parameter 3"] | None = None,
        bodies: Bodies = (),
    ) -> Self:
        """Make one bucket for each state.

        Parameters
        ----------
        keys
            Of the states, ascending.
        changes, bodies
            Of a twin of elements: value, lo and hi of each parameter, and the details.
        """
        count = len(states)
        head = np.zeros(count, HEAD)
        head["first"] = head["last"] = np.asarray(keys, np.int64)
        head["count"], head["valid"] = 1, states["reasons"] == 0
        for name in ("t_ns", "slow_time"):
            head[name] = states[name][:, None]
        parameters = 0 if changes is None else changes.shape[1]
        found = np.zeros((count, len(ESTIMATES) + parameters), QUANTITY)
        found["truth"] = np.nan
        for place, name in enumerate(ESTIMATES):
            _fill(found[:, place], states[name][:, [0, 2, 3]], head["first"])
            found["truth"][:, place] = states["truth"][:, place, None]
        for place in range(parameters):
            assert changes is not None
            _fill(found[:, len(ESTIMATES) + place], changes[:, place], head["first"])
        if parameters:
            found["truth"][:, len(ESTIMATES) :] = _truths(bodies, parameters)[..., None]
        return cls(head, found)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Concatenate buckets; a quantity that some lack is not estimated there."""
        width = max((part.quantities.shape[1] for part in parts), default=len(ESTIMATES))
        if not parts:
            return cls(np.zeros(0, HEAD), np.zeros((0, width), QUANTITY))
        return cls(
            np.concatenate([part.head for part in parts]),
            np.concatenate([_widened(part.quantities, width) for part in parts]),
        )

    @classmethod
    def from_bytes(cls, rows: Sequence[bytes]) -> Self:
        """Read the output of `to_bytes`, one item per bucket."""
        parts: dict[int, list[int]] = {}
        for place, row in enumerate(rows):
            parts.setdefault(len(row), []).append(place)
        found = []
        for size, places in parts.items():
            raw = np.frombuffer(b"".join(rows[place] for place in places), np.uint8)
            table = raw.reshape(len(places), size)
            head = np.ascontiguousarray(table[:, : HEAD.itemsize]).view(HEAD)[:, 0]
            rest = np.ascontiguousarray(table[:, HEAD.itemsize :]).view(QUANTITY)
            found.append(cls(head, rest))
        whole = cls.joined(found)
        if len(parts) < 2:
            return whole
        order = np.argsort(np.concatenate([np.array(p) for p in parts.values()]))
        return cls(whole.head[order], whole.quantities[order])

    def to_bytes(self) -> list[bytes]:
        """Encode each bucket as it is stored."""
        heads, rest = self.head.tobytes(), np.ascontiguousarray(self.quantities).tobytes()
        long = self.quantities.shape[1] * QUANTITY.itemsize
        return [
            heads[i * HEAD.itemsize : (i + 1) * HEAD.itemsize] + rest[i * long : (i + 1) * long]
            for i in range(len(self))
        ]

    def merged(self, starts: Int[np.ndarray, " group"]) -> "Buckets":
        """Join consecutive buckets; `starts` are the first of each group, ascending from 0.

        Parameters
        ----------
        starts
            Index of the first bucket of each group, ascending from 0.
        """
        if not len(starts):
            return Buckets(self.head[:0], self.quantities[:0])
        ends = np.append(starts[1:], len(self)) - 1
        head = self.head[starts]
        head["last"] = self.head["last"][ends]
        for name in ("count", "valid"):
            head[name] = np.add.reduceat(self.head[name], starts)
        for name in ("t_ns", "slow_time"):
            head[name][:, 1] = self.head[name][ends, 1]
        found = np.zeros((len(starts), self.quantities.shape[1]), QUANTITY)
        ours = self.quantities
        for name in ("count", "sum"):
            found[name] = np.add.reduceat(ours[name], starts, axis=0)
        group = np.repeat(np.arange(len(starts)), ends - starts + 1)
        for names, best in ((_LEAST, np.fmin), (_GREATEST, np.fmax)):
            for name, place in names.items():
                found[name] = best.reduceat(ours[name], starts, axis=0)
                at = ours[name] == found[name][group]
                keys = np.where(at, ours["keys"][..., place], np.iinfo(np.int64).max)
                first = np.minimum.reduceat(keys, starts, axis=0)
                found["keys"][..., place] = np.where(
                    first == np.iinfo(np.int64).max, _NO_KEY, first
                )
        for place, best in ((0, np.fmin), (1, np.fmax)):
            found["truth"][..., place] = best.reduceat(
                ours["truth"][..., place], starts, axis=0
            )
        return Buckets(head, found)

    def coarser(self, most: int) -> "Buckets":
        """Join neighbours evenly until there are at most `most`."""
        count = len(self)
        if count <= most:
            return self
        return self.merged(np.unique(np.arange(most) * count // most))

    def picked(self, max_points: int) -> Int[np.ndarray, " kept"]:
        """Keys of at most `max_points` states that show the extremes; ascending.

        Parameters
        ----------
        max_points
            At least 2: first and last are always among them.
        """
        quantities = self._varying()[: max(1, max_points // (_PER_BUCKET + 2))]
        each = (max_points // len(quantities) - 2) // _PER_BUCKET
        kept = [self.head["first"][:1], self.head["last"][-1:]]
        if each > 0:
            keys = self.coarser(each).quantities["keys"][:, quantities]
            kept.append(keys[keys != _NO_KEY])
        return np.unique(np.concatenate(kept))

    def _varying(self) -> list[int]:
        """Places of the quantities that a plot shows: parameters first, as in `thin`."""
        count = self.quantities.shape[1]
        order = [*range(len(ESTIMATES), count), *range(len(ESTIMATES))]
        total = self.head["count"].sum()
        low = np.fmin.reduce(self.quantities["min"], axis=0)
        high = np.fmax.reduce(self.quantities["max"], axis=0)
        known = self.quantities["count"].sum(axis=0)
        found = [
            place
            for place in order
            if known[place]
            and (low[place] < high[place] or (known[place] < total and low[place] != 0.0))
        ]
        return found or [0]


def thin(
    states: States,
    max_points: int,
    changes: Float[np.ndarray, "time parameter 3"] | None = None,
) -> Int[np.ndarray, " kept"]:
    """Pick at most `max_points` states, among them the extremes of all that varies.

    Parameters
    ----------
    changes
        Value, lo and hi of the parameters of a twin of elements, which then come first.
    """
    if len(states) <= max_points:
        return np.arange(len(states))
    varies = [states[name][:, [0, 2, 3]] for name in shown(states) or ["frequency_hz"]]
    if changes is not None:
        varies = [changes[:, i] for i in range(changes.shape[1])] + varies
    varies = varies[: max(1, max_points // 6)]
    kept = [
        extremes(
            np.ascontiguousarray(one[:, 0]),
            max_points // len(varies),
            lo=np.ascontiguousarray(one[:, 1]),
            hi=np.ascontiguousarray(one[:, 2]),
        )
        for one in varies
    ]
    return np.unique(np.concatenate(kept))


def _fill(
    into: Shaped[np.ndarray, " bucket"],
    table: Float[np.ndarray, "bucket 3"],
    keys: Int[np.ndarray, " bucket"],
) -> None:
    """Fill buckets of one state each with value, lo and hi of one quantity."""
    value = table[:, 0]
    there = ~np.isnan(value)
    into["count"], into["sum"] = there, np.where(there, value, 0.0)
    into["min"] = into["max"] = value
    into["lo"], into["hi"] = table[:, 1], table[:, 2]
    into["keys"] = np.where(there, keys, _NO_KEY)[:, None]


def _widened(
    quantities: Shaped[np.ndarray, "bucket quantity"], width: int
) -> Shaped[np.ndarray, "bucket quantity"]:
    lacking = width - quantities.shape[1]
    if not lacking:
        return quantities
    more = np.zeros((len(quantities), lacking), QUANTITY)
    for name in ("min", "max", "lo", "hi", "truth"):
        more[name] = np.nan
    more["keys"] = _NO_KEY
    return np.concatenate([quantities, more], axis=1)


def _truths(bodies: Bodies, parameters: int) -> Float[np.ndarray, "time parameter"]:
    """Truth of each parameter of a simulated structure, in the order of the details."""
    found = np.full((len(bodies), parameters), np.nan)
    names: dict[str, int] = {}
    for row, body in enumerate(bodies):
        # It stands last; the shapes before it need not be read.
        at = -1 if body is None else body.rfind(b'"truth":')
        if body is None or at < 0 or body.endswith(b'"truth":null}'):
            continue
        if not names:
            names = {name: i for i, name in enumerate(from_json(body).get("elements") or {})}
        truth = from_json(b"{" + body[at:])["truth"]
        for name, value in truth.items():
            if names.get(name, parameters) < parameters:
                found[row, names[name]] = value
    return found
