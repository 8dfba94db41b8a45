"""The account of what each boot of each edge has sent: in any order in, in one order out.

Features of a boot are numbered from 0. They are let through in that order, boot after boot; one
that comes early is held, one that comes twice refused. What is missing is asked for again (see
`Want`), and passed over only once it is known that nobody has it any more.

The account does no I/O and has no clock: the seconds are arguments, and what follows from each
call is written into a `Change`, for the pipeline to make durable.
"""

import datetime
from collections.abc import Iterable, Sequence

from slowtime_schemas.messages import ACK_VERSION, FOREIGN_ACKS, Features, Health
from twin_server.settings import HealingSettings

from .runs import (
    SEQUENCES,
    Aged,
    Arrival,
    Change,
    Holding,
    Line,
    Lost,
    Ordered,
    Repeated,
    Rivals,
    Run,
    Want,
)

BACKWARDS = "its sensor time runs back"
DAMAGED = "the edge's spool is damaged there"
OTHERS_TAKEN = "an agent holds other readings than those that were taken in"
LEFT_BEHIND = "a later boot had begun before it could be asked for; the edge keeps it"
SAME_AGENT_MS = 1_000
"""An agent says when it began to the microsecond; one that restarts takes longer than this."""
MOST_AGENTS = 8
SURVIVES = 2
"""Messages of health of a closed boot, from after a later one began, that show that its agent
lives: one may have been on its way when it ended."""


