"""Orders the features of one run: accepted, held, refused or passed over as lost."""

from collections.abc import Sequence

from twin_server.settings import BackfillSettings

from .changes import LostRange, OldReading, Ordered, StoreChange
from .evidence import MOST_AHEAD, drop_far, jump_refusal, vouch, withdraw
from .held import Arrival, HeldBytes
from .intervals import Range, covers, joined
from .runs import EdgeQuery, Holding, Run

BACKWARDS = "its sensor time runs back"
DAMAGED = "the edge's spool is damaged there"
NOT_HELD = "the edge no longer holds it"


def accept(run: Run, arrival: Arrival, change: StoreChange) -> None:
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


def release_held(run: Run, change: StoreChange) -> None:
    """Release held features as far as none before them is missing."""
    while run.flows and run.next in run.held:
        sequence = run.next
        change.released.append((run, sequence))
        accept(run, run.held.pop(sequence), change)


def refusal_of(
    run: Run, arrival: Arrival, held_bytes: HeldBytes, settings: BackfillSettings
) -> tuple[str, str] | None:
    """Decide whether features that are not the next of a run are refused.

    Parameters
    ----------
    held_bytes
        Bytes of all features of the asset that are held.
    settings
        How much is held out of order.

    Returns
    -------
    The reason, a key of `refusals.REASONS`, and a sentence; None where the features are held.
    """
    sequence = arrival.features.sequence
    what = f"{run}: sequence {sequence} was given, "
    if run.number and sequence < run.next:
        if covers(run.lost, sequence):
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
    # What a boot begins with is judged once its agent has told its account.
    if sequence > (run.horizon if run.number else MOST_AHEAD):
        return "sequence_jump", jump_refusal(run, sequence)
    if len(run.held) >= settings.max_held:
        return "held_full", (
            f"{what}but {len(run.held):,} are held already because {run.next} is missing. "
            "Allowed: up to max_held. The message is requested again once there is room."
        )
    if held_bytes.total + len(arrival.payload) > settings.max_held_bytes:
        return "held_full", (
            f"{what}but features of {held_bytes.total:,} bytes are held already because "
            f"{run.next} is missing. Allowed: up to max_held_bytes. The message is requested "
            "again once there is room."
        )
    return None


def conclude_hole(
    run: Run,
    want: EdgeQuery,
    listing: Sequence[Holding],
    certain: bool,
    spooled: bool,
    now_s: float,
    settings: BackfillSettings,
    change: StoreChange,
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
    spooled
        Whether an edge agent that keeps an account was ever there.
    now_s
        Monotonic time [s].
    """
    holding = next((entry for entry in listing if entry.boot == run.boot), None)
    if certain and holding is not None:
        lose_damaged(run, holding, change)
        vouch(run, holding)
    hole = run.missing()
    if hole is None:
        run.calm()
        return
    if hole[0] > want.first:
        run.progress(now_s)
        return
    obtainable = holding is not None and holding.last >= hole[0]
    if certain and listing and not obtainable:
        pass_over(run, hole, NOT_HELD, change)
    elif certain and holding is not None and holding.first > hole[0] and not run.asked_ahead:
        until = min(hole[1], holding.first - 1)
        pass_over(run, (hole[0], until), NOT_HELD, change)
    elif run.flows and run.impatient(certain, spooled, now_s, settings):
        # Not while earlier boots hold it up: what came for it may have found no room.
        give_up(run, hole, certain, change)
    else:
        run.put_off(now_s, settings)
        return
    left = run.missing()
    if left is None:
        run.calm()
    elif left[0] > hole[0]:
        run.progress(now_s)
    else:
        run.put_off(now_s, settings)


def give_up(run: Run, hole: Range, certain: bool, change: StoreChange) -> None:
    """Stop waiting for a hole: count its first part as lost, or doubt what lies behind it."""
    if run.held and hole[1] - hole[0] >= run.reach:
        # An account that lists it all, and an agent that gives what is far ahead alone.
        withdraw(run, change)
        drop_far(run, change)
        return
    why = "the edge did not give it" if certain else "nobody could be asked for it"
    part, reason = run.disbelieved.first_part(hole)
    if reason is not None:
        why = f"its sensor time is not believed ({reason})"
    pass_over(run, part if run.held or run.followed else hole, why, change)


def lose_damaged(run: Run, holding: Holding, change: StoreChange) -> None:
    """Skip features damaged in the spool, as far as all before them have arrived."""
    for begin, end in joined(holding.damaged):
        while (hole := run.missing()) is not None and begin <= hole[0] <= end:
            if run.asked_ahead or (not run.held and run.is_implausible):
                return  # the end that it has stated is not believed
            lose(run, hole[0], min(end, hole[1]), DAMAGED, change)
            release_held(run, change)
        if hole is None or begin > hole[0]:
            return


def pass_over(run: Run, hole: Range, why: str, change: StoreChange) -> None:
    """Go on behind a hole; a tail that nothing follows is forgotten instead."""
    if run.held or run.followed or run.asked_ahead or run.is_implausible:
        skip(run, hole, why, change)
    else:
        run.forgotten = max(run.forgotten, hole[1])


def skip(run: Run, hole: Range, why: str, change: StoreChange) -> None:
    """Count a hole as lost, unless only an implausible number says that there is one."""
    if run.asked_ahead or (not run.held and run.is_implausible):
        withdraw(run, change)
    else:
        lose(run, *hole, why, change)
        release_held(run, change)


def lose(run: Run, first: int, last: int, why: str, change: StoreChange) -> None:
    """Pass over sequences `first` to `last`, both included, and report them as lost."""
    run.note_lost(first, last)
    run.next = last + 1
    run.interrupt(run.next)
    run.disbelieved.forget(run.next)
    change.lost.append(LostRange(run, first, last, why))
    change.touched[run] = None


def lose_one(run: Run, sequence: int, change: StoreChange) -> None:
    """Report one that has come and cannot be kept; neighbours in one range."""
    run.interrupt(sequence + 1)
    run.note_lost(sequence, sequence)
    before = change.lost[-1] if change.lost else None
    if before is not None and before.run is run and before.last == sequence - 1:
        change.lost[-1] = before._replace(last=sequence)
    else:
        change.lost.append(LostRange(run, sequence, sequence, BACKWARDS))
