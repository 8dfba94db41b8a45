"""What a server left undone that ended: suspected, set aside, released and dropped."""

import contextlib

import pytest

from twin_server import estimate as estimators
from twin_server.history.states import SET_ASIDE
from twin_server.persist import MARKED, FileNote, SqliteStore, open_store
from twin_server.pipeline import Pipeline, QuarantineDesk
from twin_server.pipeline.progress import Attempts, Suspicion, isolation
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError
from twin_server.settings import ProgressSettings, TwinSettings

POISON = 7


class Killed(BaseException):
    """Stands for the end of the process."""


@pytest.fixture
def note(tmp_path):
    with contextlib.closing(FileNote(tmp_path / "note")) as found:
        yield found


def unfinished(note, payloads, *, marked=False):
    """Leave a note as a process does that ends while it works on messages."""
    with contextlib.suppress(Killed), Attempts(note).noted(payloads):
        left = note.read()
        raise Killed
    note.write(MARKED + left[1:] if marked else left)


def test_messages_of_an_unfinished_batch_are_worked_alone_until_one_of_them_ends_the_server(
    note,
):
    unfinished(note, [b"a", b"b", b"c"])
    attempts = Attempts(note)
    assert [attempts.suspicion(p) for p in (b"a", b"b", b"c", b"d")] == [1, 1, 1, 0]
    with attempts.noted([b"a"]):
        pass  # it was innocent
    unfinished(note, [b"b"])
    attempts = Attempts(note)
    assert [attempts.suspicion(p) for p in (b"a", b"b", b"c")] == [
        Suspicion.NONE, Suspicion.UNTRIED, Suspicion.ALONE,
    ]  # fmt: skip
    with attempts.noted([b"b"]):
        pass
    assert attempts.suspicion(b"b") is Suspicion.UNTRIED
    unfinished(note, [b"b"])
    assert Attempts(note).suspicion(b"b") is Suspicion.REFUSED


def test_a_message_that_was_alone_when_the_server_stood_still_is_not_tried_again(note):
    unfinished(note, [b"a"], marked=True)
    assert Attempts(note).suspicion(b"a") is Suspicion.UNTRIED


def test_several_messages_are_not_condemned_together(note):
    unfinished(note, [b"a", b"b"], marked=True)
    assert Attempts(note).suspicion(b"a") is Suspicion.ALONE


def test_a_batch_that_ends_leaves_no_suspicion_and_a_damaged_note_none_either(note):
    with Attempts(note).noted([b"a"]):
        pass
    assert not Attempts(note).some
    unfinished(note, [b"a"])
    note.write(b"?" * len(note.read()))
    assert not Attempts(note).some


def test_messages_that_were_held_are_noted_when_their_turn_comes(note):
    attempts = Attempts(note)
    left = b""
    with attempts.noted([b"a"]), attempts.noted_too([b"a", b"held"]):
        left = note.read()
    note.write(left)
    assert Attempts(note).suspicion(b"held") is Suspicion.ALONE


class Server:
    """A pipeline on a database that is killed whenever it estimates the poisonous message."""

    def __init__(self, store, monkeypatch):
        self.store, self.left = store, b""
        self.sizes: list[int] = []

        def fatal(twins, features, *rest):
            if any(f.asset == "bad" and f.sequence == POISON for f in features):
                self.sizes.append(len(features))
                self.left = store.attempts.read()
                raise Killed
            return estimators.estimate(twins, features, *rest)

        monkeypatch.setattr(isolation, "estimate", fatal)

    def start(self, **settings):
        return Pipeline(TwinSettings(**settings), self.store)

    def run(self, samples, *, marked=False):
        """Take messages in; where the server is killed, its note stays as it was."""
        pipeline = self.start()
        try:
            pipeline.ingest(samples)
        except Killed:
            self.store.attempts.write(MARKED + self.left[1:] if marked else self.left)
            return None
        return pipeline


@pytest.fixture
def store(database):
    with contextlib.closing(open_store(database("twin"))) as opened:
        yield opened


def mixed(ageing):
    return [m for pair in zip(ageing(20), ageing(20, asset="bad"), strict=True) for m in pair]