class Account:
    """What has been had of every asset, and what is missing.

    Parameters
    ----------
    settings
        When to ask and when to give up.
    max_jump
        How far a sequence may be ahead of the one expected.
    alone
        Whether there is no edge to ask: then a boot is let in as it comes.
    """

    def __init__(
        self, settings: HealingSettings, *, max_jump: int = 10**6, alone: bool = False
    ) -> None:
        self._settings, self._max_jump, self._alone = settings, max_jump, alone
        self._lines: dict[tuple[str, str], Line] = {}
        self._runs: dict[tuple[str, str, str], Run] = {}
        self._uneasy: dict[tuple[str, str], Line] = {}
        self._asked: dict[tuple[str, str], Line] = {}
        self._next_number = 1

    def restore(self, runs: Iterable[Run], next_number: int) -> None:
        """Remember what was made durable before; runs in the order of their numbers."""
        for run in runs:
            line = self._line(run.site, run.asset)
            if line.runs:
                line.runs[-1].followed = True
            run.interrupt(run.next)
            line.runs.append(run)
            self._runs[run.site, run.asset, run.boot] = run
            self._uneasy[run.site, run.asset] = line
        for line in self._lines.values():
            open_runs = [run for run in line.runs if not run.closed]
            for run in open_runs[:1]:
                run.flows = True
        self._next_number = next_number

    def forget(self, site: str, asset: str) -> None:
        """Know nothing of an asset any more, but that its edge is there."""
        line = self._line(site, asset)
        for run in (*line.runs, *line.waiting.values()):
            del self._runs[site, asset, run.boot]
        line.runs.clear()
        line.waiting.clear()
        line.inquire = line.alive
        line.ease()
        self._uneasy[site, asset] = line

    def take(self, arrivals: Iterable[Arrival], now_s: float, change: Change) -> None:
        """Take what arrived: order, hold or refuse it."""
        for arrival in arrivals:
            features = arrival.features
            run = self._runs.get((features.site, features.asset, features.boot))
            if run is None:
                run = self._meet(features.site, features.asset, features.boot, now_s, change)
                self._line(features.site, features.asset).replayed = arrival.replayed
            if run.flows and features.sequence == run.next:
                self._accept(run, arrival, change)
                if run.held or run.followed:
                    self._flow(run, change)
                    self._check_end(run, change)
            else:
                self._put_aside(run, arrival, now_s, change)

    def hear(
        self, healths: Iterable[tuple[Health, bool]], now_s: float, change: Change
    ) -> None:
        """Learn from health messages, replayed or not, how far each boot has got."""
        for health, replayed in healths:
            key = (health.site, health.asset, health.boot)
            run = self._runs.get(key)
            if not replayed:
                line = self._line(health.site, health.asset)
                line.ack_version = health.counters.get(ACK_VERSION, 1)
                self._hear_of_foreign_acks(line, health)
            if run is None:
                if health.last_sequence < 0:
                    continue
                run = self._meet(*key, now_s, change)
                self._line(health.site, health.asset).replayed = replayed
            if not replayed:
                run.ack_version = line.ack_version
                self._recognise(run, health, change)
                self._look_for_survivor(line, run, health, change)
            if health.last_sequence > run.told:
                run.told = health.last_sequence
                if run.next <= run.told:
                    self._worry(run, now_s)
            if 0 <= health.first_held < run.next:
                run.held_from = health.first_held
                # The edge still holds what is durable here: our word did not reach it.
                change.touched[run] = None

    def disbelieve(self, refused: Iterable[tuple[Features, str]]) -> None:
        """Note what came and was refused for its sensor time, to say so if it is given up."""
        for features, reason in refused:
            run = self._runs.get((features.site, features.asset, features.boot))
            if run is not None and len(run.disbelieved) < self._settings.max_held:
                run.disbelieved[features.sequence] = reason

    def contest(self, run: Run, how: str, change: Change) -> None:
        """Note that two agents send under one boot: nothing more of it is acknowledged."""
        run.contested = True
        if not run.rivalled:
            run.rivalled = True
            change.rivals.append(Rivals(run, run.boot, run.next, how))

    def contest_reading(
        self, run: Run, sequence: int, one_ns: int, other_ns: int, change: Change
    ) -> None:
        """Note that two agents have sent different readings under one sequence."""
        self.contest(run, _told_apart(sequence, one_ns, other_ns), change)
        change.refused.append(
            (
                "two_agents",
                f"{run}: sequence {sequence} was given with other content than before. "
                "Allowed: one agent at a time per asset. Give each its own asset name, and "
                "leave `boot` unset.",
            )
        )

    def _hear_of_foreign_acks(self, line: Line, health: Health) -> None:
        """Ask an agent that was told of another's readings, which boot it means."""
        foreign = health.counters.get(FOREIGN_ACKS, 0)
        if foreign and foreign != line.foreign_acks:
            line.inquire = True
            line.ease()
            self._uneasy[line.site, line.asset] = line
        line.foreign_acks = foreign

    def _recognise(self, run: Run, health: Health, change: Change) -> None:
        """Tell the agents of a boot apart by when they began."""
        if health.uptime_s <= 0:
            return
        began_ms = health.t_ns // 10**6 - round(health.uptime_s * 1e3)
        if all(abs(began_ms - other) > SAME_AGENT_MS for other in run.agents):
            run.agents = [*run.agents, began_ms][-MOST_AGENTS:]
            if len(run.agents) > 1:
                one, other = (_instant(ms * 10**6) for ms in run.agents[-2:])
                self.contest(run, f"one began at {one}, the other at {other}", change)

    def _look_for_survivor(self, line: Line, run: Run, health: Health, change: Change) -> None:
        """See whether the agent of a closed boot lives on beside that of a later one."""
        later = line.runs[-1] if line.runs else run
        if run.rivalled or not run.closed or later is run or not later.agents:
            return
        if health.t_ns // 10**6 > later.agents[-1] + SAME_AGENT_MS:
            run.outlived += 1
        if run.outlived >= SURVIVES:
            self._tell_of_rivals(run, change)

    def _tell_of_rivals(self, run: Run, change: Change) -> None:
        run.rivalled = True
        latest = self._line(run.site, run.asset).runs[-1].boot
        change.rivals.append(Rivals(run, latest, run.next, "they use different boots"))

    def watch(self, site: str, asset: str, *, alive: bool) -> None:
        """Learn that an edge has appeared, or gone."""
        line = self._line(site, asset)
        line.alive = alive
        if alive:
            line.spooled = True
            line.inquire = True
            line.ease()
            self._uneasy[site, asset] = line

    def wants(self, now_s: float) -> list[Want]:
        """List what to ask of which edge now; each is asked until `settle` is told of it."""
        wants = []
        for key, line in list(self._uneasy.items()):
            want, uneasy = line.want(now_s, self._settings)
            if want is not None:
                line.busy = True
                self._asked[key] = self._uneasy.pop(key)
                wants.append(want)
            elif not uneasy:
                del self._uneasy[key]
        return wants

    def settle(
        self,
        want: Want,
        listing: Sequence[Holding] | None,
        now_s: float,
        change: Change,
        *,
        sound: bool = True,
    ) -> None:
        """Conclude from an edge's account, after its answers, if any, have been taken.

        Parameters
        ----------
        listing
            What the edge says it holds; None where it was not asked, because the features
            it gave were answer enough.
        sound
            Whether all questions were answered without error.
        """
        line = self._line(want.site, want.asset)
        line.busy = False
        self._asked.pop((want.site, want.asset), None)
        self._uneasy[want.site, want.asset] = line
        certain = sound and listing is not None and (bool(listing) or line.alive)
        if listing:
            line.spooled = True
        if listing is not None and (line.waiting or line.inquire):
            self._conclude_account(line, listing, certain, now_s, change)
        run = self._runs.get((want.site, want.asset, want.boot))
        if run is not None and run.number:
            self._conclude_hole(line, run, want, listing or (), certain, now_s, change)
        self._close_finished(line, change)

    def still_missing(self, want: Want) -> bool:
        """Whether the first of what was asked for is still missing."""
        run = self._runs.get((want.site, want.asset, want.boot))
        hole = None if run is None or run.closed else run.missing()
        return hole is not None and hole[0] <= want.first

    def give_up(self, change: Change) -> None:
        """Wait for nothing any more: admit who waits, pass over every hole.

        For a source that has ended and can be asked for nothing, such as a recording that
        was read straight into the pipeline.
        """
        for line in self._lines.values():
            self._admit(line, (), 0.0, change)
            for run in line.runs:
                run.flows = not run.closed
                self._flow(run, change)
                while (hole := run.missing()) is not None:
                    self._lose(run, hole[0], hole[1], "it cannot be asked for", change)
                    self._flow(run, change)
            self._close_finished(line, change)

    @property
    def holes(self) -> int:
        """How many boots are missing something now."""
        return sum(
            1 for line in self._unsettled for run in line.runs if run.missing() is not None
        )

    @property
    def held(self) -> int:
        """How many features are held out of order."""
        return sum(len(run.held) for line in self._unsettled for run in line.all_runs())

    @property
    def _unsettled(self) -> set[Line]:
        return {*list(self._uneasy.values()), *list(self._asked.values())}

    @property
    def alive(self) -> list[str]:
        """Twin ids of the edges that are there."""
        return [
            f"{site}.{asset}" for (site, asset), line in list(self._lines.items()) if line.alive
        ]

    def is_alive(self, site: str, asset: str) -> bool:
        """Whether the edge of an asset is there."""
        line = self._lines.get((site, asset))
        return line is not None and line.alive

    def _line(self, site: str, asset: str) -> Line:
        return self._lines.setdefault((site, asset), Line(site, asset))

    def _meet(self, site: str, asset: str, boot: str, now_s: float, change: Change) -> Run:
        """Note a boot never seen; the edge is asked what else it has before it is let in."""
        line = self._line(site, asset)
        run = Run(site, asset, boot, since_s=now_s, ack_version=line.ack_version)
        self._runs[site, asset, boot] = line.waiting[boot] = run
        self._uneasy[site, asset] = line
        line.ease()
        if self._alone:
            self._admit(line, (), now_s, change)
        return run

    def _accept(self, run: Run, arrival: Arrival, change: Change) -> None:
        features = arrival.features
        run.next = features.sequence + 1
        change.touched[run] = None
        if features.t_ns <= run.last_t_ns:
            self._lose_one(run, features.sequence, change)
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
        missing = features.sequence - run.last - 1
        change.ordered.append(
            Ordered(run, features, arrival.payload, missing, arrival.replayed)
        )
        run.last, run.last_t_ns = features.sequence, features.t_ns
        run.take(features.sequence, arrival.payload)
        if arrival.age_s and not run.aged:
            run.aged = True
            change.aged.append(Aged(run, features.sequence, arrival.age_s))

    def _check_end(self, run: Run, change: Change) -> None:
        if run.followed:
            self._close_finished(self._line(run.site, run.asset), change)

    def _flow(self, run: Run, change: Change) -> None:
        """Let through what was held, as far as nothing is missing before it."""
        while run.flows and run.next in run.held:
            sequence = run.next
            change.released.append((run, sequence))
            self._accept(run, run.held.pop(sequence), change)

    def _put_aside(self, run: Run, arrival: Arrival, now_s: float, change: Change) -> None:
        sequence = arrival.features.sequence
        refusal = self._refusal(run, sequence)
        if refusal is not None:
            change.refused.append(refusal)
            self._look_for_rivals(run, arrival, refusal[0], change)
            change.touched[run] = None
            return
        run.held[sequence] = arrival
        if run.number:
            change.held.append((run, sequence, arrival.payload))
            change.touched[run] = None
            change.early += 1
        self._worry(run, now_s)

    def _look_for_rivals(self, run: Run, arrival: Arrival, reason: str, change: Change) -> None:
        """See whether what was refused comes from a second agent."""
        if arrival.replayed:
            return
        sequence = arrival.features.sequence
        if reason == "closed_boot" and not run.rivalled:
            self._tell_of_rivals(run, change)
        elif reason == "duplicate" and sequence in run.held:
            if run.held[sequence].payload != arrival.payload:
                times = run.held[sequence].features.t_ns, arrival.features.t_ns
                self.contest_reading(run, sequence, *times, change)
        elif reason == "duplicate":
            change.repeated.append(Repeated(run, sequence, arrival.payload))

    def _refusal(self, run: Run, sequence: int) -> tuple[str, str] | None:
        what = f"{run}: sequence {sequence} was given, "
        if run.number and sequence < run.next:
            if any(first <= sequence <= last for first, last in run.lost):
                return "too_late", (
                    f"{what}which was given up as lost. Allowed: what comes while it is asked "
                    "for. Raise the patience in the healing settings if edges need longer."
                )
            return "duplicate", (
                f"{what}which is known. Allowed: each once. Nothing needs doing."
            )
        if sequence in run.held:
            return "duplicate", (
                f"{what}which is held. Allowed: each once. Nothing needs doing."
            )
        if run.closed:
            return "closed_boot", (
                f"{what}but a later boot of {run.site}.{run.asset} has begun. Allowed: one "
                "agent at a time per asset. Give each its own asset name."
            )
        if sequence >= SEQUENCES or (
            run.number and sequence > max(run.next, run.told) + self._max_jump
        ):
            return "sequence_jump", (
                f"{what}but {run.next} was expected. Allowed: up to {self._max_jump:,} ahead. "
                "Number the features of a boot from 0 without leaps."
            )
        if len(run.held) >= self._settings.max_held:
            return "held_full", (
                f"{what}but {len(run.held):,} are held already since {run.next} is missing. "
                "Allowed: up to max_held. It is asked for again once there is room."
            )
        return None

    def _worry(self, run: Run, now_s: float) -> None:
        if not run.worried:
            run.worried, run.since_s = True, now_s
            run.due_s = now_s + self._settings.grace_s
        self._uneasy[run.site, run.asset] = self._line(run.site, run.asset)

    def _conclude_account(
        self,
        line: Line,
        listing: Sequence[Holding],
        certain: bool,
        now_s: float,
        change: Change,
    ) -> None:
        if not listing and line.waiting and not line.impatient(certain, now_s, self._settings):
            line.put_off(now_s, self._settings)
            return
        line.inquire = False
        line.ease()
        for holding in listing:
            known = self._runs.get((line.site, line.asset, holding.boot))
            if known is None or not known.number:
                continue
            known.ack_version = holding.ack_version
            known.held_from, known.held_to = holding.first, holding.last
            if holding.withheld and not known.contested:
                self.contest(known, OTHERS_TAKEN, change)
            if holding.last > known.told:
                known.told = holding.last
                # Durable together with the boots let in after it: a server that starts again
                # would close it as whole.
                change.touched[known] = None
                self._worry(known, now_s)
            if known.closed and holding.last >= known.next and not known.rivalled:
                self._leave_behind(known, holding, change)
            if holding.last < known.next:
                change.touched[known] = None  # it keeps what is durable: it is told again
        self._admit(line, listing, now_s, change)

    def _leave_behind(self, run: Run, holding: Holding, change: Change) -> None:
        """Report what an edge holds of a closed boot; unacknowledged, it stays in the spool."""
        first = max(run.next, max((last for _, last in run.lost), default=-1) + 1)
        if first <= holding.last:
            run.lost.append((first, holding.last))
            change.lost.append(Lost(run, first, holding.last, LEFT_BEHIND))
            change.touched[run] = None

    def _admit(
        self, line: Line, listing: Sequence[Holding], now_s: float, change: Change
    ) -> None:
        """Let in every boot that waits, and those the edge holds besides, oldest first."""
        new = [
            (holding.boot, holding)
            for holding in listing
            if (holding.last >= holding.first or holding.last + 1 == holding.first > 0)
            and not self._is_admitted(line.site, line.asset, holding.boot)
        ]
        listed = {boot for boot, _ in new}
        # One that was heard of and is not held any more is older than those that are.
        later: list[tuple[str, Holding | None]] = [
            *((boot, None) for boot in line.waiting if boot not in listed),
            *new,
        ]
        if later and not self._alone:
            held_still = {holding.boot for holding in listing}
            for run in line.runs:
                run.gone = run.gone or run.boot not in held_still
        for boot, holding in later:
            self._let_in(line, boot, holding, bool(listing), now_s, change)
        self._close_finished(line, change)

    def _is_admitted(self, site: str, asset: str, boot: str) -> bool:
        run = self._runs.get((site, asset, boot))
        return run is not None and run.number > 0

    def _let_in(
        self,
        line: Line,
        boot: str,
        holding: Holding | None,
        answered: bool,
        now_s: float,
        change: Change,
    ) -> None:
        run = line.waiting.pop(boot, None) or Run(line.site, line.asset, boot, since_s=now_s)
        self._runs[line.site, line.asset, boot] = run
        run.number, self._next_number = self._next_number, self._next_number + 1
        if line.runs:
            line.runs[-1].followed = True
        line.runs.append(run)
        change.touched[run] = None
        earliest = min(run.held, default=None)
        if holding is not None:
            run.told = max(run.told, holding.last)
            first = holding.first if earliest is None else min(holding.first, earliest)
        else:
            first = (earliest or 0) if answered else 0
        if first > 0:
            self._lose(run, 0, first - 1, "the edge no longer holds it", change)
        change.held += [(run, sequence, held.payload) for sequence, held in run.held.items()]
        if run.missing() is not None:
            run.worried = False
            self._worry(run, now_s)

    def _conclude_hole(
        self,
        line: Line,
        run: Run,
        want: Want,
        listing: Sequence[Holding],
        certain: bool,
        now_s: float,
        change: Change,
    ) -> None:
        holding = next((entry for entry in listing if entry.boot == run.boot), None)
        if certain and holding is not None:
            self._lose_damaged(run, holding, change)
        hole = run.missing()
        if hole is None:
            run.calm()
            return
        if hole[0] > want.first:
            run.progress(now_s)
            return
        obtainable = holding is not None and holding.last >= hole[0]
        if certain and listing and not obtainable:
            self._pass_over(line, run, hole, "the edge no longer holds it", change)
        elif certain and holding is not None and holding.first > hole[0]:
            until = min(hole[1], holding.first - 1)
            self._pass_over(line, run, (hole[0], until), "the edge no longer holds it", change)
        elif run.impatient(certain, line, now_s, self._settings):
            why = "the edge did not give it" if certain else "nobody could be asked for it"
            self._pass_over(line, run, *_reasoned(run, hole, why), change)
        else:
            run.put_off(now_s, self._settings)
            return
        if run.missing() is None:
            run.calm()
        else:
            run.progress(now_s)

    def _lose_damaged(self, run: Run, holding: Holding, change: Change) -> None:
        """Pass over what is damaged in the spool, as far as all before it has come."""
        while (hole := run.missing()) is not None:
            damaged = _damaged_part(hole, holding)
            if damaged is None:
                return
            self._lose(run, *damaged, DAMAGED, change)
            self._flow(run, change)

    def _pass_over(
        self, line: Line, run: Run, hole: tuple[int, int], why: str, change: Change
    ) -> None:
        """Go on behind a hole; a tail that nothing follows is forgotten instead."""
        if run.held or run.followed:
            self._lose(run, *hole, why, change)
            self._flow(run, change)
        else:
            run.forgotten = max(run.forgotten, hole[1])

    def _lose(self, run: Run, first: int, last: int, why: str, change: Change) -> None:
        run.lost.append((first, last))
        run.next = last + 1
        run.interrupt(run.next)
        change.lost.append(Lost(run, first, last, why))
        change.touched[run] = None

    def _lose_one(self, run: Run, sequence: int, change: Change) -> None:
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
            change.lost.append(Lost(run, sequence, sequence, BACKWARDS))

    def _close_finished(self, line: Line, change: Change) -> None:
        """Close each boot that is whole and has a successor; let the successor flow."""
        for run in line.runs:
            if run.closed:
                continue
            run.flows = True
            self._flow(run, change)
            if run.followed and run.gone:
                while (hole := run.missing()) is not None:
                    self._lose(run, *hole, "the edge no longer holds it", change)
                    self._flow(run, change)
            if not run.followed or run.missing() is not None:
                return
            if run.told >= run.next:
                self._lose(run, run.next, run.told, "the edge did not give it", change)
            run.closed, run.flows = True, False
            run.calm()
            change.touched[run] = None


