"""Says which windows were measured before, once for each boot: as events and refusals."""

import collections
import json
from collections.abc import Iterator, Sequence
from typing import Literal

from slowtime_schemas.messages import Event, Features, Mode
from slowtime_schemas.quantities import Quantity
from twin_server.collect import Refusals, Run
from twin_server.persist import EventRow, Store

from .rows import event_row
from .window_coverage import SortedWindows

SAME_WITHIN_SD = 0.01
"""Difference of two values over their standard deviation [1] below which they are the same
measurement: a hundredth of it changes no estimate visibly, and sums differ less by the order of
addition on another machine."""

MOST_TOLD = 10_000
"""Boots of which it is remembered what was said; then the events of the twin are read again."""

_RECALLED = 1_000
"""Newest events of a twin among which one about a boot is looked for after a start."""

SAME, DIFFERENT, OVERLAPPING = "measured_before", "measured_differently", "windows_overlap"
"""Kinds of events."""


class WindowNotices:
    """Makes the events of windows that were measured before, each once for a boot."""

    def __init__(self, store: Store, refusals: Refusals) -> None:
        self._store, self._refusals = store, refusals
        self._told: collections.OrderedDict[tuple[int, str], None] = collections.OrderedDict()

    def of(self, windows: SortedWindows) -> list[EventRow]:
        """Count the repeated windows as refused, and return the events that are new."""
        return [event for event in self._events(windows) if event is not None]

    def _events(self, windows: SortedWindows) -> Iterator[EventRow | None]:
        for one in windows.repeated:
            features, first = one.again.features, one.first
            where = f"boot {features.boot} of {features.twin_id}, sequence {features.sequence}"
            self._refusals.refuse(
                SAME,
                f"{where}: a window from {features.start_ns} to {features.t_ns} was given, "
                f"which boot {first.boot} has sent. Allowed: each window of time once. It is "
                "acknowledged and left out; nothing needs doing.",
            )
            difference = _difference(first, features)
            if difference:
                yield self._event(one.again.run, features, DIFFERENT, "warning", (
                    f"Boot {features.boot} says of the same windows as boot {first.boot}, from "
                    f"sequence {features.sequence} on, something else: {difference}. The "
                    "readings of the first are used, and the others left out. Which are right? "
                    "If the others are, delete the twin and send the record again; if they are "
                    "of other sensors, give these an asset name of their own."
                ), first.boot)  # fmt: skip
            else:
                yield self._event(one.again.run, features, SAME, "info", (
                    f"Boot {features.boot} sends windows that boot {first.boot} has sent, from "
                    f"sequence {features.sequence} on. Each counts once; nothing needs doing."
                ), first.boot)  # fmt: skip
        for run, (features, boot) in windows.overlapped.items():
            yield self._event(run, features, OVERLAPPING, "info", (
                f"Windows of boot {features.boot} overlap those of boot {boot}, from sequence "
                f"{features.sequence} on. Each counts by the share of its time that is new."
            ), boot)  # fmt: skip

    def _event(
        self,
        run: Run,
        features: Features,
        kind: str,
        severity: Literal["info", "warning"],
        message: str,
        other: str,
    ) -> EventRow | None:
        key = run.number, kind
        if key in self._told or self._was_told(run, kind):
            return None
        self._told[key] = None
        while len(self._told) > MOST_TOLD:
            self._told.popitem(last=False)
        return event_row(
            Event(
                site=run.site,
                asset=run.asset,
                boot=run.boot,
                sequence=features.sequence,
                t_ns=features.t_ns,
                kind=kind,
                severity=severity,
                message=message,
                details={"boots": [run.boot, other], "first": features.sequence},
            ),
            derived=False,
        )

    def _was_told(self, run: Run, kind: str) -> bool:
        """Whether an event before the start of this server said so."""
        rows = self._store.events(f"{run.site}.{run.asset}", limit=_RECALLED, newest=True)
        bodies = (json.loads(row.body) for row in rows if kind in row.body)
        told = any(body["kind"] == kind and body["boot"] == run.boot for body in bodies)
        if told:
            self._told[run.number, kind] = None
        return told


def _difference(first: Features, again: Features) -> str:
    """Name the first value that differs between two messages of one window; empty if none."""
    one, other = (_structural(message) for message in (first, again))
    if len(one) != len(other):
        return f"{len(other)} modes instead of {len(one)}"
    for number, (known, given) in enumerate(zip(one, other, strict=True), start=1):
        for name, unit, before, now in (
            ("frequency", " Hz", known.frequency_hz, given.frequency_hz),
            ("damping ratio", "", known.damping_ratio, given.damping_ratio),
        ):
            if not _agree(before, now):
                return (
                    f"the {name} of mode {number} is {now.value:.6g}{unit} instead of "
                    f"{before.value:.6g}{unit}"
                )
    return ""


def _structural(message: Features) -> Sequence[Mode]:
    return [mode for mode in message.modes if mode.kind == "structural"]


def _agree(one: Quantity, other: Quantity) -> bool:
    within = SAME_WITHIN_SD * max(one.sd, other.sd)
    return abs(one.value - other.value) <= within and abs(one.sd - other.sd) <= within
