"""Estimates features in order, and prepares the states, checkpoints and events to write."""

from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from slowtime_schemas.messages import Event
from twin_server.collect import Ordered
from twin_server.estimate import Checkpoint, Estimates, Twin
from twin_server.history.states import blank, covered_share, from_bytes
from twin_server.persist import (
    DetailRow,
    EventRow,
    FeatureRow,
    StateRow,
    Store,
    TwinRow,
    WriteBatch,
)
from twin_server.pipeline.progress import ASIDE_BEFORE, EstimateBatch, Isolated
from twin_server.registration.changes import change_sentence
from twin_server.registration.twin import Registration

from .rows import cut_up, decoded, derived_event, event_row, twin_row

Twins = MutableMapping[tuple[str, str], Twin]
"""By site and asset."""

NO_BOOT = "twin"
"""Stands for an edge's boot in what the twin says of its own accord."""

REESTIMATE_BATCH = 5_000
"""Features that are read at once where a history is made anew."""

Estimating = Callable[[EstimateBatch, Sequence[bytes]], Isolated]
"""Estimates features, of which the messages are given as well."""


class NotEstimatedError(ValueError):
    """Features of a history cannot be estimated; the text says which, and why."""


class BatchEstimate(NamedTuple):
    """Estimates of a batch of features.

    Parameters
    ----------
    owners, keys
        Of each features message the place of its twin in `keys`.
    failed
        Features that have no estimate, and why.
    """

    found: Estimates
    owners: Sequence[int]
    keys: Sequence[tuple[str, str]]
    failed: Mapping[int, str] = MappingProxyType({})


EMPTY_ESTIMATE = BatchEstimate(Estimates(blank(0), [], []), (), ())
"""What no features tell."""


def new_twin(registration: Registration) -> Twin:
    """Make a twin that has not seen anything yet."""
    return Twin(registration, Checkpoint.start(registration))


def estimate_next(
    ordered: Sequence[Ordered],
    twins: Twins,
    cut: WriteBatch,
    default: Registration,
    now_ns: int,
    estimating: Estimating,
) -> BatchEstimate:
    """Add states, checkpoints and events of `ordered` to `cut`, checkpoints to `twins`."""
    keys: dict[tuple[str, str], int] = {}
    owners = [keys.setdefault((o.run.site, o.run.asset), len(keys)) for o in ordered]
    for key in keys:
        if key not in twins:
            twins[key] = new_twin(default)
            cut.events.append(
                registration_event(*key, default, "by its first features", now_ns)
            )
            cut.twins.append(twin_row(key, twins[key]))
    before = [twins[key] for key in keys]
    batch = EstimateBatch(
        before,
        [o.features for o in ordered],
        owners,
        [o.missing_before for o in ordered],
        [o.covered for o in ordered],
    )
    found, failed = estimating(batch, [o.payload for o in ordered])
    for key, twin, checkpoint, notices in zip(
        keys, before, found.checkpoints, found.notices, strict=True
    ):
        if checkpoint is not twin.checkpoint and checkpoint != twin.checkpoint:
            twins[key] = twin._replace(checkpoint=checkpoint)
            cut.twins.append(twin_row(key, twins[key]))
        cut.events += [derived_event(ordered[n.row].features, n) for n in notices]
    cut.features += [
        FeatureRow(
            o.run.number, o.features.sequence, o.features.t_ns, o.features.slow_time,
            o.payload, state,
        )
        for o, state in zip(ordered, cut_up(found.states), strict=True)
    ]  # fmt: skip
    cut.details += [
        DetailRow(o.run.number, o.features.sequence, *detail)
        for o, detail in zip(ordered, found.details, strict=False)
        if detail is not None
    ]
    return BatchEstimate(found, owners, list(keys), failed)


def reestimate(
    store: Store,
    key: tuple[str, str],
    registration: Registration,
    event: EventRow,
    estimating: Estimating,
    finish: Callable[[], None] = lambda: None,
) -> Twin:
    """Make all states of a twin from its features again; in memory, a part at a time.

    Parameters
    ----------
    finish
        Called within the transaction, at its end.

    Raises
    ------
    NotEstimatedError
        If features fail that had an estimate until now; nothing is changed.
    """
    twin = new_twin(registration)
    events = [event]

    def states() -> Iterator[StateRow]:
        nonlocal twin
        last = (0, -1)
        while rows := store.messages(".".join(key), last, REESTIMATE_BATCH):
            features = [decoded(row.message) for row in rows]
            last = (rows[-1].number, rows[-1].sequence)
            # What was missing, and what had been measured before, was found when they came.
            kept = from_bytes(row.state for row in rows)
            batch = EstimateBatch(
                [twin],
                features,
                [0] * len(rows),
                kept["missing_before"].tolist(),
                covered_share(kept).tolist(),
            )
            found, failed = estimating(batch, [row.message for row in rows])
            for place, why in failed.items():
                if why != ASIDE_BEFORE:
                    one = features[place]
                    raise NotEstimatedError(
                        f"Features {one.sequence} of boot {one.boot} of "
                        f"{'.'.join(key)} cannot be estimated like this: {why}. Nothing was "
                        "changed. Look at the log, or change the registration."
                    )
            twin = twin._replace(checkpoint=found.checkpoints[0])
            events.extend(derived_event(features[n.row], n) for n in found.notices[0])
            details = found.details or [None] * len(rows)
            for row, state, detail in zip(rows, cut_up(found.states), details, strict=True):
                yield StateRow(row.number, row.sequence, state, detail)

    def rest() -> tuple[TwinRow, list[EventRow]]:
        finish()
        return twin_row(key, twin), events

    store.rewrite(".".join(key), states(), rest)
    return twin


def registration_event(
    site: str,
    asset: str,
    registration: Registration,
    how: str,
    now_ns: int,
    change: dict[str, Any] | None = None,
) -> EventRow:
    """Make the event that a twin was registered; with `change`, that somebody changed it."""
    message = f"Registered {how}. Quantities that may change: {registration.changes}."
    details = registration.to_dict()
    if change is not None:
        message, details["change"] = change_sentence(change), change
    return note_event(site, asset, "registered", "info", message, details, now_ns)


def interrupted_event(site: str, asset: str, seconds: float, now_ns: int) -> EventRow:
    """Make an event of a time in which the database took nothing."""
    return note_event(
        site,
        asset,
        "database_away",
        "warning",
        f"The server stored nothing for {seconds:.0f} s, because its database was not "
        "available. Nothing was acknowledged meanwhile; the edge agent keeps its readings and "
        "sends them again. The server's log gives the reason.",
        {"seconds": round(seconds, 1)},
        now_ns,
    )


def note_event(
    site: str,
    asset: str,
    kind: str,
    severity: Literal["info", "warning", "alarm"],
    message: str,
    details: Mapping[str, Any],
    now_ns: int,
) -> EventRow:
    """Make an event that does not follow from features."""
    return event_row(
        Event(
            site=site,
            asset=asset,
            boot=NO_BOOT,
            sequence=0,
            t_ns=now_ns,
            kind=kind,
            severity=severity,
            message=message,
            details=dict(details),
        ),
        derived=False,
    )