def _damaged_part(hole: tuple[int, int], holding: Holding) -> tuple[int, int] | None:
    """Give as much of a hole, from its first on, as the edge says is damaged."""
    first, until = hole[0], hole[0]
    for begin, end in sorted(holding.damaged):
        if begin <= until <= end:
            until = end + 1
    return (first, min(until - 1, hole[1])) if until > first else None


def _reasoned(run: Run, hole: tuple[int, int], why: str) -> tuple[tuple[int, int], str]:
    """Give the first part of a hole that has one reason, and that reason."""
    reason = run.disbelieved.get(hole[0])
    until = hole[0]
    while until < hole[1] and run.disbelieved.get(until + 1) == reason:
        until += 1
    part = (hole[0], until if run.disbelieved else hole[1])
    return part, why if reason is None else f"its sensor time is not believed ({reason})"


def _told_apart(sequence: int, one_ns: int, other_ns: int) -> str:
    """Say what distinguishes two readings that came under one sequence."""
    if one_ns == other_ns:
        return f"reading {sequence} came twice, with different content"
    return (
        f"reading {sequence} came with sensor time {_instant(one_ns)}, and again with "
        f"{_instant(other_ns)} and other content"
    )


def _instant(t_ns: int) -> str:
    when = datetime.datetime.fromtimestamp(t_ns // 10**9, datetime.UTC)
    return f"{when:%Y-%m-%dT%H:%M:%S}.{t_ns % 10**9 // 10**6:03d}Z"
