"""A stateful model of the account: edges, a bus that drops, restarts, and numbers that lie.

The model knows what honest boots have made and what their edge still holds; it judges each
step by what must hold whatever happened: order is kept, nothing is taken in twice, a true
reading is lost only where its edge no longer holds it, false numbers are never lost, memory is
bounded, and a step takes no more lines of Python than its messages allow.
"""

import sys
from collections.abc import Callable, Iterable
from types import FrameType
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
)

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Health
from slowtime_schemas.quantities import SEQUENCES
from tests.twin_server.conftest import _features
from twin_server.collect import Account, Arrival, EdgeQuery, Holding, Run, StoreChange
from twin_server.settings import BackfillSettings

MAX_JUMP = 3_000
MAX_BOOTS = 12
HEALING = BackfillSettings(
    grace_s=0.5, backoff_s=0.5, max_backoff_s=2.0, tries=2, foreign_patience_s=3.0,
    absent_patience_s=1e6, max_held=30,
)  # fmt: skip
ORIGIN_NS = 1_767_225_600_000_000_000

LINES_AT_LEAST = 600
LINES_OF_ONE = 400
"""Lines of Python that a step may take, and for each message, listed boot, or reading that is
released by it; measured: at most 311 and 205."""

FAR = SEQUENCES - 1
hostile_numbers = st.one_of(
    st.sampled_from([MAX_JUMP, MAX_JUMP + 1, 10**3, 2**31, 2**32, 2**39, FAR - 1, FAR]),
    st.integers(0, FAR),
)


