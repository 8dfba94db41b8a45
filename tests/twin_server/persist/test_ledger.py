"""Whoever rewrites a database, checksums, chains and hashes and all, is found by its ledger."""

import itertools
import json
import shutil
import sqlite3

import numpy as np
import pytest

from slowtime_services.clock import HandClock
from slowtime_services.credentials import Signer, make_key
from slowtime_services.ledger import Entry, Head, unpacked
from twin_server.events.deliveries import AlarmAcknowledgement
from twin_server.persist import (
    SqliteStore,
    StateRow,
    TwinRow,
    WriteBatch,
    audit_file,
    verify_file,
)
from twin_server.persist.layout import build_levels
from twin_server.persist.tables.checksums import FEATURES, HEADS, RUNS, TWINS
from twin_server.persist.tables.digests import HashedRow, RollingHash, insert_digests, rolled
from twin_server.persist.tables.ledger import ChainEnds, of_features, of_registration
from twin_server.persist.tables.search import whole
from twin_server.pipeline.ingestion.ledger_signer import LedgerSigner
from twin_server.settings import LedgerSettings

from .tables.test_levels import cut_of, states_of

TWINS_OF = ("beam", "mast")
BOOTS = {1: "beam", 2: "mast", 3: "beam"}


class Ticking(HandClock):
    """A clock that goes on by a minute whenever it is asked."""

    def __init__(self):
        super().__init__(1_700_000_000 * 10**9)

    def now_ns(self):
        self.set_ns(super().now_ns() + 60 * 10**9)
        return super().now_ns()


@pytest.fixture(scope="module")
def key(tmp_path_factory):
    path = tmp_path_factory.mktemp("key") / "ledger.pem"
    return path, make_key(path)


@pytest.fixture(scope="module")
def house(tmp_path_factory, key):
    """A database of two twins and three boots, one of which comes late, under eight heads."""
    path = tmp_path_factory.mktemp("house") / "twin.sqlite"
    store = SqliteStore(path)
    signer = LedgerSigner(
        store, Ticking(), Signer.read(key[0]), LedgerSettings(), lambda *_: None
    )
    store.write(WriteBatch(twins=[TwinRow("lab", asset, "{}", "{}") for asset in TWINS_OF]))
    kept = []
    for part in range(8):
        for number in (1, 2, 3) if part != 5 else (3, 2, 1):
            if number == 3 and part < 3:
                continue
            states = states_of(np.arange(20 * part, 20 * part + 20), seed=10 * number + part)
            store.write(cut_of(number, states, asset=BOOTS[number]))
        if part == 4:
            store.write(
                WriteBatch(
                    acknowledgements=[
                        AlarmAcknowledgement("e1", "lab.beam", 7, "ann", "ann", "")
                    ]
                )
            )
        signer.step()
        kept.append(signer.head)
    store.close()
    return path, kept


def check(path, key, kept=None):
    verify_file(path)
    return audit_file(path, public=key[1], kept=kept)


def test_what_nobody_touched_is_as_it_was_accepted(house, key):
    path, heads = house
    found = check(path, key, heads[3])
    assert found.wrong == []
    assert found.notes == []
    assert (found.heads, found.last) == (8, heads[-1])
    # All behind the head that was kept waits for a later one.
    whole = check(path, key)
    assert (whole.waiting, found.against) == (0, heads[3])
    assert 0 < found.waiting == whole.vouched - found.vouched


def change_message(writer, rng):
    key, message = _feature(writer, rng)[::3]
    _put(writer, key, "message", bytes([message[0] ^ 1]) + message[1:])


def change_time(writer, rng):
    key, t_ns = _feature(writer, rng)[:2]
    _put(writer, key, "t_ns", t_ns + 1)


def change_state(writer, rng):
    key, *_, state = _feature(writer, rng)
    at = int(rng.integers(len(state)))
    _put(writer, key, "state", state[:at] + bytes([state[at] ^ 1]) + state[at + 1 :])


