"""A server that cannot prove its database signs nothing, says so, and works on."""

import contextlib
import shutil
import time

import pytest

from slowtime_services.credentials import make_key
from tests.twin_server.persist.ledger_audit import forging
from twin_server.persist import SqliteStore, TwinRow, WriteBatch, audit_file
from twin_server.pipeline import Pipeline
from twin_server.pipeline.ingestion import ledger_signer
from twin_server.settings import TwinSettings


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("house")
    public = make_key(folder / "ledger.pem")
    return forging.build(folder / "twin.sqlite", folder / "ledger.pem"), public


@pytest.fixture
def house(sound, tmp_path):
    path = tmp_path / "twin.sqlite"
    shutil.copyfile(sound[0].database, path)
    return forging.House(path, sound[0].key, sound[0].kept, sound[0].old, sound[0].known)


@pytest.fixture
def store(house):
    with contextlib.closing(forging.open_unverified(house.database)) as opened:
        yield opened


def forge_event(house):
    [row] = forging.forge(house, forging.edit, forging.BY_NAME["events"])
    assert row[1] == "lab.beam"


@pytest.fixture
def forged(house):
    """The store of a server, after an event was forged while it was stopped."""
    forge_event(house)
    with contextlib.closing(forging.open_unverified(house.database)) as opened:
        yield opened


def test_a_server_with_a_forged_database_refuses_and_tells_the_twin_concerned(house, forged):
    settings = TwinSettings(ledger={"key": house.key})
    with contextlib.closing(SqliteStore(house.database.with_name("other.sqlite"))) as other:
        fresh = Pipeline(settings, other)
        assert fresh.gauges()["ledger_refused"] == 0
    signer = forging.signer_of(forged, house.key)
    assert signer.refusal
    assert "lab.beam: the row of events with number 1" in signer.refusal
    told = signer.take_unsaid()
    assert told.keys() == {"lab.beam"}
    assert "yard" not in told["lab.beam"]
    assert "restore the last backup" in told["lab.beam"]
    assert signer.take_unsaid() == {}
    assert signer.sign(2 * 10**18) is None


def test_the_pipeline_keeps_the_refusal_as_an_alarm_of_the_twin(house, forged, monkeypatch):
    monkeypatch.setattr(Pipeline, "_load", lambda self: setattr(self, "_twins", {}))
    pipeline = Pipeline(TwinSettings(ledger={"key": house.key}), forged)
    said = []
    monkeypatch.setattr(pipeline, "_note", lambda *words: said.append(words))
    pipeline._stale = False
    pipeline._sign_ledger()
    pipeline._sign_ledger()
    [(twin, kind, severity, message, _)] = said
    assert (twin, kind, severity) == ("lab.beam", "ledger_refused", "alarm")
    assert "not signed any more" in message
    assert pipeline.gauges()["ledger_refused"] == 1


def test_an_operator_may_go_on_behind_the_last_head_and_audits_say_so(house, sound):
    forge_event(house)
    for number, refused in ((2, True), (3, False)):
        with contextlib.closing(forging.open_unverified(house.database)) as opened:
            signer = forging.signer_of(opened, house.key, continue_after_head=number)
            assert bool(signer.refusal) == refused
            assert (signer.sign(2 * 10**18) is None) == refused
    for _ in range(2):  # and once more, without being asked to
        with contextlib.closing(forging.open_unverified(house.database)) as opened:
            signer = forging.signer_of(opened, house.key)
            assert not signer.refusal
            opened.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", "more")]))
            assert signer.sign(3 * 10**18) is not None
    assert audit_file(house.database, public=sound[1]).wrong == []
    against_old = audit_file(house.database, public=sound[1], kept=house.kept)
    assert any("chained anew" in what for what in against_old.wrong)


def test_rows_that_a_server_without_the_key_wrote_are_not_signed(house):
    with contextlib.closing(forging.open_unverified(house.database)) as opened:
        opened.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", "more")]))
    with contextlib.closing(forging.open_unverified(house.database)) as opened:
        assert "carry no seal of this key" in forging.signer_of(opened, house.key).refusal


def test_a_chain_that_is_rewritten_under_the_server_is_found_at_the_next_signature(
    house, store
):
    signer = forging.signer_of(store, house.key)
    store.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", "more")]))
    with store._writing() as writer:
        ledger = forging.BY_NAME["ledger"]
        row = [one for one in forging._read(writer, ledger) if one[0] == "lab.beam"][-1]
        forging.remove(writer, ledger, row)
        forging.put(writer, ledger, (*row[:2], forging.other_value(row[2]), row[3]))
    assert signer.sign(2 * 10**18) is None
    assert "not those that this server chained" in signer.refusal


def test_a_row_that_is_changed_under_the_server_is_found_by_the_next_audit(house, store):
    signer = forging.signer_of(store, house.key, audit_every_s=0.05)
    forging.forge_open(house, store, forging.edit, forging.BY_NAME["events"])
    until = time.monotonic() + 60.0
    while not signer.refusal and time.monotonic() < until:
        signer.step()
        time.sleep(0.02)
    assert "the row of events" in signer.refusal
    signer.close()


class Elsewhere:
    """A witness in memory."""

    failures = 0

    def __init__(self, last):
        self.last, self.took = last, []

    def take(self, head):
        self.took.append(head)

    def close(self):
        """Nothing is on its way."""


def test_a_database_that_lacks_a_head_of_the_witness_is_not_signed(house, store):
    from slowtime_services.clock import HandClock
    from slowtime_services.credentials import Signer
    from twin_server.settings import LedgerSettings

    def begun(last):
        witness = Elsewhere(last)
        signer = ledger_signer.LedgerSigner(
            store, HandClock(10**18), Signer.read(house.key), LedgerSettings(),
            lambda *_: None, witness,
        )  # fmt: skip
        return signer, witness

    assert "has another there" in begun(house.kept._replace(root="ab" * 32))[0].refusal
    signer, witness = begun(house.kept)
    store.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", "more")]))
    assert witness.took == [] or not signer.refusal
    head = signer.sign(2 * 10**18)
    assert witness.took == [head]
