"""What twins of elements know beside their rows is kept, found and replaced with them."""

import numpy as np
import pytest

from twin_server.history.details import Detail
from twin_server.history.states import blank
from twin_server.persist import (
    DetailRow,
    EventRow,
    FeatureRow,
    RunRow,
    StateRow,
    TwinRow,
    WriteBatch,
    open_store,
)

FRAME = TwinRow("lab", "frame", "{}", "{}")


def run_row(number, asset, last):
    return RunRow(number, "lab", asset, f"b{number}", "d", last + 1, last, 0, last, False, "[]")


def feature(number, sequence):
    state = blank(1)
    state["sequence"] = sequence
    return FeatureRow(number, sequence, sequence, float(sequence), b"m", state.tobytes())


def detail(number, sequence, value=0.0, body=None):
    numbers = np.array([[value, value - 1, value + 1], [0.0, -1.0, 1.0]])
    text = b'{"n":%d}' % sequence if body is None else body
    return DetailRow(number, sequence, numbers.tobytes(), text)


def fill(store, count=1200):
    """A twin of elements whose first epochs have no detail, and one without any."""
    store.write(
        WriteBatch(
            runs=[run_row(1, "frame", count - 1), run_row(2, "beam", 3)],
            features=[feature(1, s) for s in range(count)] + [feature(2, s) for s in range(4)],
            details=[detail(1, s, float(s)) for s in range(2, count)],
        )
    )


def test_each_state_comes_with_its_own_detail_and_others_without(store):
    fill(store)
    found = store.history("lab.frame")
    assert found.bodies[:3] == [None, None, b'{"n":2}']
    assert [b for b in found.bodies if b] == [b'{"n":%d}' % s for s in range(2, 1200)]
    assert store.history("lab.beam").bodies == ()
    newest = store.history("lab.frame", limit=2, newest=True)
    assert newest.bodies == [b'{"n":1198}', b'{"n":1199}']


def test_a_thinned_history_shows_the_extremes_of_every_parameter(store):
    fill(store)
    found, bands = store.thinned("lab.frame", 20)
    assert found.states["sequence"].tolist() == sorted({*found.states["sequence"].tolist()})
    assert {2, 1199} <= set(found.states["sequence"].tolist())
    assert found.bodies[-1] == b'{"n":1199}'
    ramp = bands.quantities[:, 4]
    assert (ramp["min"].min(), ramp["max"].max()) == (2.0, 1199.0)
    assert (ramp["lo"].min(), ramp["hi"].max()) == (1.0, 1200.0)
    assert ramp["count"].sum() == 1198
    plain, bands = store.thinned("lab.beam", 2)
    assert plain.bodies == ()
    assert bands.quantities.shape[1] == 4


def test_estimating_anew_replaces_details_and_forgetting_takes_them_along(store):
    fill(store, 5)
    state = blank(1).tobytes()
    anew = [StateRow(1, s, state, Detail(b"", b'{"anew":%d}' % s)) for s in (0, 3)]
    event = EventRow(0, "lab", "frame", 1, None, True, "{}")
    store.rewrite("lab.frame", iter(anew), lambda: (FRAME, [event]))
    assert store.history("lab.frame").bodies == [b'{"anew":0}', None, None, b'{"anew":3}', None]
    store.write(WriteBatch(twins=[FRAME]))
    assert store.delete("lab.frame")
    with store._reading() as reader:
        assert reader.execute("select count(*) from details").fetchone() == (0,)


def test_the_digest_sees_every_byte_of_a_detail(database):
    def digest(name, body):
        store = open_store(database(name))
        cut = WriteBatch(runs=[run_row(1, "frame", 0)], features=[feature(1, 0)])
        if body is not None:
            cut.details = [detail(1, 0, body=body)]
        store.write(cut)
        found = store.digest("lab.frame")[0]
        store.close()
        return found

    assert digest("1", b"{}") == digest("2", b"{}")
    assert len({digest("3", b"{}"), digest("4", b"{ }"), digest("5", None)}) == 3


@pytest.mark.parametrize("limit", [1, 3])
def test_details_follow_a_limited_question(store, limit):
    fill(store, 10)
    found = store.history("lab.frame", after=(1, 4), limit=limit)
    assert found.bodies == [b'{"n":%d}' % s for s in range(5, 5 + limit)]