def delete(writer, rng):
    writer.execute("delete from features where id = ?", (_feature(writer, rng)[0],))


def delete_the_end_of_a_boot(writer, rng):
    number = int(rng.choice([1, 2, 3]))
    since = (number << 40) + int(rng.integers(100, 159))
    writer.execute(
        "delete from features where id between ? and ?", (since, (number << 40) + 999)
    )


def insert(writer, rng):
    key, t_ns, slow, message, state = _feature(writer, rng)
    there = {row[0] for row in writer.execute("select id from features")}
    free = next(k for k in range(key, key + 500) if k not in there)
    _insert(writer, (free, t_ns, slow, message + b"x", state))


def swap(writer, rng):
    one, other = _feature(writer, rng), _feature(writer, rng)
    while other[3] == one[3]:
        other = _feature(writer, rng)
    _put(writer, one[0], "message", other[3])
    _put(writer, other[0], "message", one[3])


def move_to_another_asset(writer, rng):
    one = _feature(writer, rng)
    number = 2 if one[0] >> 40 != 2 else 1
    writer.execute("delete from features where id = ?", (one[0],))
    _insert(writer, ((number << 40) + 200, *one[1:]))


def exchange_two_boots_assets(writer, rng):
    del rng
    for number, asset in ((1, "mast"), (2, "beam")):
        row = dict(
            zip(
                RUNS.columns,
                writer.execute(
                    f"select {', '.join(RUNS.columns)} from runs where number = ?", (number,)
                ).fetchone(),
                strict=True,
            )
        )
        row |= {"asset": asset, "twin": f"lab.{asset}", "boot": f"x{number}"}
        sealed = RUNS.sealed([row[name] for name in RUNS.columns])
        changed = ", ".join(f"{name} = ?" for name in RUNS.all_columns)
        writer.execute(f"update runs set {changed} where number = ?", (*sealed, number))


def register_otherwise(writer, rng):
    asset = str(rng.choice(TWINS_OF))
    names = ", ".join(TWINS.columns)
    row = writer.execute(
        f"select {names} from twins where id = ?", (f"lab.{asset}",)
    ).fetchone()
    at = TWINS.columns.index("registration")
    sealed = TWINS.sealed((*row[:at], '{"changes":"mass"}', *row[at + 1 :]))
    writer.execute(
        "update twins set registration = ?, crc = ? where id = ?",
        (sealed[at], sealed[-1], row[0]),
    )


FORGERIES = (
    change_message, change_time, change_state, delete, delete_the_end_of_a_boot, insert, swap,
    move_to_another_asset, exchange_two_boots_assets, register_otherwise,
)  # fmt: skip


def _feature(writer, rng):
    count = writer.execute("select count(*) from features").fetchone()[0]
    return writer.execute(
        "select id, t_ns, slow_time, message, state from features order by id limit 1 offset ?",
        (int(rng.integers(count)),),
    ).fetchone()


def _put(writer, key, column, value):
    names = FEATURES.columns
    row = writer.execute(
        f"select {', '.join(names)} from features where id = ?", (key,)
    ).fetchone()
    changed = dict(zip(names, row, strict=True)) | {column: value}
    sealed = FEATURES.sealed([changed[name] for name in names])
    text = ", ".join(f"{name} = ?" for name in FEATURES.all_columns)
    writer.execute(f"update features set {text} where id = ?", (*sealed, key))


def _insert(writer, row):
    names = FEATURES.all_columns
    writer.execute(
        f"insert into features ({', '.join(names)}) values ({','.join('?' * len(names))})",
        FEATURES.sealed(row),
    )


