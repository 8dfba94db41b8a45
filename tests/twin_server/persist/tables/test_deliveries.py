"""Deliveries are kept with their events, begun once, and settled only while they are open."""

import pytest

from twin_server.events.deliveries import AlarmAcknowledgement, Delivery
from twin_server.persist import EventRow, StoreError, WriteBatch

EVENT = EventRow(0, "lab", "beam", 5, None, False, "{}")


def delivery(name, *, receiver="ops", twin="lab.beam", due_ns=10, **more):
    row = Delivery(
        f"{name}@{receiver}", twin, receiver, name, "alarm", "alarm", 0, 0.0, "waiting", 0, 5,
        due_ns, 0, "", '{"message": "x"}',
    )  # fmt: skip
    return row._replace(**more)


def test_an_event_and_its_deliveries_are_kept_together_or_not_at_all(store):
    torn = delivery("a")._replace(body=None)  # refused by the table
    with pytest.raises(StoreError):
        store.write(WriteBatch(events=[EVENT], deliveries=[delivery("b"), torn]))
    assert (store.events(), store.deliveries()) == ([], [])
    assert store.write(WriteBatch(events=[EVENT], deliveries=[delivery("b")])) == [1]
    assert store.deliveries() == [delivery("b")]


def test_what_is_due_comes_first_and_what_is_not_does_not_come(store):
    rows = [delivery("a", due_ns=30), delivery("b", due_ns=10), delivery("c", due_ns=20)]
    rows.append(delivery("d", receiver="boss"))
    store.write(WriteBatch(deliveries=rows))
    asked = {"receiver": "ops", "states": ("waiting",)}
    assert [r.event for r in store.deliveries(**asked, due_ns=20)] == ["b", "c"]
    assert [r.event for r in store.deliveries(**asked, due_ns=99, limit=1)] == ["b"]
    assert [r.event for r in store.deliveries(twin="lab.beam", limit=9)] == list("abcd")


def test_one_is_begun_once_and_settled_while_it_is_open(store):
    one = delivery("a")
    store.write(WriteBatch(deliveries=[one]))
    failed = one._replace(tries=1, error="no", due_ns=50)
    store.settle([failed])
    store.write(WriteBatch(deliveries=[one]))
    assert store.deliveries() == [failed]
    done = failed._replace(state="delivered", tries=2, ended_ns=60, error="")
    store.settle([done], [one.reminding(70)])
    store.settle([failed])
    assert {r.state for r in store.deliveries()} == {"delivered", "waiting"}
    assert store.deliveries(states=("delivered",)) == [done]
    assert [(t.receiver, t.state, t.number) for t in store.tallies()] == [
        ("ops", "delivered", 1), ("ops", "waiting", 1),
    ]  # fmt: skip
    store.forget_deliveries(60)
    assert len(store.deliveries()) == 2
    store.forget_deliveries(61)
    assert [r.state for r in store.deliveries()] == ["waiting"]


def test_what_is_settled_of_a_twin_that_has_gone_is_not_kept(store):
    one = delivery("a")
    store.write(WriteBatch(deliveries=[one]))
    store.delete("lab.beam")
    store.settle([one._replace(state="delivered", ended_ns=1)])
    assert store.deliveries() == []


def test_the_first_acknowledgement_stays(store):
    first = AlarmAcknowledgement("a", "lab.beam", 5, "Ann", "ann", "seen")
    store.write(WriteBatch(acknowledgements=[first]))
    store.write(WriteBatch(acknowledgements=[first._replace(by="Bob")]))
    assert store.acknowledgements("lab.beam") == {"a": first}
    assert store.acknowledgements("lab.rig") == {}
    store.delete("lab.beam")
    assert store.acknowledgements("lab.beam") == {}
