"""Work of one message: bounded by its size, whatever it says."""

import logging

import pytest

from benchmarks.processes.hostile_work import MOST_SINGLE, MOST_TOTAL, compared, counted
from twin_server.persist import FeatureRow, RunRow, SqliteStore, WriteBatch


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
