"""Lets boots in, in the order of their edge's account, and closes those that are whole."""

import dataclasses
from collections.abc import Sequence

from .asset_runs import AssetRuns
from .changes import LostRange, ReachedLimit, StoreChange
from .evidence import MOST_AHEAD, drop_far, vouch, withdraw
from .runs import Holding, Run
from .sequence import NOT_HELD, lose, pass_over, release_held

LEFT_BEHIND = "a later boot had begun before it could be asked for; the edge keeps it"

MOST_WAITING = 1_000
"""Boots of one asset that wait until its edge has told its account: as many as an edge agent
remembers of those that its full spool has dropped. Others are let in with the account."""

MOST_LET_IN = 200
"""Boots that are let in by one answer, some 40 ms; for the others the edge is asked again, so
that a long account holds up no other asset."""


@dataclasses.dataclass(slots=True)
class BootLimits:
    """What is believed of boots: how many there are, and how far ahead their sequences are.

    Parameters
    ----------
    max_boots
        Boots of one asset.
    alone
        Whether there is no edge to ask: then a boot is let in as it comes.
    max_jump
        How far ahead a sequence is believed where its edge can be asked.
    next_number
        That the next boot gets.
    """

    max_boots: int
    alone: bool
    max_jump: int
    next_number: int = 1

    def reach(self, *, replayed: bool) -> int:
        """How far ahead a sequence is believed; farthest where nobody can be asked."""
        return MOST_AHEAD if self.alone or replayed else self.max_jump


def has_room(line: AssetRuns, boot: str, limits: BootLimits, change: StoreChange) -> bool:
    """Whether an asset may have another boot; where it may not, that is reported once."""
    few = len(line.known) < limits.max_boots
    if few and (limits.alone or len(line.waiting) < MOST_WAITING):
        return True
    allowed = MOST_WAITING if few else limits.max_boots
    change.refused.append(
        (
            "too_many_boots",
            f"Boot {boot} of {line.site}.{line.asset} was given. Allowed: {allowed:,} boots of "
            f"one asset{' that wait to be let in' if few else ', admission.max_boots'}. Find "
            "out why its agent starts so often, or raise the setting; its features stay in its "
            "spool.",
        )
    )
    if not few and not line.crowded:
        line.crowded = True
        change.limits.append(
            ReachedLimit(line.site, line.asset, boot, "admission.max_boots", allowed)
        )
    return False


def admit(
    line: AssetRuns,
    listing: Sequence[Holding],
    limits: BootLimits,
    now_s: float,
    change: StoreChange,
) -> None:
    """Admit every waiting boot, and others that the edge holds, oldest first."""
    new = [
        (holding.boot, holding)
        for holding in listing
        if (holding.last >= holding.first or holding.last + 1 == holding.first > 0)
        and not _is_admitted(line, holding.boot)
    ]
    listed = {boot for boot, _ in new}
    # A known boot that is no longer held is older than those that are.
    later: list[tuple[str, Holding | None]] = [
        *((boot, None) for boot in line.waiting if boot not in listed),
        *new,
    ]
    if later and not limits.alone:
        held_still = {holding.boot for holding in listing}
        for run in line.unfinished:
            run.gone = run.gone or run.boot not in held_still
    line.inquire = line.inquire or len(later) > MOST_LET_IN
    for boot, holding in later[:MOST_LET_IN]:
        if boot in line.waiting:
            run = line.waiting.pop(boot)
        elif _is_admitted(line, boot):
            continue  # listed twice
        elif has_room(line, boot, limits, change):
            reach = limits.reach(replayed=line.replayed)
            run = Run(line.site, line.asset, boot, since_s=now_s, reach=reach)
            line.add(run)
        else:
            break
        _let_in(line, run, holding, bool(listing), limits, change)
        if run.missing() is not None:
            run.worried = False
    close_finished(line, change)


def close_finished(line: AssetRuns, change: StoreChange) -> None:
    """Close each boot that is whole and has a successor; let the successor flow."""
    while line.unfinished:
        run = line.unfinished[0]
        run.flows = True
        release_held(run, change)
        if run.followed and run.gone:
            while (hole := run.missing()) is not None:
                pass_over(run, hole, NOT_HELD, change)
        if not run.followed or run.missing() is not None:
            return
        if run.next <= run.told <= run.next + run.reach:
            lose(run, run.next, run.told, "the edge did not give it", change)
        elif run.told >= run.next:
            withdraw(run, change)
        run.closed, run.flows = True, False
        run.calm()
        change.touched[run] = None
        line.unfinished.popleft()


def leave_behind(run: Run, holding: Holding, change: StoreChange) -> None:
    """Report features of a closed boot that an edge holds; they stay in its spool."""
    first = max(run.next, run.lost[-1][1] + 1 if run.lost else 0)
    if first > holding.last:
        return
    if holding.last > run.next + run.reach:
        run.told = max(run.told, holding.last)
        withdraw(run, change)
        return
    run.note_lost(first, holding.last)
    change.lost.append(LostRange(run, first, holding.last, LEFT_BEHIND))
    change.touched[run] = None


def _is_admitted(line: AssetRuns, boot: str) -> bool:
    run = line.known.get(boot)
    return run is not None and run.number > 0


def _let_in(
    line: AssetRuns,
    run: Run,
    holding: Holding | None,
    answered: bool,
    limits: BootLimits,
    change: StoreChange,
) -> None:
    run.ack_version = line.ack_version if holding is None else holding.ack_version
    run.number, limits.next_number = limits.next_number, limits.next_number + 1
    line.follow(run)
    change.touched[run] = None
    if holding is not None:
        run.told = max(run.told, holding.last)
        vouch(run, holding)
    drop_far(run, change)
    earliest = run.held.first
    if holding is not None:
        first = holding.first if earliest is None else min(holding.first, earliest)
    else:
        first = (earliest or 0) if answered else 0
    # Where it begins farther ahead, it has to show that there is something.
    if 0 < first <= run.reach:
        lose(run, 0, first - 1, NOT_HELD, change)
    change.held += [(run, sequence, held.payload) for sequence, held in run.held.items()]
