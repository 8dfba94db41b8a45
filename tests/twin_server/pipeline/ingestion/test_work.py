"""Work of one message: bounded by its size, whatever it says."""

import collections
import logging

import pytest

from benchmarks.processes.hostile_work import MOST_SINGLE, MOST_TOTAL, compared, counted
from twin_server.persist import FeatureRow, RunRow, SqliteStore, WriteBatch
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

ASSETS = 200
"""Assets that send one message each in a batch."""
LEARNT = 21
"""Messages of each before: the nominal is learnt from the first twenty."""
MOST_OTHERS = 10
"""Statements of such a batch beside a row and a block of the ledger for each message."""
MOST_LOG_BYTES = 16_000
"""Of the write-ahead log for each of them: rows of assets lie apart, each on a page of 4 kB,
and pages are split."""


@pytest.mark.long
def test_hostile_messages_take_no_more_work_than_ordinary_ones(caplog):
    caplog.set_level(logging.CRITICAL)
    lines, _ = compared(400, timed=False)
    assert lines.total <= MOST_TOTAL, lines
    assert lines.single <= MOST_SINGLE, lines


@pytest.mark.parametrize("leap", [10**3, 10**7, 2**39])
def test_a_leap_of_the_sequence_is_not_walked_through_where_it_is_stored(tmp_path, leap):
    from twin_server.history.states import blank

    store = SqliteStore(tmp_path / "twin.sqlite", synchronous="NORMAL")
    state = blank(1).tobytes()

    def write(sequence):
        run = RunRow(1, "lab", "beam", "b1", "s", sequence + 1, sequence, 1, -1, False, "[]")
        feature = FeatureRow(1, sequence, sequence, 0.0, b"{}", state)
        store.write(WriteBatch(runs=[run], features=[feature]))
        return 0

    for sequence in range(20):
        write(sequence)
    _, near = counted(lambda: write(20 + 8))
    _, far = counted(lambda: write(leap))
    assert far < 4 * near + 2_000
    store.close()


def test_a_message_of_each_of_many_assets_writes_its_row_and_a_block(
    tmp_path, features, sample
):
    store = SqliteStore(tmp_path / "twin.sqlite", synchronous="NORMAL")
    pipeline = Pipeline(TwinSettings(database=tmp_path / "twin.sqlite"), store)

    def take(sequence):
        messages = (features(sequence, asset=f"a{n}") for n in range(ASSETS))
        pipeline.ingest(map(sample, messages))

    for sequence in range(LEARNT):
        take(sequence)
    statements: collections.Counter[str] = collections.Counter()
    ground = store._ground
    assert ground is not None
    store._writer.set_trace_callback(lambda text: statements.update([text.split("(")[0]]))
    with ground.changing():
        store._writer.execute("pragma wal_checkpoint(truncate)").fetchone()
    take(LEARNT)
    written = ground.log_bytes
    store._writer.set_trace_callback(None)
    assert pipeline.counts["accepted"] == (LEARNT + 1) * ASSETS
    inserted = {text.split()[2] for text in statements if text.startswith("insert")}
    assert inserted == {"features", "ledger"}
    others = [n for text, n in statements.items() if not text.startswith("insert")]
    assert sum(others) <= MOST_OTHERS
    assert 0 < written <= MOST_LOG_BYTES * ASSETS
    store.close()
