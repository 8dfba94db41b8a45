"""The account of the features that each boot of each edge has sent, and of those missing.

Features of a boot are numbered from 0. They are let through in that order, boot after boot; one
that comes early is held, one that comes twice refused. What is missing is asked for again (see
`EdgeQuery`), and passed over only once it is known that nobody has it any more.

The account does no I/O and has no clock: the seconds are arguments, and what follows from each
call is written into a `StoreChange`, for the pipeline to make durable. What one message costs
does not depend on the numbers in it, nor on how many boots or features came before it.
"""

from collections import Counter
from collections.abc import Iterable, Sequence

from slowtime_schemas.messages import ACK_VERSION, FOREIGN_ACKS, Features, Health
from twin_server.settings import BackfillSettings

from .asset_runs import AssetRuns
from .boots import BootLimits, admit, close_finished, has_room, leave_behind
from .changes import StoreChange
from .evidence import correct
from .held import Arrival
from .rivals import contest, look_for_rivals, look_for_survivor, tell_agents_apart
from .runs import MAX_JUMP, EdgeQuery, Holding, Run
from .sequence import accept, conclude_hole, refusal_of, release_held, skip

OTHERS_TAKEN = "an agent holds other readings than those that were taken in"

MAX_BOOTS = 10_000
"""Boots of one asset, unless settings say otherwise."""


