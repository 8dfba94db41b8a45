"""Orders the features of one run: accepted, held, refused or passed over as lost."""

from collections.abc import Sequence

from twin_server.settings import BackfillSettings

from .runs import (
    SEQUENCES,
    Arrival,
    AssetRuns,
    Change,
    EdgeQuery,
    Holding,
    LostRange,
    OldReading,
    Ordered,
    Run,
)

BACKWARDS = "its sensor time runs back"
DAMAGED = "the edge's spool is damaged there"


def accept(run: Run, arrival: Arrival, change: Change) -> None:
    """Accept the next features of a run; drop them if sensor time does not increase."""
    features = arrival.features
    run.next = features.sequence + 1
    change.touched[run] = None
    if features.t_ns <= run.last_t_ns:
        lose_one(run, features.sequence, change)
        change.refused.append(
            (
                "clock_not_increasing",
                f"{run}: t_ns={features.t_ns} of sequence {features.sequence} was given, "
                f"not later than {run.last_t_ns} before it. Allowed: sensor time that "
                "increases within a boot. Keep the sensor's clock from being set back, or "
                "restart the agent after setting it.",
            )
        )
        return
    run.follow_earlier()
    missing = features.sequence - run.last - 1
    change.ordered.append(
        Ordered(
            run, features, arrival.payload, missing, arrival.replayed, previous_ns=run.last_t_ns
        )
    )
    run.last, run.last_t_ns = features.sequence, features.t_ns
    run.take(features.sequence, arrival.payload)
    if arrival.age_s and not run.aged:
        run.aged = True
        change.aged.append(OldReading(run, features.sequence, arrival.age_s))


def release_held(run: Run, change: Change) -> None:
    """Release held features as far as none before them is missing."""
    while run.flows and run.next in run.held:
        sequence = run.next
        change.released.append((run, sequence))
        accept(run, run.held.pop(sequence), change)


def refusal_of(
    run: Run, sequence: int, settings: BackfillSettings, max_jump: int
) -> tuple[str, str] | None:
    """Decide whether features that are not the next of a run are refused.

    Parameters
    ----------
    sequence
        Number of the features within their boot.
    settings
        How many features are held out of order.
    max_jump
        How far `sequence` may be ahead of the one expected.

    Returns
    -------
    The reason, a key of `refusals.REASONS`, and a sentence; None where the features are held.
    """
    what = f"{run}: sequence {sequence} was given, "
    if run.number and sequence < run.next:
        if any(first <= sequence <= last for first, last in run.lost):
            return "too_late", (
                f"{what}which was already counted as lost. Allowed: messages that arrive "
                "while they are requested. Raise the patience in the healing settings if "
                "edges need longer."
            )
        return "duplicate", (f"{what}which is known. Allowed: each once. Nothing needs doing.")
    if sequence in run.held:
        return "duplicate", (f"{what}which is held. Allowed: each once. Nothing needs doing.")
    if run.closed:
        return "closed_boot", (
            f"{what}but a later boot of {run.site}.{run.asset} has begun. Allowed: one "
            "agent at a time per asset. Give each its own asset name."
        )
    if sequence >= SEQUENCES or (run.number and sequence > max(run.next, run.told) + max_jump):
        return "sequence_jump", (
            f"{what}but {run.next} was expected. Allowed: up to {max_jump:,} ahead. "
            "Number the features of a boot from 0 without jumps."
        )
    if len(run.held) >= settings.max_held:
        return "held_full", (
            f"{what}but {len(run.held):,} are held already because {run.next} is missing. "
            "Allowed: up to max_held. The message is requested again once there is room."
        )
    return None


def conclude_hole(
    line: AssetRuns,
    run: Run,
    want: EdgeQuery,
    listing: Sequence[Holding],
    certain: bool,
    now_s: float,
    settings: BackfillSettings,
    change: Change,
) -> None:
    """Conclude from an edge's account whether the first hole of a run is asked for again.

    Parameters
    ----------
    want
        The query that was answered.
    listing
        What the edge says it holds.
    certain
        Whether the edge answered without error, so that what it does not list is gone.
    now_s
        Monotonic time [s].
    """
    holding = next((entry for entry in listing if entry.boot == run.boot), None)
    if certain and holding is not None:
        lose_damaged(run, holding, change)
    hole = run.missing()
    if hole is None:
        run.calm()
        return
    if hole[0] > want.first:
        run.progress(now_s)
        return
    obtainable = holding is not None and holding.last >= hole[0]
    if certain and listing and not obtainable:
        pass_over(run, hole, "the edge no longer holds it", change)
    elif certain and holding is not None and holding.first > hole[0]:
        until = min(hole[1], holding.first - 1)
        pass_over(run, (hole[0], until), "the edge no longer holds it", change)
    elif run.impatient(certain, line, now_s, settings):
        why = "the edge did not give it" if certain else "nobody could be asked for it"
        pass_over(run, *_reasoned(run, hole, why), change)
    else:
        run.put_off(now_s, settings)
        return
    if run.missing() is None:
        run.calm()
    else:
        run.progress(now_s)


def lose_damaged(run: Run, holding: Holding, change: Change) -> None:
    """Skip features damaged in the spool, as far as all before them have arrived."""
    while (hole := run.missing()) is not None:
        damaged = _damaged_part(hole, holding)
        if damaged is None:
            return
        lose(run, *damaged, DAMAGED, change)
        release_held(run, change)


def pass_over(run: Run, hole: tuple[int, int], why: str, change: Change) -> None:
    """Go on behind a hole; a tail that nothing follows is forgotten instead."""
    if run.held or run.followed:
        lose(run, *hole, why, change)
        release_held(run, change)
    else:
        run.forgotten = max(run.forgotten, hole[1])


def lose(run: Run, first: int, last: int, why: str, change: Change) -> None:
    """Pass over sequences `first` to `last`, both included, and report them as lost."""
    run.lost.append((first, last))
    run.next = last + 1
    run.interrupt(run.next)
    change.lost.append(LostRange(run, first, last, why))
    change.touched[run] = None


def lose_one(run: Run, sequence: int, change: Change) -> None:
    """Report one that has come and cannot be kept; neighbours in one range."""
    run.interrupt(sequence + 1)
    if run.lost and run.lost[-1][1] == sequence - 1:
        run.lost[-1] = (run.lost[-1][0], sequence)
    else:
        run.lost.append((sequence, sequence))
    before = change.lost[-1] if change.lost else None
    if before is not None and before.run is run and before.last == sequence - 1:
        change.lost[-1] = before._replace(last=sequence)
    else:
        change.lost.append(LostRange(run, sequence, sequence, BACKWARDS))


def _damaged_part(hole: tuple[int, int], holding: Holding) -> tuple[int, int] | None:
    """Return the part of a hole, from its start on, that the edge reports as damaged."""
    first, until = hole[0], hole[0]
    for begin, end in sorted(holding.damaged):
        if begin <= until <= end:
            until = end + 1
    return (first, min(until - 1, hole[1])) if until > first else None


def _reasoned(run: Run, hole: tuple[int, int], why: str) -> tuple[tuple[int, int], str]:
    """Return the first part of a hole that has one reason, and that reason."""
    reason = run.disbelieved.get(hole[0])
    until = hole[0]
    while until < hole[1] and run.disbelieved.get(until + 1) == reason:
        until += 1
    part = (hole[0], until if run.disbelieved else hole[1])
    return part, why if reason is None else f"its sensor time is not believed ({reason})"
