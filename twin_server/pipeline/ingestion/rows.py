"""Converts accounts, states and notices of the stages to rows of the store, and back."""

import json
from typing import Any

from slowtime_schemas.asset_events import AssetEvent
from slowtime_schemas.codec import Refused, decode, encode
from slowtime_schemas.messages import Event, Features
from slowtime_schemas.streams import FEATURES
from twin_server.collect import (
    DAMAGED,
    DoubtedSequence,
    LostRange,
    OldReading,
    ReachedLimit,
    RivalAgents,
    Run,
    StoreChange,
)
from twin_server.estimate import Notice, Twin
from twin_server.events.asset_events import TOLD, AssetEventRow, sentence
from twin_server.history.details import Detail
from twin_server.history.rendering import event_body
from twin_server.history.states import STATE, States
from twin_server.persist import EventRow, RunRow, TwinRow


def address(twin_id: str) -> tuple[str, str]:
    """Split a twin's id into site and asset."""
    site, _, asset = twin_id.partition(".")
    return site, asset


def decoded(payload: bytes) -> Features:
    """Read features that were kept; they were checked when they came."""
    message = decode(FEATURES, payload)
    if not isinstance(message, Features):
        raise Refused("unexpected", f"{message.MESSAGE} was given where features are kept.")
    return message


def cut_up(states: States) -> list[bytes]:
    """Encode each state as it is stored."""
    raw, size = states.tobytes(), STATE.itemsize
    return [raw[i : i + size] for i in range(0, len(raw), size)]


def body_of(detail: Detail | None) -> bytes | None:
    """Return the part of a detail that is published."""
    return None if detail is None else detail.body


def rows_of_held(change: StoreChange) -> list[tuple[int, int, bytes]]:
    """Make rows of held features that the same change does not release."""
    released = set(rows_of_released(change))
    return [
        (run.number, sequence, payload)
        for run, sequence, payload in change.held
        if (run.number, sequence) not in released
    ]


def rows_of_released(change: StoreChange) -> list[tuple[int, int]]:
    """Name the rows of features that are no longer held."""
    return [(run.number, sequence) for run, sequence in change.released]


def twin_row(key: tuple[str, str], twin: Twin) -> TwinRow:
    """Make the row of a twin."""
    return TwinRow(*key, twin.registration.to_json(), twin.checkpoint.to_json())


def run_row(run: Run, unit: str) -> RunRow:
    """Make the row of a boot's account."""
    return RunRow(
        run.number, run.site, run.asset, run.boot, unit, run.next, run.last, run.last_t_ns,
        run.told, run.closed, json.dumps(run.lost) if run.lost else "[]",
    )  # fmt: skip


def run_of(row: RunRow) -> Run:
    """Make the account of a boot out of its row."""
    return Run(
        row.site,
        row.asset,
        row.boot,
        number=row.number,
        next=row.next,
        last=row.last,
        last_t_ns=row.last_t_ns,
        told=row.told,
        closed=row.closed,
        lost=[(first, last) for first, last in json.loads(row.lost)],
    )


def event_row(event: Event, *, derived: bool) -> EventRow:
    """Make the row of an event."""
    return EventRow(
        0, event.site, event.asset, event.t_ns, event.slow_time, derived, event_body(event)
    )


def derived_event(features: Features, notice: Notice) -> EventRow:
    """Make an event of a notice about the state of `features`."""
    where: dict[str, Any] = {
        name: getattr(features, name)
        for name in ("site", "asset", "boot", "sequence", "t_ns", "slow_time")
    }
    return event_row(
        Event(
            **where,
            kind=notice.kind,
            severity=notice.severity,
            message=notice.message,
            details=notice.details,
        ),
        derived=True,
    )


def lost_event(lost: LostRange) -> EventRow:
    """Make an event of a range that was passed over."""
    run, count = lost.run, lost.last - lost.first + 1
    return event_row(
        Event(
            site=run.site,
            asset=run.asset,
            boot=run.boot,
            sequence=lost.last,
            t_ns=max(run.last_t_ns, 0),
            kind="features_lost",
            severity="warning" if run.last >= 0 or lost.why == DAMAGED else "info",
            message=(
                f"{count} features of boot {run.boot} are missing, {lost.first} to "
                f"{lost.last}: {lost.why}."
            ),
            details={
                "boot": run.boot, "first": lost.first, "last": lost.last, "why": lost.why,
            },
        ),
        derived=False,
    )  # fmt: skip