class Account:
    """The features that every asset has sent, and those that are missing.

    Parameters
    ----------
    settings
        When to ask and when to give up.
    max_jump
        How far a sequence may be ahead of the one expected.
    max_boots
        How many boots one asset may have.
    alone
        Whether there is no edge to ask: then a boot is let in as it comes.
    """

    def __init__(
        self,
        settings: BackfillSettings,
        *,
        max_jump: int = MAX_JUMP,
        max_boots: int = MAX_BOOTS,
        alone: bool = False,
    ) -> None:
        self._settings = settings
        self._limits = BootLimits(max_boots, alone, max_jump)
        self._lines: dict[tuple[str, str], AssetRuns] = {}
        self._of_site: Counter[str] = Counter()
        self._uneasy: dict[tuple[str, str], AssetRuns] = {}
        self._asked: dict[tuple[str, str], AssetRuns] = {}
        self.corrections = StoreChange()
        """What was corrected of restored runs, to be stored and reported."""

    def restore(self, runs: Iterable[Run], next_number: int) -> None:
        """Restore runs that were made durable before, in the order of their numbers."""
        for run in runs:
            line = self._line(run.site, run.asset)
            run.reach = self._limits.reach(replayed=False)
            correct(run, self.corrections)
            run.interrupt(run.next)
            run.floor = run.lost[-1][1] + 1 if run.lost else 0
            line.add(run)
            line.follow(run)
            self._uneasy[run.site, run.asset] = line
        for line in self._lines.values():
            if line.unfinished:
                line.unfinished[0].flows = True
        self._limits.next_number = next_number

    def forget(self, site: str, asset: str) -> list[int]:
        """Delete all runs of an asset, and return their numbers.

        Only the presence of its edge is kept.
        """
        line = self._line(site, asset)
        numbers = [run.number for run in line.known.values() if run.number]
        line.clear()
        line.inquire = line.alive
        line.ease()
        self._uneasy[site, asset] = line
        return numbers

    def take(self, arrivals: Iterable[Arrival], now_s: float, change: StoreChange) -> None:
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
            line = self._line(features.site, features.asset)
            run = line.known.get(features.boot)
            if run is None:
                run = self._meet(line, features.boot, arrival.replayed, now_s, change)
                if run is None:
                    continue
            if run.flows and features.sequence == run.next:
                accept(run, arrival, change)
                if run.held or run.followed:
                    release_held(run, change)
                    if run.followed:
                        close_finished(line, change)
            else:
                self._put_aside(line, run, arrival, now_s, change)

    def hear(
        self, healths: Iterable[tuple[Health, bool]], now_s: float, change: StoreChange
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
            line = self._line(health.site, health.asset)
            run = line.known.get(health.boot)
            if not replayed:
                line.ack_version = health.counters.get(ACK_VERSION, 1)
                self._hear_of_foreign_acks(line, health, now_s)
            if run is None:
                if health.last_sequence < 0:
                    continue
                run = self._meet(line, health.boot, replayed, now_s, change)
                if run is None:
                    continue
            if not replayed:
                run.ack_version = line.ack_version
                tell_agents_apart(run, health, change)
                look_for_survivor(line, run, health, change)
            self._hear_of_end(line, run, health.last_sequence, now_s, change)
            if 0 <= health.first_held < run.next:
                run.held_from = health.first_held
                # The edge still holds durable features: the acknowledgement did not reach it.
                change.touched[run] = None

    def disbelieve(self, refused: Iterable[tuple[Features, str]]) -> None:
        """Note features refused for their sensor time, so that giving them up is reported."""
        for features, reason in refused:
            line = self._lines.get((features.site, features.asset))
            run = None if line is None else line.known.get(features.boot)
            if run is not None and run.next <= features.sequence <= run.horizon:
                run.disbelieved.add(features.sequence, reason)

    def _hear_of_end(
        self, line: AssetRuns, run: Run, last: int, now_s: float, change: StoreChange
    ) -> None:
        """Note the newest sequence that an agent states of a boot."""
        if last <= run.horizon < run.forgotten:
            # What it stated far ahead, and did not deliver, says nothing of the true end.
            run.told = run.forgotten = -1
        if last <= run.told:
            return
        run.told = last
        if run.told > run.horizon:
            change.refused.append(
                (
                    "stated_sequence",
                    f"{run}: a newest sequence of {last} was stated, and {run.next} is "
                    f"expected. Allowed: up to {run.reach:,} ahead, or what the agent's "
                    "account lists and the agent delivers. Nothing is counted as lost by it.",
                )
            )
        if run.next <= run.told and not run.closed:
            self._worry(line, run, now_s)

    def _hear_of_foreign_acks(self, line: AssetRuns, health: Health, now_s: float) -> None:
        """Ask an agent that received another's acknowledgements which boot they concern."""
        foreign = health.counters.get(FOREIGN_ACKS, 0)
        # Each answer is compared with what is stored; not so often that others wait for it.
        due = now_s - line.inquired_s >= self._settings.max_backoff_s or not line.foreign_acks
        if foreign and foreign != line.foreign_acks and due:
            line.inquire, line.inquired_s = True, now_s
            line.ease()
            self._uneasy[line.site, line.asset] = line
            line.foreign_acks = foreign

    def watch(self, site: str, asset: str, *, alive: bool) -> None:
        """Note that an edge has appeared or disappeared."""
        if not alive and (site, asset) not in self._lines:
            return
        line = self._line(site, asset)
        line.alive = alive
        if alive:
            line.spooled = True
            line.inquire = True
            line.ease()
            self._uneasy[site, asset] = line
        elif not line.known:
            self._drop(line)

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
        change: StoreChange,
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
        boots_before = len(line.known) - len(line.waiting)
        line.busy = False
        self._asked.pop((want.site, want.asset), None)
        self._uneasy[want.site, want.asset] = line
        certain = sound and listing is not None and (bool(listing) or line.alive)
        if listing:
            line.spooled = True
        if listing is not None and (line.waiting or line.inquire):
            self._conclude_account(line, listing, certain, now_s, change)
        run = line.known.get(want.boot)
        if run is not None and run.number and not run.closed:
            # Of an agent that keeps an account, no answer at all says nothing about a hole: its
            # token may be back a moment before its answers are, after the router was away.
            told = certain and (bool(listing) or not line.spooled)
            conclude_hole(
                run, want, listing or (), told, line.spooled, now_s, self._settings, change
            )
        close_finished(line, change)
        fruitful = len(line.known) - len(line.waiting) > boots_before
        fruitful |= run is not None and run.last >= want.first and bool(want.boot)
        line.note_answer(fruitful, now_s, self._settings)

    def still_missing(self, want: EdgeQuery) -> bool:
        """Whether the first requested feature is still missing."""
        line = self._lines.get((want.site, want.asset))
        run = None if line is None else line.known.get(want.boot)
        hole = None if run is None or run.closed else run.missing()
        return hole is not None and hole[0] <= want.first

    def give_up(self, change: StoreChange) -> None:
        """Stop waiting: admit boots that wait and skip every hole.

        For a source that has ended and can be asked for nothing, such as a recording that
        was read straight into the pipeline.
        """
        for line in self._lines.values():
            while line.waiting:
                admit(line, (), self._limits, 0.0, change)
            for run in line.unfinished:
                run.flows = True
                release_held(run, change)
                while (hole := run.missing()) is not None:
                    skip(run, hole, "it cannot be asked for", change)
            close_finished(line, change)

    @property
    def holes(self) -> int:
        """Number of boots with missing features."""
        return sum(
            1
            for line in self._unsettled
            for run in tuple(line.unfinished)
            if run.missing() is not None
        )

    @property
    def held(self) -> int:
        """Number of features held out of order."""
        return sum(len(run.held) for line in self._unsettled for run in line.not_closed())

    @property
    def held_bytes(self) -> int:
        """Bytes of the features held out of order."""
        return sum(line.held_bytes.total for line in list(self._lines.values()))

    @property
    def boots(self) -> int:
        """Number of boots that are remembered, of all assets."""
        return sum(len(line.known) for line in list(self._lines.values()))

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

    def knows(self, site: str, asset: str) -> bool:
        """Whether anything was heard of an asset."""
        return (site, asset) in self._lines

    def assets_of(self, site: str) -> int:
        """Count the assets of a site that anything was heard of."""
        return self._of_site[site]

    def _line(self, site: str, asset: str) -> AssetRuns:
        line = self._lines.get((site, asset))
        if line is None:
            line = self._lines[site, asset] = AssetRuns(site, asset)
            self._of_site[site] += 1
        return line

    def _drop(self, line: AssetRuns) -> None:
        """Forget an asset of which there is nothing but that its edge was there."""
        del self._lines[line.site, line.asset]
        self._uneasy.pop((line.site, line.asset), None)
        self._of_site[line.site] -= 1
        if not self._of_site[line.site]:
            del self._of_site[line.site]

    def _meet(
        self, line: AssetRuns, boot: str, replayed: bool, now_s: float, change: StoreChange
    ) -> Run | None:
        """Note a new boot; its edge is asked for other features before the boot is admitted."""
        if not has_room(line, boot, self._limits, change):
            return None
        run = Run(line.site, line.asset, boot, since_s=now_s, ack_version=line.ack_version)
        run.reach = self._limits.reach(replayed=replayed)
        line.replayed = replayed
        line.add(run)
        line.waiting[boot] = run
        self._uneasy[line.site, line.asset] = line
        line.ease()
        if self._limits.alone:
            admit(line, (), self._limits, now_s, change)
        return run

    def _put_aside(
        self, line: AssetRuns, run: Run, arrival: Arrival, now_s: float, change: StoreChange
    ) -> None:
        sequence = arrival.features.sequence
        refusal = refusal_of(run, arrival, line.held_bytes, self._settings)
        if refusal is not None:
            change.refused.append(refusal)
            look_for_rivals(line, run, arrival, refusal[0], change)
            change.touched[run] = None
            if refusal[0] == "sequence_jump" and sequence > run.told:
                run.told = sequence
                self._worry(line, run, now_s)
            return
        run.hold(arrival)
        if run.number:
            change.held.append((run, sequence, arrival.payload))
            change.touched[run] = None
            change.early += 1
        self._worry(line, run, now_s)

    def _worry(self, line: AssetRuns, run: Run, now_s: float) -> None:
        if not run.worried:
            run.worried, run.since_s = True, now_s
            run.due_s = now_s + self._settings.grace_s
        self._uneasy[run.site, run.asset] = line

    def _conclude_account(
        self,
        line: AssetRuns,
        listing: Sequence[Holding],
        certain: bool,
        now_s: float,
        change: StoreChange,
    ) -> None:
        if not listing and line.waiting and not line.impatient(certain, now_s, self._settings):
            line.put_off(now_s, self._settings)
            return
        line.inquire = False
        line.ease()
        for holding in listing:
            known = line.known.get(holding.boot)
            if known is None or not known.number:
                continue
            known.ack_version = holding.ack_version
            known.held_from, known.held_to = holding.first, holding.last
            if holding.withheld and not known.contested:
                contest(known, OTHERS_TAKEN, change)
            if not known.closed:
                told = known.told
                self._hear_of_end(line, known, holding.last, now_s, change)
                if known.told != told:
                    # Durable together with the boots let in after it: a server that starts
                    # again would close it as whole.
                    change.touched[known] = None
            if known.closed and holding.last >= known.next and not known.rivalled:
                leave_behind(known, holding, change)
            if holding.last < known.next:
                change.touched[known] = None  # it keeps what is durable: it is told again
        admit(line, listing, self._limits, now_s, change)