class Boot:
    """A boot of the honest edge: what it has made, and what it still holds."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.made = 0
        self.first_held = 0
        self.gone = False

    def held(self) -> range:
        return range(0) if self.gone else range(self.first_held, self.made)


class AccountMachine(RuleBasedStateMachine):
    """An account that hears an honest asset, `beam`, and a hostile one, `liar`."""

    account_class: type[Account] = Account

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0
        self.boots: list[Boot] = []
        self.order: list[tuple[str, int]] = []
        self.lost: set[tuple[str, int]] = set()
        self.rows: dict[int, tuple[Any, ...]] = {}
        self.held_rows: dict[tuple[int, int], bytes] = {}
        self.runs: dict[int, Run] = {}
        self.excused: set[tuple[str, int]] = set()
        self.liars = 0
        self.account = self._new()

    def _new(self) -> Account:
        return self.account_class(HEALING, max_jump=MAX_JUMP, max_boots=MAX_BOOTS)

    # What honest and hostile edges do

    @initialize()
    def begin(self) -> None:
        self.account.watch("lab", "beam", alive=True)
        self.boots.append(Boot("b0"))

    @precondition(lambda self: len(self.boots) < MAX_BOOTS)
    @rule()
    def restart_edge(self) -> None:
        self.boots.append(Boot(f"b{len(self.boots)}"))
        self.account.watch("lab", "beam", alive=False)
        self.account.watch("lab", "beam", alive=True)

    @rule(count=st.integers(1, 8), data=st.data())
    def make_readings(self, count: int, data: st.DataObject) -> None:
        """Make some, of which some arrive, in any order and some twice."""
        boot = self.boots[-1]
        new = list(range(boot.made, boot.made + count))
        boot.made += count
        arriving = data.draw(st.lists(st.sampled_from(new), max_size=2 * count))
        self._take([self._reading("beam", boot.name, s) for s in arriving])

    @rule()
    def tell_end(self) -> None:
        boot = self.boots[-1]
        held = boot.held()
        self._hear("beam", boot.name, boot.made - 1, held[0] if held else -1)

    @rule(kept=st.integers(0, 5))
    def forget_acknowledged(self, kept: int) -> None:
        """Let the edge delete what is durable, but for the newest."""
        for boot in self.boots:
            run = self._run(boot.name)
            if run is not None:
                boot.first_held = max(boot.first_held, min(run.next, boot.made) - kept)

    @rule(data=st.data())
    def lose_spool(self, data: st.DataObject) -> None:
        """Let the edge lose the older part of a boot's spool, acknowledged or not."""
        boot = data.draw(st.sampled_from(self.boots))
        first = data.draw(st.integers(boot.first_held, boot.made))
        self.excused |= {(boot.name, s) for s in range(boot.first_held, first)}
        boot.first_held = first

    @rule(number=hostile_numbers, boot=st.integers(0, 30))
    def lie_in_features(self, number: int, boot: int) -> None:
        self._take([self._reading("liar", f"x{boot}", number)])

    @rule(number=hostile_numbers, first=hostile_numbers, boot=st.integers(0, 30))
    def lie_in_health(self, number: int, first: int, boot: int) -> None:
        self._hear("liar", f"x{boot}", number, first)

    @rule(number=hostile_numbers)
    def lie_of_the_honest_boot(self, number: int) -> None:
        """State a false end of the honest asset's own boot, far beyond what is believed."""
        boot = self.boots[-1]
        run = self._run(boot.name)
        if number > boot.made + 10 * MAX_JUMP and run is not None:
            self._hear("beam", boot.name, number, -1)

    @rule(reading=st.integers(0, 3))
    def send_ordinary_of_liar(self, reading: int) -> None:
        """Let the hostile asset send an ordinary reading too."""
        self._take([self._reading("liar", "x0", self.liars + reading)])
        run = self._run("x0", "liar")
        self.liars = 0 if run is None else run.next

    # What the server does

    @rule(seconds=st.sampled_from([0.1, 1.0, 5.0]), listing=st.data())
    def ask(self, seconds: float, listing: st.DataObject) -> None:
        self.now_s += seconds
        for want in self.account.wants(self.now_s):
            if want.asset == "beam":
                self._answer_honestly(want)
            else:
                self._answer_with_lies(want, listing)

    @rule()
    def restart_server(self) -> None:
        """Start again from what was made durable."""
        self.account = self._new()
        restored = [self._restored(number, row) for number, row in sorted(self.rows.items())]
        self.account.restore(restored, max(self.rows, default=0) + 1)
        self.runs = {run.number: run for run in restored}
        found, self.account.corrections = self.account.corrections, StoreChange()
        self._store(found)
        self.account.watch("lab", "beam", alive=True)

    def _answer_honestly(self, want: EdgeQuery) -> None:
        listing = None
        if want.boot:
            boot = next(b for b in self.boots if b.name == want.boot)
            given = [s for s in boot.held() if want.first <= s <= want.last]
            self._take([self._reading("beam", boot.name, s) for s in given])
        if not want.boot or self.account.still_missing(want):
            listing = [
                Holding(b.name, b.first_held, b.made - 1)
                for b in self.boots
                if b.made and not b.gone and b.made - 1 >= b.first_held - 1
            ]
        self._settle(want, listing)

    def _answer_with_lies(self, want: EdgeQuery, listing: st.DataObject) -> None:
        number = listing.draw(hostile_numbers)
        if want.boot and listing.draw(st.booleans()):
            self._take([self._reading("liar", want.boot, number)])
        kind = listing.draw(
            st.sampled_from(["none", "silent", "all", "far", "damaged", "many"])
        )
        boot = want.boot or "x0"
        listings: dict[str, list[Holding] | None] = {
            "none": None,
            "silent": [],
            "all": [Holding(boot, 0, number)],
            "far": [Holding(boot, number, number)],
            "damaged": [Holding(boot, 0, number, tuple((n, n + 1) for n in range(0, 300, 3)))],
            "many": [Holding(f"y{n}", number, number) for n in range(100)],
        }
        self._settle(want, listings[kind], sound=listing.draw(st.booleans()))

    # How the account is called, measured and stored

    def _take(self, arrivals: list[Arrival]) -> None:
        self._step(lambda c: self.account.take(arrivals, self.now_s, c), len(arrivals))

    def _hear(self, asset: str, boot: str, last: int, first: int) -> None:
        health = Health(
            site="lab", asset=asset, boot=boot, sequence=0, t_ns=ORIGIN_NS, last_sequence=last,
            first_held=first, uptime_s=0.0,
        )  # fmt: skip
        self._step(lambda c: self.account.hear([(health, False)], self.now_s, c), 1)

    def _settle(
        self, want: EdgeQuery, listing: list[Holding] | None, *, sound: bool = True
    ) -> None:
        entries = sum(1 + len(holding.damaged) for holding in listing or ())
        self._step(
            lambda c: self.account.settle(want, listing, self.now_s, c, sound=sound),
            1 + entries,
        )

    def _step(self, act: Callable[[StoreChange], None], messages: int) -> None:
        change = StoreChange()
        lines = _lines_of(lambda: act(change))
        released = len(change.released) + len(change.lost) + len(change.refused)
        allowed = LINES_AT_LEAST + LINES_OF_ONE * (messages + released)
        assert lines <= allowed, f"{lines} lines for {messages} messages"
        self._store(change)

    def _store(self, change: StoreChange) -> None:
        for ordered in change.ordered:
            if ordered.run.asset == "beam":
                key = (ordered.run.boot, ordered.features.sequence)
                assert key not in self.order, f"{key} was taken in twice"
                self.order.append(key)
        for lost in change.lost:
            assert lost.last - lost.first <= 2**32, "a range of false numbers is lost"
            if lost.run.asset == "beam":
                assert lost.last < self._boot(lost.run.boot).made, f"{lost} was never made"
                self.lost |= {(lost.run.boot, s) for s in range(lost.first, lost.last + 1)}
        for run, sequence, payload in change.held:
            self.held_rows[run.number, sequence] = payload
        for run, sequence in change.released:
            self.held_rows.pop((run.number, sequence), None)
        for run in change.touched:
            if run.number:
                self.runs[run.number] = run
                self.rows[run.number] = (
                    run.asset, run.boot, run.next, run.last, run.last_t_ns, run.told,
                    run.closed, tuple(run.lost),
                )  # fmt: skip

    def _restored(self, number: int, row: tuple[Any, ...]) -> Run:
        asset, boot, following, last, last_t_ns, told, closed, lost = row
        run = Run(
            "lab", asset, boot, number=number, next=following, last=last, last_t_ns=last_t_ns,
            told=told, closed=closed, lost=list(lost),
        )  # fmt: skip
        for (owner, sequence), payload in self.held_rows.items():
            if owner == number:
                message = Features.model_validate_json(payload)
                run.held[sequence] = Arrival(message, payload)
        return run

    def _reading(self, asset: str, boot: str, sequence: int) -> Arrival:
        t_ns = ORIGIN_NS + sequence * 10**6
        message = _features(sequence, asset=asset, boot=boot, t_ns=t_ns)
        return Arrival(message, encode(message))

    def _run(self, boot: str, asset: str = "beam") -> Run | None:
        found = (r for r in self.runs.values() if (r.asset, r.boot) == (asset, boot))
        return next(found, None)

    def _boot(self, name: str) -> Boot:
        return next(boot for boot in self.boots if boot.name == name)

    # What must hold

    @invariant()
    def order_is_kept(self) -> None:
        places = [(int(boot[1:]), sequence) for boot, sequence in self.order]
        assert places == sorted(places)

    @invariant()
    def only_what_no_edge_holds_is_lost(self) -> None:
        unexcused = (
            self.lost
            - self.excused
            - {(boot.name, s) for boot in self.boots for s in range(boot.first_held)}
        )
        assert not unexcused, f"{sorted(unexcused)} are lost, and the edge holds them"
        assert not self.lost & set(self.order)

    @invariant()
    def memory_is_bounded(self) -> None:
        assert self.account.boots <= 2 * MAX_BOOTS
        assert self.account.held <= 2 * MAX_BOOTS * HEALING.max_held
        assert all(len(run.lost) <= 256 for run in self.runs.values())

    def teardown(self) -> None:
        """In the end all that the honest edge holds is taken in."""
        for _ in range(60):
            self.now_s += 2.0
            for want in self.account.wants(self.now_s):
                if want.asset == "beam":
                    self._answer_honestly(want)
                else:
                    self._settle(want, [])
            boot = self.boots[-1] if self.boots else None
            if boot is not None and boot.made:
                self.tell_end()
        self.order_is_kept()
        self.only_what_no_edge_holds_is_lost()
        taken = set(self.order)
        made: Iterable[tuple[str, int]] = (
            (boot.name, s) for boot in self.boots for s in boot.held()
        )
        left = [key for key in made if key not in taken]
        assert not left, f"{left} are held by the edge, and were never taken in"


def _lines_of(function: Callable[[], None]) -> int:
    lines = 0

    def local(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal lines
        lines += event == "line"
        return local

    before = sys.gettrace()
    sys.settrace(lambda frame, event, argument: local)
    try:
        function()
    finally:
        sys.settrace(before)
    return lines