def old_event(aged: OldReading) -> EventRow:
    """Make an event of readings that were old when they came."""
    run, days = aged.run, aged.age_s / 86_400
    return event_row(
        Event(
            site=run.site,
            asset=run.asset,
            boot=run.boot,
            sequence=aged.sequence,
            t_ns=max(run.last_t_ns, 0),
            kind="old_readings",
            severity="warning",
            message=(
                f"Readings of boot {run.boot} were {days:.1f} days old when they came, from "
                f"sequence {aged.sequence} on. They are taken in by their sensor time. If the "
                "edge agent was not offline so long, its sensor's clock is behind: set it."
            ),
            details={"boot": run.boot, "first": aged.sequence, "age_days": round(days, 3)},
        ),
        derived=False,
    )


def rivals_event(rivals: RivalAgents) -> EventRow:
    """Make an event of two agents that send as the same asset."""
    run, same = rivals.run, rivals.other == rivals.run.boot
    twin_id = f"{run.site}.{run.asset}"
    message = (
        f"Two edge agents send as {twin_id} under one boot, {run.boot}: {rivals.how}. What "
        "comes first is taken in, and nothing of this boot is acknowledged any more, so that "
        "both keep their readings in their spools. Give each agent its own asset name, and "
        "leave `boot` unset."
        if same
        else f"Two edge agents send as {twin_id}: boot {run.boot} goes on although boot "
        f"{rivals.other} has begun. Readings of boot {run.boot} from {rivals.first} on are not "
        "taken in; they stay in its agent's spool. Stop one agent, or give each its own asset "
        "name."
    )
    return event_row(
        Event(
            site=run.site,
            asset=run.asset,
            boot=run.boot,
            sequence=max(run.last, 0),
            t_ns=max(run.last_t_ns, 0),
            kind="two_agents",
            severity="warning",
            message=message,
            details={
                "boots": [run.boot, rivals.other], "first": rivals.first, "how": rivals.how,
            },
        ),
        derived=False,
    )  # fmt: skip


def doubted_event(doubted: DoubtedSequence) -> EventRow:
    """Make an event of a stated sequence that is not believed."""
    run = doubted.run
    kind = "account_corrected" if doubted.corrected else "implausible_sequence"
    cause = "The kept account" if doubted.corrected else "The edge agent"
    return event_row(
        Event(
            site=run.site,
            asset=run.asset,
            boot=run.boot,
            sequence=max(run.last, 0),
            t_ns=max(run.last_t_ns, 0),
            kind=kind,
            severity="warning",
            message=(
                f"{cause} states sequence {doubted.stated} of boot {run.boot}, and "
                f"{doubted.expected} is expected. Allowed: up to {run.reach:,} ahead "
                "(admission.max_jump), or what the agent lists and delivers. Nothing is waited "
                "for or counted as lost by it, and further readings of the boot are taken in. "
                "Check the agent's software and who holds its certificate."
            ),
            details={
                "boot": run.boot, "stated": doubted.stated, "expected": doubted.expected,
            },
        ),
        derived=False,
    )  # fmt: skip


def limit_event(reached: ReachedLimit, now_ns: int) -> EventRow:
    """Make an event of a limit that an asset has reached."""
    return event_row(
        Event(
            site=reached.site,
            asset=reached.asset,
            boot=reached.boot,
            sequence=0,
            t_ns=now_ns,
            kind="too_many_boots",
            severity="warning",
            message=(
                f"Boot {reached.boot} of {reached.site}.{reached.asset} is not taken in. "
                f"Allowed: {reached.allowed:,} boots of one asset ({reached.setting}). Its "
                "readings stay in the agent's spool. Find out why the agent starts so often, "
                "or raise the setting."
            ),
            details={"boot": reached.boot, "allowed": reached.allowed},
        ),
        derived=False,
    )


def asset_event_row(event: AssetEvent) -> AssetEventRow:
    """Make the row of a reported event of an asset."""
    return AssetEventRow(
        event.twin_id, event.event, event.sequence, event.t_ns, event.principal,
        encode(event).decode(),
    )  # fmt: skip


def told_event(told: AssetEvent) -> EventRow:
    """Make the event that announces a reported event of an asset."""
    content = told.model_dump(mode="json", exclude_defaults=True)
    header = ("version", "site", "asset", "boot", "sequence", "t_ns")
    details = {name: value for name, value in content.items() if name not in header}
    details |= {"event": told.event, "kind": told.kind, "by": told.person}
    return event_row(
        Event(
            site=told.site,
            asset=told.asset,
            boot=told.boot,
            sequence=0,
            t_ns=told.t_ns,
            kind=TOLD,
            severity="info",
            message=sentence(told),
            details=details | {"token": told.principal},
        ),
        derived=False,
    )
