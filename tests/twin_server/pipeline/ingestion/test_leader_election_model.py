"""The leader's claim as a state machine: several servers, and tokens that come late or twice.

Once all tokens have been delivered, no two servers that may have an asset in common
acknowledge, and the one that was first does. A server that leads keeps leading when others
come that have heard of it, whatever their clocks say.
"""

import itertools
from pathlib import Path

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, rule

from slowtime_schemas.streams import server_key
from slowtime_services.bus import MemoryBus
from slowtime_services.clock import HandClock
from slowtime_services.shards import Share
from tests.state_machines import assert_found, run_long, run_share, steps_in
from twin_server.pipeline.ingestion import leader_election
from twin_server.pipeline.ingestion.leader_election import LeaderElection

FILE = Path(leader_election.__file__)
STEPS = 100
"""Lines of an operation that are not of the tokens it looks at."""
STEPS_PER_TOKEN = 12

SHARES = (None, None, Share(0, 2), Share(1, 2), Share(0, 3))
CLOCKS = (0, 1, 10**18, 10**18 + 1, 2 * 10**18, 2**63 - 1)
FOREIGN = (
    "99999999999999999999-ffffff-far-ahead",
    "9" * 5_000 + "-ffffff-host",
    "-1-ffffff-host",
    "garbage",
    "00000000000000000000-" + "a" * 60_000,
    "00000000000000000000-000000-" + "a" * 300,
    "00000000000000000000-000000-host.1of" + "2" * 5_000,
)
"""Tokens that no server makes."""
LAST = f"{2**63 + 2**62 - 1:020d}-ffffff-host"
"""Name of the last instant that a name may have: nobody can be later."""


class Delivery:
    """A bus that only carries tokens; each watcher is told of each key in its order."""

    def __init__(self):
        self.tokens = {}
        self.watchers = {}
        self.waiting = []  # (watcher, key, alive)

    def announce(self, owner, key):
        self.tokens[key] = owner
        self.tell(key, True)

    def withdraw(self, key):
        if self.tokens.pop(key, None) is not None:
            self.tell(key, False)

    def tell(self, key, alive):
        self.waiting += [(watcher, key, alive) for watcher in self.watchers]

    def watch(self, watcher, callback):
        self.watchers[watcher] = callback
        self.waiting += [(watcher, key, True) for key in self.tokens]

    def leave(self, watcher):
        self.watchers.pop(watcher, None)
        self.waiting = [one for one in self.waiting if one[0] != watcher]

    def deliver(self, place, *, twice=False):
        watcher, key, _ = self.waiting[place % len(self.waiting)]
        first = next(i for i, one in enumerate(self.waiting) if one[:2] == (watcher, key))
        _, _, alive = self.waiting.pop(first)
        for _ in range(1 + twice):
            self.watchers[watcher](key, alive)

    def deliver_all(self, watcher=None):
        while any(watcher in (None, one[0]) for one in self.waiting):
            self.deliver(
                next(i for i, one in enumerate(self.waiting) if watcher in (None, one[0]))
            )


class Endpoint(MemoryBus):
    """The bus as one server sees it."""

    def __init__(self, delivery):
        super().__init__()
        self.delivery, self.announced = delivery, None

    def watch(self, expression, callback):
        assert expression == server_key("*")
        self.delivery.watch(self, callback)
        return _Handle(lambda: self.delivery.leave(self))

    def announce(self, key):
        self.delivery.announce(self, key)
        self.announced = key
        return _Handle(lambda: self.delivery.withdraw(key))


class _Handle:
    def __init__(self, close):
        self.close = close


class Server:
    """One twin server, as far as it is elected."""

    def __init__(self, delivery, number, share, now_ns):
        self.number, self.share, self.clock = number, share, HandClock(now_ns)
        self.endpoint = Endpoint(delivery)
        self.election = LeaderElection(self.endpoint, self.clock, share)
        self.election.start()

    @property
    def announced(self):
        return self.endpoint.announced

    def competes(self, other):
        mine, theirs = self.share, other.share
        return mine is None or theirs is None or mine.count != theirs.count or mine == theirs


