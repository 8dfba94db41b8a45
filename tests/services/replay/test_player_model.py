"""The player of a recording as a state machine: pace, window, acknowledgements, requests, stop.

The model keeps what was published and what a twin has confirmed. Whatever the twin confirms or
asks for, messages are published once and in their order, no more than the window is under way
while the twin answers, and nothing that was not played is given or counted as confirmed.
"""

import itertools
import json
import tempfile
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Acknowledgement, Features, Quality
from slowtime_schemas.streams import ACK, FEATURES, request_key
from slowtime_services import replay as replay_package
from slowtime_services.bus import MemoryBus, Query
from slowtime_services.clock import HandClock
from slowtime_services.feature_runs import run_and_sequence
from slowtime_services.record import RecordingWriter
from slowtime_services.replay import (
    RecordedMessage,
    contents,
    feature_holdings,
    player,
    read_recording,
)
from slowtime_services.replay.feature_holdings import RunFeatures
from tests.state_machines import assert_found, run_long, run_share, steps_in

FOLDER = Path(replay_package.__file__).parent
WINDOW, PATIENCE_S, MOST_AT_ONCE = 4, 1.0, 6
STEPS = 1_500
"""Lines of publishing one message, reminders of the three runs included."""
STEPS_OF_ANSWER = 4_000
"""Lines of an answer, for which the recording of sixty features is read again."""
RECORDED = range(3, 43, 2)
"""Sequences of each run."""
RUNS = (("beam", "b1"), ("beam", "b2"), ("fan", "f1"))


def recording():
    """Write sixty features of three runs, some out of order, some twice."""
    path = Path(tempfile.mkdtemp(prefix="player-model-")) / "one.mcap"
    order = [(run, n) for n in range(20) for run in RUNS]
    order[10], order[13] = order[13], order[10]
    order.insert(30, order[12])
    with RecordingWriter(path) as writer:
        for place, ((asset, boot), n) in enumerate(order):
            message = Features(
                site="lab", asset=asset, boot=boot, sequence=RECORDED[n], t_ns=place,
                start_ns=0, slow_time=0.0, method="none", modes=(), quality=Quality(samples=1),
            )  # fmt: skip
            writer.write(FEATURES, "lab", asset, encode(message), 10**9 + place * 10**8)
    return path


PATH = recording()


def numbered(message):
    """Return asset and boot, and the sequence, of a features message."""
    known = run_and_sequence(message.key, message.payload)
    assert known is not None
    return known[0][1:], known[1]


class Waits(threading.Condition):
    """A condition on which time passes at once, and the twin has its say."""

    def __init__(self, machine):
        super().__init__()
        self.machine = machine

    def wait(self, timeout=None):
        self.machine.passes(timeout or 0.0)
        return True


