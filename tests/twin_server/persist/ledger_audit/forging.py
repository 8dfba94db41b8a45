"""A database that uses every table, and whoever rewrites it, checksums and tallies and all."""

import dataclasses

import numpy as np

from slowtime_services.clock import HandClock
from slowtime_services.credentials import Signer
from slowtime_services.ledger import Head
from tests.twin_server.persist.tables.test_levels import cut_of, states_of
from twin_server.events.asset_events import AssetEventRow
from twin_server.events.deliveries import AlarmAcknowledgement, Delivery
from twin_server.persist import (
    CompositeRow,
    DetailRow,
    DiagnosisRow,
    EventRow,
    FatigueRow,
    OutlookRow,
    PostgresStore,
    SqliteStore,
    TwinRow,
    WriteBatch,
    is_url,
)
from twin_server.persist.tables.checksums import TABLES, SqlTable
from twin_server.persist.tables.quarantine import AsideRow
from twin_server.pipeline.ingestion.ledger_signer import LedgerSigner
from twin_server.settings import LedgerSettings

SITES = {"lab.beam": 1, "yard.mast": 2}
"""Twins of two sites, and the number of the boot of each."""

BY_NAME = {table.name: table for table in TABLES}
TURNS = ((490, 530), (1_010, 1_030), (1_530, 1_550))
"""Sequences of each turn; between them hashes of the history are kept."""


@dataclasses.dataclass
class House:
    """A database under three heads, and rows that no head covers yet.

    Parameters
    ----------
    kept
        The second head.
    old
        Rows of each table at the first head.
    known
        Rows of each table at the second head.
    """

    database: object
    key: object
    kept: Head | None
    old: dict[str, list[tuple[object, ...]]]
    known: dict[str, list[tuple[object, ...]]]


def open_unverified(database):
    """Open a database as a forger does, who does not care for checksums."""
    if is_url(database):
        return PostgresStore(database, verify=False)
    return SqliteStore(database, verify=False, synchronous="NORMAL")


def signer_of(store, key, **settings):
    return LedgerSigner(
        store, HandClock(10**18), Signer.read(key), LedgerSettings(**settings), lambda *_: None
    )


def build(database, key, turns=3):
    """Write all tables in turns, sign a head after each, and write what no head covers."""
    store = open_unverified(database)
    signer, seen, heads = signer_of(store, key), [], []
    for turn in range(turns):
        _write_turn(store, turn)
        heads.append(signer.sign(10**18 + turn))
        seen.append({table.name: rows_of(store, table) for table in TABLES})
    _write_turn(store, turns, behind=True)
    store.close()
    return House(database, key, heads[min(1, turns - 1)], seen[0], seen[min(1, turns - 1)])


def _write_turn(store, turn, *, behind=False):
    for twin, number in SITES.items():
        site, asset = twin.split(".")
        t_ns, name = 10**9 * (turn + 1), f"{twin}-{turn}"
        cut = WriteBatch()
        if not behind:
            first, last = TURNS[turn]
            states = states_of(np.arange(first, last), seed=number + turn)
            cut = cut_of(number, states, asset=asset)
            cut.runs = [run._replace(site=site) for run in cut.runs]
            cut.details = [
                DetailRow(number, n, np.full(3, float(n)).tobytes(), b"{}%d" % n)
                for n in range(first, first + 3)
            ]
        cut.twins = [TwinRow(site, asset, "{}", f'{{"turn":{turn}}}')]
        cut.events = [
            EventRow(0, site, asset, t_ns + k, None, bool(k), f'{{"kind":"note{k}"}}')
            for k in range(2)
        ]
        cut.held = [(number, 9_000 + 10 * turn + k, b"held%d" % k) for k in range(2)]
        cut.released = [(number, 9_000)] if turn == 1 else []
        cut.deliveries = [
            _delivery(f"{name}-{k}@ops", twin, t_ns, "waiting", k) for k in range(2)
        ]
        if turn:
            cut.settled = [_delivery(f"{twin}-0-0@ops", twin, t_ns, "delivered", turn)]
        cut.acknowledgements = [
            AlarmAcknowledgement(f"{name}-{k}", twin, t_ns, "ann", "ann", f"seen {k}")
            for k in range(2)
        ]
        cut.asset_events = [
            AssetEventRow(twin, f"{name}-{k}", 2 * turn + k + 1, t_ns, "ann", f'{{"k":{k}}}')
            for k in range(2)
        ]
        store.write(cut)
        number = store.add_diagnosis(DiagnosisRow(0, twin, t_ns, None, "queued", "{}"), 20)
        done = DiagnosisRow(number, twin, t_ns, t_ns + 9, "done", "{}", "", '{"found":1}')
        store.end_diagnosis(done, b"<p>%d" % number, "model: 1")
        store.set_aside(
            [AsideRow(0, twin, "b", k, t_ns, "key", "why", True, False, b"m%d" % k)
             for k in (2 * turn, 2 * turn + 1)]
        )  # fmt: skip
        store.add_composites(
            [CompositeRow(0, f"{site}-all", t_ns + k, "ann", f'{{"k":{k}}}') for k in range(2)]
        )
        store.add_fatigue(
            [FatigueRow(twin, "b1", hour, turn, t_ns, b"%d" % turn) for hour in (0, turn + 1)]
        )
        for k in range(2):
            store.add_outlook(
                OutlookRow(twin, number << 40 | 2 * turn + k, 2.0 * turn + k, "{}"), 8
            )