class ElectionMachine(RuleBasedStateMachine):
    """Servers that come, go, are killed, and hear of each other in any order."""

    servers = Bundle("servers")

    def __init__(self):
        super().__init__()
        leader_election.logger.disabled = True
        self.delivery, self.count = Delivery(), itertools.count()
        self.running = []
        self.last_is_taken = False

    def teardown(self):
        self.all_is_delivered()
        leader_election.logger.disabled = False

    def bounded(self):
        return _Bounded(STEPS + STEPS_PER_TOKEN * (len(self.delivery.tokens) + 1))

    @rule(target=servers, share=st.sampled_from(SHARES), now_ns=st.sampled_from(CLOCKS))
    def start(self, share, now_ns):
        server = Server(self.delivery, next(self.count), share, now_ns)
        self.running.append(server)
        return server

    @rule(target=servers, share=st.sampled_from(SHARES), now_ns=st.sampled_from(CLOCKS))
    def join(self, share, now_ns):
        """Start beside servers of which it hears before it announces itself."""
        server = self.start(share, now_ns)
        self.step_of_one_who_has_heard_all(server)
        return server

    @rule(server=servers, move_ns=st.sampled_from([0, 1, 10**9, -(10**17)]))
    def step(self, server, move_ns):
        server.clock.set_ns(min(max(0, server.clock.now_ns() + move_ns), 2**63 - 1))
        with self.bounded():
            server.election.step()

    @rule(server=servers)
    def step_of_one_who_has_heard_all(self, server):
        """Whoever leads goes on leading: the newcomer's name is greater than those it heard."""
        self.delivery.deliver_all(server.endpoint)
        leading = [s for s in self.running if s.election.acknowledges]
        is_new = server.announced is None and not self.last_is_taken
        with self.bounded():
            server.election.step()
        for leader in leading if is_new else ():
            if leader.competes(server):
                assert server.announced > leader.announced

    @rule(place=st.integers(0, 1_000), twice=st.booleans())
    def deliver(self, place, twice):
        if self.delivery.waiting:
            with self.bounded():
                self.delivery.deliver(place, twice=twice)

    @rule(server=consumes(servers))
    def end(self, server):
        with self.bounded():
            server.election.stop()
        self.running.remove(server)

    @rule(server=consumes(servers))
    def kill(self, server):
        """It says nothing more; its tokens go."""
        self.delivery.leave(server.endpoint)
        self.running.remove(server)
        if server.announced:
            self.delivery.withdraw(server.announced)

    @rule(which=st.integers(0, len(FOREIGN) - 1))
    def announce_what_no_server_is_called(self, which):
        self.delivery.announce(self, server_key(FOREIGN[which]))

    @rule()
    def announce_the_last_name(self):
        self.last_is_taken = True
        self.delivery.announce(self, server_key(LAST))

    @rule()
    def all_is_delivered(self):
        with _Bounded(STEPS_PER_TOKEN * 40 * (1 + len(self.delivery.waiting))):
            self.delivery.deliver_all()
        named = [server for server in self.running if server.announced]
        leading = [server for server in named if server.election.acknowledges]
        for one, other in itertools.combinations(leading, 2):
            assert not one.competes(other)
        if named:
            first = min(named, key=lambda server: server.announced)
            assert first.election.acknowledges
        for server in named:
            assert len(server.election.trouble) < 300
            earlier = any(
                s.announced < server.announced and s.competes(server)
                for s in named
                if s is not server
            )
            assert server.election.acknowledges != earlier


class _Bounded:
    """Asserts that what is done within takes no more lines than it may."""

    def __init__(self, most):
        self.most = most

    def __enter__(self):
        self.watch = steps_in(FILE)
        self.steps = self.watch.__enter__()

    def __exit__(self, kind, error, trace):
        self.watch.__exit__(kind, error, trace)
        if kind is None:
            assert self.steps.count <= self.most


@pytest.mark.gate
def test_of_all_servers_that_share_an_asset_one_acknowledges():
    run_share(ElectionMachine, examples=150)


@pytest.mark.long
def test_an_election_holds_for_as_long_as_is_asked():
    assert run_long(ElectionMachine) > 0


def _forgets_nobody(self, key, alive):
    return None if not alive else _SEE(self, key, alive)


_SEE = LeaderElection._see


@pytest.mark.gate
@pytest.mark.parametrize(
    ("where", "name", "fault"),
    [
        (leader_election, "_began", lambda name: 0),
        (leader_election, "_compete", lambda one, other: one == other),
        (LeaderElection, "_see", _forgets_nobody),
        (leader_election, "_is_claim", lambda name: True),
        (LeaderElection, "first", property(lambda self: None)),
    ],
)
def test_the_machine_finds_a_planted_fault(monkeypatch, where, name, fault):
    monkeypatch.setattr(where, name, fault)
    assert_found(ElectionMachine, examples=150)


def test_false_claims_without_end_take_bounded_memory_and_end_with_their_tokens(monkeypatch):
    monkeypatch.setattr(leader_election, "MOST_EARLIER", 20)
    with MemoryBus() as bus, MemoryBus(joins=bus) as other:
        false = [
            other.announce(server_key(f"{number:020d}-ffffff-host")) for number in range(200)
        ]
        election = LeaderElection(bus, HandClock(10**18))
        election.start()
        for token in false:
            election.step()
            assert len(election._others) <= 20
            assert not election.acknowledges
            token.close()
        election.step()
        assert election.acknowledges
        election.stop()