class PlayerMachine(RuleBasedStateMachine):
    """One replay to a twin that may be slow, mute, mistaken or curious."""

    def __init__(self):
        super().__init__()
        self.mended = pytest.MonkeyPatch()
        self.now_s, self.saves = 0.0, 0
        self.mended.setattr(player, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        self.mended.setattr(feature_holdings, "MOST_AT_ONCE", MOST_AT_ONCE)
        self.bus = MemoryBus(clock=HandClock())
        self.heard = list[bytes]()
        self.bus.subscribe(
            FEATURES.everywhere, lambda sample: self.heard.append(sample.payload)
        )
        self.own = MemoryBus(joins=self.bus, clock=HandClock())
        self.player = player._Player(PATH, self.own, WINDOW, PATIENCE_S, threading.Event())
        self.player._changed = Waits(self)
        self.stage = self.player.on_stage(contents(PATH))
        self.stage.__enter__()
        self.messages = list(read_recording(PATH))
        self.place, self.confirmed = 0, dict.fromkeys(RUNS, -1)
        self.finished = False

    def teardown(self):
        self.stage.__exit__(None, None, None)
        self.bus.close()
        self.mended.undo()

    def sequences(self, run):
        """Sequences of a run that have been published, ascending."""
        return sorted(
            {n for own, n in map(numbered, self.messages[: self.place]) if own == run}
        )

    def passes(self, seconds):
        """Time passes; a twin that is only slow confirms what it has by then."""
        self.now_s += max(seconds, 0.001)
        if self.saves > 0:
            self.saves -= 1
            for run in RUNS:
                if had := self.sequences(run):
                    self.say(run, had[-1])

    def say(self, run, sequence):
        asset, boot = run
        ack = Acknowledgement(site="lab", asset=asset, boot=boot, sequence=sequence, t_ns=0)
        self.bus.publish(ACK.key("lab", asset), encode(ack), encoding=ACK.encoding)
        had = self.sequences(run)
        if run in self.confirmed and had:
            self.confirmed[run] = max(self.confirmed[run], min(sequence, had[-1]))

    def outstanding(self):
        """Features up to the newest that was published, which are not confirmed."""
        return sum(
            self.confirmed[run] < n <= max(self.sequences(run), default=-1)
            for run in RUNS
            for n in RECORDED
        )

    @rule(count=st.integers(1, 6), saves=st.integers(0, 3))
    def play(self, count, saves):
        self.saves = saves
        for message in self.messages[self.place : self.place + count]:
            with steps_in(FOLDER) as steps:
                self.player.publish(message)
            self.place += 1
            assert steps.count <= STEPS
            if self.player._believes and not self.player.stop.is_set():
                # One that came before its time stands for the one that it passed, too.
                assert self.outstanding() <= WINDOW + 1
        self.saves = 0

    @rule(
        run=st.sampled_from((*RUNS, ("beam", "strange"), ("mast", "m1"))),
        sequence=st.sampled_from([0, 3, 4, 5, 9, 20, 41, 42, 2**39, 2**40 - 1]),
    )
    def confirm(self, run, sequence):
        self.say(run, sequence)

    @rule(
        run=st.sampled_from(RUNS),
        first=st.sampled_from([0, 3, 8, 30, 41, 2**62]),
        last=st.sampled_from([0, 3, 8, 30, 41, 2**40, 2**62]),
    )
    def ask_again(self, run, first, last):
        asset, boot = run
        parameters = {"boot": boot, "first": str(first), "last": str(last)}
        with steps_in(FOLDER) as steps:
            found = list(self.player._again(query(asset, "features", parameters)))
        assert steps.count <= STEPS_OF_ANSWER
        given = [numbered(RecordedMessage(0, 0, key, payload)) for key, payload in found]
        assert all(own == run for own, _ in given)
        # One that was passed by a later one may be given before it is played.
        newest = max(self.sequences(run), default=-1)
        known = [n for n in RECORDED if first <= n <= min(last, newest)]
        assert [n for _, n in given] == known[:MOST_AT_ONCE]

    @rule(asset=st.sampled_from(["beam", "fan", "mast"]))
    def ask_account(self, asset):
        told = [
            json.loads(text) for _, text in self.player._account(query(asset, "account", {}))
        ]
        for entry in told:
            assert entry["last"] == self.sequences((asset, entry["boot"]))[-1]
        assert len(told) == sum(run[0] == asset and bool(self.sequences(run)) for run in RUNS)

    @rule()
    def stop(self):
        self.player.stop.set()

    @rule()
    def finish(self):
        before_s = self.now_s
        self.player.finish([FEATURES])
        assert self.now_s - before_s <= 4 * PATIENCE_S
        self.finished = True

    @rule(speed=st.sampled_from([1e-3, 1.0, 1e6]))
    def pace(self, speed):
        """The rest is played at some speed, on a clock of its own, and is stopped at once."""
        clock, stop = HandClock(), threading.Event()
        rest = iter(self.messages[self.place :])
        paced = player._paced(rest, speed, clock, stop)
        taken = list(itertools.islice(paced, 3))
        assert taken == self.messages[self.place : self.place + 3]
        if len(taken) > 1:
            lasts_s = (taken[-1].log_ns - taken[0].log_ns) / 1e9 / speed
            assert abs(clock.now_ns() / 1e9 - lasts_s) < 0.2
        stop.set()
        assert not list(paced)

    @invariant()
    def what_was_played_was_heard_once_and_in_order(self):
        assert self.heard == [m.payload for m in self.messages[: self.place]]

    @invariant()
    def the_account_is_that_of_the_model(self):
        assert self.player._outstanding == self.outstanding()
        played = self.player.played(0.0)
        confirmed = sum(n <= self.confirmed[run] for run in RUNS for n in RECORDED)
        assert played.acknowledged == confirmed
        assert played.features == 60
        assert played.complete == (confirmed == 60 and not self.player.stop.is_set())


def query(asset, what, parameters):
    """Return the question to one asset."""
    return Query(request_key("lab", asset, what), parameters)


@pytest.mark.gate
def test_a_replay_is_in_order_within_its_window_and_counts_what_was_confirmed():
    run_share(PlayerMachine, examples=25)


@pytest.mark.long
def test_a_replay_holds_for_as_long_as_is_asked():
    assert run_long(PlayerMachine) > 0


def _believe_all(self, sample):
    ack = json.loads(sample.payload)
    for run, holding in self._holdings.items():
        if run.boot == ack["boot"]:
            holding.acknowledged = max(holding.acknowledged, ack["sequence"])


@pytest.mark.gate
@pytest.mark.parametrize(
    ("where", "name", "fault"),
    [
        (player._Player, "_hear", _believe_all),
        (player._Player, "_wait_reminding", lambda self, condition: None),
        (RunFeatures, "up_to", lambda self, sequence: len(self.sequences)),
        (player, "features_again", lambda *given: [m.payload for m in read_recording(PATH)]),
    ],
)
def test_the_machine_finds_a_planted_fault(monkeypatch, where, name, fault):
    monkeypatch.setattr(where, name, fault)
    assert_found(PlayerMachine, examples=25)