def cover_up(writer):
    """Compute anew all that follows from the rows, chains in the order that they had."""
    before_it = writer.execute("select id, count, sha256 from digests").fetchall()
    kept = {row[0] for row in before_it}
    for table in ("digests", "levels"):
        writer.execute(f"delete from {table}")
    build_levels(writer)
    ends, owed = ChainEnds(), {}
    before = writer.execute("select twin, entries from ledger order by rowid").fetchall()
    writer.execute("delete from ledger")
    for twin in sorted(row[0] for row in writer.execute("select id from twins")):
        rolling, here = RollingHash(), dict[int, Entry]()
        for span in whole(writer, twin):
            rows = writer.execute(
                "select id, t_ns, slow_time, message, state from features "
                "where id between ? and ? order by id",
                (span.first, span.first + 2**40 - 1),
            ).fetchall()
            here |= {
                entry.key: entry for entry in of_features((r[:4] for r in rows), span.boot)
            }
            taken = (HashedRow(key, message, state, None) for key, _, _, message, state in rows)
            insert_digests(
                writer, [one for one in rolled(rolling, taken, span.boot) if one[0] in kept]
            )
        text = writer.execute("select registration from twins where id = ?", (twin,)).fetchone()
        owed[twin] = here, of_registration(text[0])
    # Of a boot that went on behind a later one, a hash was kept that nobody comes by again.
    anew = {row[0] for row in writer.execute("select id from digests").fetchall()}
    insert_digests(writer, [row for row in before_it if row[0] not in anew])
    for twin, block in before:
        here, registration = owed[twin]
        entries = []
        for entry in unpacked(block):
            if entry.kind == "f" and (now := here.pop(entry.key, None)) is not None:
                entries.append(now)
            elif entry.kind != "f":
                entries.append(registration if entry.kind == "r" else entry)
        ends.append(writer, {twin: entries})
    for twin, (here, _) in owed.items():
        ends.append(writer, {twin: list(here.values())})


def forged(house, tmp_path, forgery, seed, *, covered):
    path = tmp_path / f"{forgery.__name__}-{seed}.sqlite"
    shutil.copyfile(house[0], path)
    writer = sqlite3.connect(path, isolation_level=None)
    writer.execute("begin")
    forgery(writer, np.random.default_rng(seed))
    if covered:
        cover_up(writer)
    writer.execute("commit")
    writer.close()
    return path


@pytest.mark.parametrize("covered", [False, True], ids=["left", "covered up"])
@pytest.mark.parametrize("forgery", FORGERIES)
def test_a_forgery_is_found_whatever_is_computed_anew(house, key, tmp_path, forgery, covered):
    found = audit_file(forged(house, tmp_path, forgery, 1, covered=covered), public=key[1])
    # What is put behind all that was signed is said to be vouched for by nobody.
    assert found.wrong or (forgery is insert and covered and found.waiting == 1)


def test_what_is_computed_anew_from_rows_as_they_were_is_as_it_was(house, key, tmp_path):
    def nothing(writer, rng):
        del writer, rng

    found = audit_file(forged(house, tmp_path, nothing, 0, covered=True), public=key[1])
    assert (found.wrong, found.notes, found.waiting) == ([], [], 0)


