"""Which stated sequences are believed: near ones, and those that an edge lists and delivers.

A sequence up to `reach` ahead of the one expected is believed. What lies farther ahead is let
in where the agent's own account lists it and the agent delivers it when it is asked: so an edge
goes on that is millions ahead of a server restored from an old backup. Everything else is a
mistake or a lie. It is not waited for, not counted as lost, and told once for each boot.
"""

from .changes import DoubtedSequence, StoreChange
from .intervals import Range
from .runs import MOST_AT_ONCE, Holding, Run

MOST_AHEAD = 2**32
"""How far ahead a sequence may be that the agent's account lists: 13 years of ten features a
second. What a recording holds, of which nobody can be asked, is let in as far."""


def vouch(run: Run, holding: Holding) -> None:
    """Note what an agent's account lists far ahead, so that it is asked for."""
    near = holding.last <= run.next + run.reach and holding.first <= run.next + MOST_AT_ONCE
    believable = holding.first <= holding.last <= run.next + MOST_AHEAD
    if believable and not near and holding.last > run.forgotten:
        run.vouched = (holding.first, holding.last)


def doubt(run: Run, stated: int, change: StoreChange) -> None:
    """Report that a stated sequence is not believed, once for each boot."""
    if not run.doubted:
        run.doubted = True
        change.doubted.append(DoubtedSequence(run, stated, run.next))


def withdraw(run: Run, change: StoreChange) -> None:
    """Stop waiting for what an agent has stated and not delivered; nothing of it is lost."""
    stated = max(run.told, -1 if run.vouched is None else run.vouched[1])
    if stated > run.next + run.reach:
        doubt(run, stated, change)
    run.vouched = None
    run.forgotten = max(run.forgotten, stated)


def drop_far(run: Run, change: StoreChange) -> None:
    """Refuse held features that lie beyond what is believed."""
    far = [sequence for sequence in run.held if sequence > run.horizon]
    for sequence in far:
        del run.held[sequence]
        if run.number:
            change.released.append((run, sequence))
        change.refused.append(("sequence_jump", jump_refusal(run, sequence)))
    if far:
        doubt(run, max(far), change)
        change.touched[run] = None


def jump_refusal(run: Run, sequence: int) -> str:
    """Say why features far ahead are not taken in."""
    return (
        f"{run}: sequence {sequence} was given, but {run.next} was expected. Allowed: up to "
        f"{run.reach:,} ahead, or what the agent's account lists and the agent delivers. "
        "Number the features of a boot from 0 without jumps."
    )


def correct(run: Run, change: StoreChange) -> None:
    """Take back what an earlier server believed of a boot's stated sequences."""
    # Where features behind a range were accepted, it cannot be expected again.
    false = [p for p in run.lost if p[1] - p[0] >= MOST_AHEAD and run.last < p[0]]
    stated = max([run.told, *(last for _, last in false), *run.held])
    for part in false:
        _restore_lost(run, part)
    if not false and stated <= run.next + run.reach:
        return
    run.told = min(run.told, max(run.next - 1, run.last))
    for sequence in [sequence for sequence in run.held if sequence > run.horizon]:
        del run.held[sequence]
        change.released.append((run, sequence))
    change.touched[run] = None
    run.doubted = True
    change.doubted.append(DoubtedSequence(run, stated, run.next, corrected=True))


def _restore_lost(run: Run, part: Range) -> None:
    """Expect again what was counted as lost on the word of a false number."""
    run.lost.remove(part)
    if run.next == part[1] + 1:
        run.next = part[0]
