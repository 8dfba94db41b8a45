"""The account of the features that each boot of each edge has sent, and of those missing.

Features of a boot are numbered from 0. They are let through in that order, boot after boot; one
that comes early is held, one that comes twice refused. What is missing is asked for again (see
`EdgeQuery`), and passed over only once it is known that nobody has it any more.

The account does no I/O and has no clock: the seconds are arguments, and what follows from each
call is written into a `Change`, for the pipeline to make durable.
"""

from collections.abc import Iterable, Sequence

from slowtime_schemas.messages import ACK_VERSION, FOREIGN_ACKS, Features, Health
from twin_server.settings import BackfillSettings

from .rivals import contest, look_for_rivals, look_for_survivor, tell_agents_apart
from .runs import (
    Arrival,
    AssetRuns,
    Change,
    EdgeQuery,
    Holding,
    LostRange,
    Run,
)
from .sequence import accept, conclude_hole, lose, refusal_of, release_held

OTHERS_TAKEN = "an agent holds other readings than those that were taken in"
LEFT_BEHIND = "a later boot had begun before it could be asked for; the edge keeps it"


class Account:
    """The features that every asset has sent, and those that are missing.

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
        self, settings: BackfillSettings, *, max_jump: int = 10**6, alone: bool = False
    ) -> None:
        self._settings, self._max_jump, self._alone = settings, max_jump, alone
        self._lines: dict[tuple[str, str], AssetRuns] = {}
        self._runs: dict[tuple[str, str, str], Run] = {}
        self._uneasy: dict[tuple[str, str], AssetRuns] = {}
        self._asked: dict[tuple[str, str], AssetRuns] = {}
        self._next_number = 1

    def restore(self, runs: Iterable[Run], next_number: int) -> None:
        """Restore runs that were made durable before, in the order of their numbers."""
        for run in runs:
            line = self._line(run.site, run.asset)
            if line.runs:
                line.runs[-1].followed = True
                run.earlier = line.runs[-1]
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
        """Delete all runs of an asset; only the presence of its edge is kept."""
        line = self._line(site, asset)
        for run in (*line.runs, *line.waiting.values()):
            del self._runs[site, asset, run.boot]
        line.runs.clear()
        line.waiting.clear()
        line.inquire = line.alive
        line.ease()
        self._uneasy[site, asset] = line

    def take(self, arrivals: Iterable[Arrival], now_s: float, change: Change) -> None:
        """Sort arriving features: accept, hold or refuse each.

        Parameters
        ----------
        arrivals
            Features with their arrival.
        now_s
            Monotonic time [s].
        change
            Collects accepted features, held features and notices.
        """
        for arrival in arrivals:
            features = arrival.features
            run = self._runs.get((features.site, features.asset, features.boot))
            if run is None:
                run = self._meet(features.site, features.asset, features.boot, now_s, change)
                self._line(features.site, features.asset).replayed = arrival.replayed
            if run.flows and features.sequence == run.next:
                accept(run, arrival, change)
                if run.held or run.followed:
                    release_held(run, change)
                    self._check_end(run, change)
            else:
                self._put_aside(run, arrival, now_s, change)

    def hear(
        self, healths: Iterable[tuple[Health, bool]], now_s: float, change: Change
    ) -> None:
        """Take from health messages, replayed or not, the last sequence of each boot.

        Parameters
        ----------
        healths
            Health messages, and whether each is replayed.
        now_s
            Monotonic time [s].
        change
            Collects accepted features, held features and notices.
        """
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
                tell_agents_apart(run, health, change)
                look_for_survivor(line, run, health, change)
            if health.last_sequence > run.told:
                run.told = health.last_sequence
                if run.next <= run.told:
                    self._worry(run, now_s)
            if 0 <= health.first_held < run.next:
                run.held_from = health.first_held
                # The edge still holds durable features: the acknowledgement did not reach it.
                change.touched[run] = None

    def disbelieve(self, refused: Iterable[tuple[Features, str]]) -> None:
        """Note features refused for their sensor time, so that giving them up is reported."""
        for features, reason in refused:
            run = self._runs.get((features.site, features.asset, features.boot))
            if run is not None and len(run.disbelieved) < self._settings.max_held:
                run.disbelieved[features.sequence] = reason

    def _hear_of_foreign_acks(self, line: AssetRuns, health: Health) -> None:
        """Ask an agent that received another's acknowledgements which boot they concern."""
        foreign = health.counters.get(FOREIGN_ACKS, 0)
        if foreign and foreign != line.foreign_acks:
            line.inquire = True
            line.ease()
            self._uneasy[line.site, line.asset] = line
        line.foreign_acks = foreign

    def watch(self, site: str, asset: str, *, alive: bool) -> None:
        """Note that an edge has appeared or disappeared."""
        line = self._line(site, asset)
        line.alive = alive
        if alive:
            line.spooled = True
            line.inquire = True
            line.ease()
            self._uneasy[site, asset] = line

    def wants(self, now_s: float) -> list[EdgeQuery]:
        """List the requests due now, by edge; each is repeated until `settle` confirms it.

        Parameters
        ----------
        now_s
            Monotonic time [s].

        Returns
        -------
        Queries to send.
        """
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
        want: EdgeQuery,
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
            # Of an agent that keeps an account, no answer at all says nothing about a hole: its
            # token may be back a moment before its answers are, after the router was away.
            told = certain and (bool(listing) or not line.spooled)
            conclude_hole(line, run, want, listing or (), told, now_s, self._settings, change)
        self._close_finished(line, change)

    def still_missing(self, want: EdgeQuery) -> bool:
        """Whether the first requested feature is still missing."""
        run = self._runs.get((want.site, want.asset, want.boot))
        hole = None if run is None or run.closed else run.missing()
        return hole is not None and hole[0] <= want.first

    def give_up(self, change: Change) -> None:
        """Stop waiting: admit boots that wait and skip every hole.

        For a source that has ended and can be asked for nothing, such as a recording that
        was read straight into the pipeline.
        """
        for line in self._lines.values():
            self._admit(line, (), 0.0, change)
            for run in line.runs:
                run.flows = not run.closed
                release_held(run, change)
                while (hole := run.missing()) is not None:
                    lose(run, hole[0], hole[1], "it cannot be asked for", change)
                    release_held(run, change)
            self._close_finished(line, change)

    @property
    def holes(self) -> int:
        """Number of boots with missing features."""
        return sum(
            1 for line in self._unsettled for run in line.runs if run.missing() is not None
        )

    @property
    def held(self) -> int:
        """Number of features held out of order."""
        return sum(len(run.held) for line in self._unsettled for run in line.all_runs())

    @property
    def _unsettled(self) -> set[AssetRuns]:
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

    def _line(self, site: str, asset: str) -> AssetRuns:
        return self._lines.setdefault((site, asset), AssetRuns(site, asset))

    def _meet(self, site: str, asset: str, boot: str, now_s: float, change: Change) -> Run:
        """Note a new boot; its edge is asked for other features before the boot is admitted."""
        line = self._line(site, asset)
        run = Run(site, asset, boot, since_s=now_s, ack_version=line.ack_version)
        self._runs[site, asset, boot] = line.waiting[boot] = run
        self._uneasy[site, asset] = line
        line.ease()
        if self._alone:
            self._admit(line, (), now_s, change)
        return run

    def _check_end(self, run: Run, change: Change) -> None:
        if run.followed:
            self._close_finished(self._line(run.site, run.asset), change)

    def _put_aside(self, run: Run, arrival: Arrival, now_s: float, change: Change) -> None:
        sequence = arrival.features.sequence
        refusal = refusal_of(run, sequence, self._settings, self._max_jump)
        if refusal is not None:
            change.refused.append(refusal)
            look_for_rivals(self._line(run.site, run.asset), run, arrival, refusal[0], change)
            change.touched[run] = None
            return
        run.held[sequence] = arrival
        if run.number:
            change.held.append((run, sequence, arrival.payload))
            change.touched[run] = None
            change.early += 1
        self._worry(run, now_s)

    def _worry(self, run: Run, now_s: float) -> None:
        if not run.worried:
            run.worried, run.since_s = True, now_s
            run.due_s = now_s + self._settings.grace_s
        self._uneasy[run.site, run.asset] = self._line(run.site, run.asset)

    def _conclude_account(
        self,
        line: AssetRuns,
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
                contest(known, OTHERS_TAKEN, change)
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
        """Report features of a closed boot that an edge holds; they stay in its spool."""
        first = max(run.next, max((last for _, last in run.lost), default=-1) + 1)
        if first <= holding.last:
            run.lost.append((first, holding.last))
            change.lost.append(LostRange(run, first, holding.last, LEFT_BEHIND))
            change.touched[run] = None

    def _admit(
        self, line: AssetRuns, listing: Sequence[Holding], now_s: float, change: Change
    ) -> None:
        """Admit every waiting boot, and others that the edge holds, oldest first."""
        new = [
            (holding.boot, holding)
            for holding in listing
            if (holding.last >= holding.first or holding.last + 1 == holding.first > 0)
            and not self._is_admitted(line.site, line.asset, holding.boot)
        ]
        listed = {boot for boot, _ in new}
        # A known boot that is no longer held is older than those that are.
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
        line: AssetRuns,
        boot: str,
        holding: Holding | None,
        answered: bool,
        now_s: float,
        change: Change,
    ) -> None:
        run = line.waiting.pop(boot, None) or Run(line.site, line.asset, boot, since_s=now_s)
        run.ack_version = line.ack_version if holding is None else holding.ack_version
        self._runs[line.site, line.asset, boot] = run
        run.number, self._next_number = self._next_number, self._next_number + 1
        if line.runs:
            line.runs[-1].followed = True
            run.earlier = line.runs[-1]
        line.runs.append(run)
        change.touched[run] = None
        earliest = min(run.held, default=None)
        if holding is not None:
            run.told = max(run.told, holding.last)
            first = holding.first if earliest is None else min(holding.first, earliest)
        else:
            first = (earliest or 0) if answered else 0
        if first > 0:
            lose(run, 0, first - 1, "the edge no longer holds it", change)
        change.held += [(run, sequence, held.payload) for sequence, held in run.held.items()]
        if run.missing() is not None:
            run.worried = False
            self._worry(run, now_s)

    def _close_finished(self, line: AssetRuns, change: Change) -> None:
        """Close each boot that is whole and has a successor; let the successor flow."""
        for run in line.runs:
            if run.closed:
                continue
            run.flows = True
            release_held(run, change)
            if run.followed and run.gone:
                while (hole := run.missing()) is not None:
                    lose(run, *hole, "the edge no longer holds it", change)
                    release_held(run, change)
            if not run.followed or run.missing() is not None:
                return
            if run.told >= run.next:
                lose(run, run.next, run.told, "the edge did not give it", change)
            run.closed, run.flows = True, False
            run.calm()
            change.touched[run] = None