@pytest.mark.slow
def test_a_thousand_forgeries_are_found(house, key, tmp_path):
    for seed in range(1_000):
        forgery = FORGERIES[seed % len(FORGERIES)]
        path = forged(house, tmp_path, forgery, seed, covered=bool(seed // 10 % 2))
        found = audit_file(path, public=key[1])
        assert found.wrong or (forgery is insert and found.waiting == 1), (forgery, seed)
        path.unlink()


def test_a_cut_end_is_found_by_a_head_that_was_kept(house, key, tmp_path):
    _, heads = house
    cut = tmp_path / "cut.sqlite"
    store_at(cut, key, parts=6)
    assert check(cut, key).wrong == []
    found = audit_file(cut, public=key[1], kept=heads[-1]).wrong
    assert any("kept elsewhere, is not in the ledger" in what for what in found)


def store_at(path, key, parts):
    """The database of `house` as it was after some parts."""
    store = SqliteStore(path)
    signer = LedgerSigner(
        store, Ticking(), Signer.read(key[0]), LedgerSettings(), lambda *_: None
    )
    store.write(WriteBatch(twins=[TwinRow("lab", asset, "{}", "{}") for asset in TWINS_OF]))
    for part in range(parts):
        store.write(cut_of(1, states_of(np.arange(20 * part, 20 * part + 20))))
        signer.step()
    store.close()


def test_heads_of_another_key_are_worth_nothing(house, tmp_path):
    other = make_key(tmp_path / "other.pem")
    found = audit_file(house[0], public=other)
    assert any("not signed with the server's key" in what for what in found.wrong)


def test_what_came_after_the_last_head_is_told_to_wait_for_one(tmp_path, key):
    path = tmp_path / "twin.sqlite"
    store_at(path, key, parts=2)
    store = SqliteStore(path)
    store.write(cut_of(1, states_of(np.arange(40, 47))))
    store.close()
    found = check(path, key)
    assert found.wrong == []
    # Seven features, their states, and the row of their boot.
    assert found.waiting == 7 + 2


@pytest.mark.parametrize("act", ["estimated anew", "deleted and begun again", "late boot"])
def test_what_an_operator_does_is_no_forgery(tmp_path, key, act):
    path = tmp_path / "twin.sqlite"
    store_at(path, key, parts=3)
    store = SqliteStore(path)
    signer = LedgerSigner(
        store, Ticking(), Signer.read(key[0]), LedgerSettings(), lambda *_: None
    )
    if act == "estimated anew":
        twin = TwinRow("lab", "beam", '{"changes":"mass"}', "{}")
        states = states_of(np.arange(60), seed=9)
        rows = [StateRow(1, int(s["sequence"]), s.tobytes()) for s in states]
        store.rewrite("lab.beam", rows, lambda: (twin, []))
    elif act == "deleted and begun again":
        store.delete("lab.beam")
        store.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", "{}")]))
        store.write(cut_of(4, states_of(np.arange(30)), name="b4"))
    else:
        store.write(cut_of(5, states_of(np.arange(10))))
        store.write(cut_of(1, states_of(np.arange(60, 80))))
    before = audit_file(path, public=key[1])
    # Whoever has no key sees it vouched for with the next head.
    assert (before.wrong == []) == (act == "late boot")
    signer.sign(Ticking().now_ns() + 10**18)
    store.close()
    after = check(path, key)
    assert (after.wrong, after.notes, after.waiting) == ([], [], 0)


def head_row(writer, number):
    (body,) = writer.execute("select body from heads where number = ?", (number,)).fetchone()
    return json.loads(body)


def test_a_head_that_was_removed_is_missed(house, key, tmp_path):
    def remove(writer, rng):
        del rng
        writer.execute("delete from heads where number = 4")

    found = audit_file(forged(house, tmp_path, remove, 0, covered=False), public=key[1])
    assert any("head 5 does not follow the one before" in what for what in found.wrong)


def test_leaves_beside_a_head_are_those_that_it_signs(house, key, tmp_path):
    def exchange(writer, rng):
        del rng
        told = head_row(writer, 8)
        told["leaves"][0][1] -= 1
        row = HEADS.sealed((8, told["head"]["t_ns"], json.dumps(told)))
        writer.execute("update heads set body = ?, crc = ? where number = 8", row[2:])

    found = audit_file(forged(house, tmp_path, exchange, 0, covered=False), public=key[1])
    assert any("head 8 vouches for other chains" in what for what in found.wrong)


def test_heads_are_a_chain_and_say_so_in_json(house):
    _, heads = house
    for before, after in itertools.pairwise(heads):
        assert after.previous == before.digest
    assert Head.of(json.loads(json.dumps(heads[0]._asdict()))) == heads[0]