def test_the_message_that_ends_the_server_is_found_by_two_ends_and_all_others_are_taken(
    store, ageing, sample, monkeypatch
):
    server = Server(store, monkeypatch)
    samples = [*map(sample, mixed(ageing))]
    assert server.run(samples) is None
    assert server.run(samples) is None
    pipeline = server.run(samples)
    assert server.sizes[0] > 1
    assert server.sizes[1:] == [1]
    assert store.count("lab.beam") == store.count("lab.bad") == 20
    (row,) = store.aside()
    assert (row.twin, row.sequence, row.accepted) == ("lab.bad", POISON, True)
    assert pipeline.gauges()["aside"] == 1
    (event,) = [e.body for e in store.events() if "message_set_aside" in e.body]
    assert "the server ended or stood still" in event


def test_a_marked_message_is_set_aside_without_being_tried(store, ageing, sample, monkeypatch):
    server = Server(store, monkeypatch)
    messages = ageing(20, asset="bad")
    assert server.run(map(sample, messages[:POISON])) is not None
    assert server.run([sample(messages[POISON])], marked=True) is None
    assert server.run(map(sample, messages[POISON:])) is not None
    assert len(server.sizes) == 1
    assert [row.sequence for row in store.aside()] == [POISON]
    assert store.count("lab.bad") == 20


@pytest.fixture
def failing(store, ageing, sample, monkeypatch):
    """A server that has set a message aside because it failed on it, and no longer does."""
    with monkeypatch.context() as patched:

        def fragile(twins, features, *rest):
            if any(f.sequence == POISON for f in features):
                raise ArithmeticError("a fault")
            return estimators.estimate(twins, features, *rest)

        patched.setattr(isolation, "estimate", fragile)
        pipeline = Pipeline(TwinSettings(), store)
        pipeline.ingest(map(sample, ageing(20)))
    return pipeline


def test_a_released_message_gives_the_history_that_there_would_have_been(
    store, failing, ageing, sample, tmp_path
):
    with contextlib.closing(SqliteStore(tmp_path / "undisturbed.sqlite")) as undisturbed:
        Pipeline(TwinSettings(), undisturbed).ingest(map(sample, ageing(20)))
        expected = undisturbed.digest("lab.beam")
    assert store.digest("lab.beam") != expected
    desk = QuarantineDesk(failing, store)
    (shown,) = desk.listed("lab.beam")
    assert (shown["sequence"], shown["in_history"]) == (POISON, True)
    desk.release("lab.beam", shown["number"], "ann")
    assert store.digest("lab.beam") == expected
    assert desk.listed("lab.beam") == []
    assert any("message_released" in event.body for event in store.events())


def test_a_message_that_fails_again_stays_aside(store, failing, monkeypatch):
    def fragile(twins, features, *rest):
        raise ArithmeticError("a fault")

    monkeypatch.setattr(isolation, "estimate", fragile)
    before, desk = store.digest("lab.beam"), QuarantineDesk(failing, store)
    with pytest.raises(ProblemError, match="cannot be estimated like this") as refused:
        desk.release("lab.beam", 1, "ann")
    assert refused.value.status == 409
    assert store.digest("lab.beam") == before
    assert len(desk.listed("lab.beam")) == 1


def test_a_dropped_message_leaves_its_place_without_an_estimate_for_good(store, failing):
    desk = QuarantineDesk(failing, store)
    desk.drop("lab.beam", 1, "ann")
    assert desk.listed("lab.beam") == []
    failing.register("lab.beam", Registration(changes="mass"))
    reasons = store.history("lab.beam").states["reasons"]
    assert [n for n, bits in enumerate(reasons) if bits & SET_ASIDE] == [POISON]
    with pytest.raises(ProblemError, match="Aside: none"):
        desk.drop("lab.beam", 1, "ann")


def test_an_asset_with_too_much_aside_is_taken_in_no_longer_and_others_are(
    store, ageing, sample, monkeypatch
):
    def fragile(twins, features, *rest):
        if any(f.asset == "bad" for f in features):
            raise ArithmeticError("a fault")
        return estimators.estimate(twins, features, *rest)

    monkeypatch.setattr(isolation, "estimate", fragile)
    settings = TwinSettings(
        progress=ProgressSettings(max_aside_of_one=5), pipeline={"batch_messages": 2}
    )
    pipeline = Pipeline(settings, store)
    pipeline.ingest(map(sample, mixed(ageing)))
    assert store.count("lab.beam") == 20
    assert store.count("lab.bad") == len(store.aside()) == 5
    assert pipeline.refusals.counts["quarantine_full"] > 0