def _delivery(name, twin, t_ns, state, tries):
    return Delivery(
        name, twin, "ops", name[:-4], "alarm", "alarm", 0, 0.0, state, tries, 1, t_ns, 0, "",
        '{"kind":"alarm"}',
    )  # fmt: skip


def rows_of(store, table):
    """All rows of a table, without checksums."""
    with store._reading() as reader:
        return _read(reader, table)


def _read(reader, table):
    question = f"select {', '.join(table.columns)} from {table.name} order by {table.key}"
    return [tuple(row) for row in reader.execute(question).fetchall()]


KEYS = {
    "twins": "id", "deliveries": "id", "acknowledgements": "event", "numbers": "what",
    "asset_events": "twin event",
}  # fmt: skip
"""Columns of the key, where they are not those of the order."""


def keys_of(table: SqlTable) -> list[str]:
    return KEYS.get(table.name, table.key.replace(",", "")).split()


def _where(table, row):
    at = table.columns.index
    keys = keys_of(table)
    return " and ".join(f"{name} = ?" for name in keys), tuple(row[at(name)] for name in keys)


def remove(writer, table, row):
    where, key = _where(table, row)
    writer.execute(f"delete from {table.name} where {where}", key)


def put(writer, table, row):
    names = table.all_columns
    writer.execute(
        f"insert into {table.name} ({', '.join(names)}) values ({','.join('?' * len(names))})",
        table.sealed(row),
    )


def other_value(value):
    """A value of the same type."""
    if isinstance(value, bytes):
        return value[:-1] + bytes([value[-1] ^ 1])
    if isinstance(value, str):
        return value + "x"
    return 7 if value is None else value + 1


def with_column(table, row, name, value):
    at = table.columns.index(name)
    return (*row[:at], value, *row[at + 1 :])


def candidates(house, writer, table):
    """Rows that were there at the head that was kept, and still are."""
    now = set(_read(writer, table))
    found = [row for row in house.known[table.name] if row in now]
    if table.name in ("twins", "runs", "numbers"):  # written again since
        found = sorted(now)
    return found


def edit(house, writer, table, column=None):
    others = [name for name in table.columns if name not in keys_of(table)]
    row = candidates(house, writer, table)[0]
    if table.name == "deliveries":
        row = next(one for one in candidates(house, writer, table) if one[8] == "waiting")
    column = column or others[-1]
    remove(writer, table, row)
    put(
        writer,
        table,
        with_column(table, row, column, other_value(row[table.columns.index(column)])),
    )
    return [row]


def delete(house, writer, table):
    row = candidates(house, writer, table)[0]
    remove(writer, table, row)
    return [row]


def insert(house, writer, table):
    row = candidates(house, writer, table)[-1]
    taken = {_where(table, one)[1] for one in _read(writer, table)}
    name = keys_of(table)[-1]
    at = table.columns.index(name)
    while _where(table, row)[1] in taken:
        row = with_column(table, row, name, other_value(row[at]))
    if table.name == "runs":
        row = with_column(table, row, "boot", "another")
    put(writer, table, row)
    return [row]


def swap(house, writer, table):
    rows = candidates(house, writer, table)
    one = rows[0]
    keys = keys_of(table)
    at = [table.columns.index(name) for name in keys]
    content = [k for k in range(len(table.columns)) if k not in at]

    def differs(row):
        return any(row[k] != one[k] for k in content)

    other = next(row for row in rows[1:] if differs(row))

    def exchanged(row, source):
        return tuple(row[k] if k in at else source[k] for k in range(len(row)))

    for row in (one, other):
        remove(writer, table, row)
    put(writer, table, exchanged(one, other))
    put(writer, table, exchanged(other, one))
    return [one, other]


def old_copy(house, writer, table):
    """Put the rows of the first head in the place of those of today."""
    gone = _read(writer, table)
    writer.execute(f"delete from {table.name}")
    for row in house.old[table.name]:
        put(writer, table, row)
    return gone


ACTS = (edit, delete, insert, swap, old_copy)


def forge(house, act, table, **more):
    """Do something behind the server's back; return the rows that it concerned."""
    store = open_unverified(house.database)
    try:
        with store._writing() as writer:
            return act(house, writer, table, **more)
    finally:
        store.close()


def forge_open(house, store, act, table):
    """Do something through the connection of a server that runs, and chain nothing."""
    with store._writing() as writer:
        return act(house, writer, table)


def owners_of(table, rows):
    """Chains that rows belong to."""
    at = {name: place for place, name in enumerate(table.columns)}
    found = set()
    for row in rows:
        if "twin" in at:
            found.add(row[at["twin"]])
        elif table.name == "twins":
            found.add(row[0])
        elif table.name == "composites":
            found.add(f"composite:{row[1]}")
        elif table.name in ("features", "details", "digests", "levels", "held"):
            key = row[at["id"]] >> 40 if "id" in at else row[at["number"]]
            found.add({number: twin for twin, number in SITES.items()}.get(key, ""))
    return found
