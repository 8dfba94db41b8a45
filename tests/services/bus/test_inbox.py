"""An inbox never waits, never grows beyond its bounds and never drops unseen."""

import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime_services.bus import Inbox


@given(sizes=st.lists(st.integers(1, 50), max_size=60), room=st.integers(1, 20))
def test_what_fits_comes_out_in_order_and_the_rest_is_counted(sizes, room):
    inbox = Inbox[int](max_items=room, max_bytes=100)
    accepted = [i for i, size in enumerate(sizes) if inbox.put(i, size)]
    assert inbox.take() == accepted
    assert inbox.dropped == len(sizes) - len(accepted)
    assert sum(sizes[i] for i in accepted) <= 100
    assert len(accepted) <= room


def test_taking_makes_room_again():
    inbox = Inbox[str](max_items=10, max_bytes=10)
    assert inbox.put("a", 10)
    assert not inbox.put("b", 1)
    assert inbox.take(limit=1) == ["a"]
    assert inbox.put("c", 10)


def test_an_item_larger_than_the_inbox_passes_when_it_is_alone():
    inbox = Inbox[str](max_bytes=10)
    assert inbox.put("large", 11)
    assert not inbox.put("next", 1)


def test_a_waiting_worker_wakes_for_an_item_and_for_the_end():
    inbox, taken = Inbox[int](), []
    worker = threading.Thread(
        target=lambda: taken.extend([inbox.take(timeout_s=60), inbox.take(timeout_s=None)])
    )
    worker.start()
    inbox.put(1)
    while not taken and inbox:
        time.sleep(0.001)
    inbox.close()
    worker.join(60)
    assert taken == [[1], []]
    assert not inbox.put(2)
    assert inbox.dropped == 1


def test_a_worker_that_is_woken_takes_nothing_and_nothing_is_counted():
    inbox, taken = Inbox[int](max_items=1), []
    worker = threading.Thread(target=lambda: taken.append(inbox.take(timeout_s=None)))
    worker.start()
    inbox.wake()
    worker.join(60)
    assert taken == [[]]
    inbox.put(1)
    inbox.wake()
    assert inbox.take(timeout_s=None) == [1]
    assert inbox.dropped == 0
    inbox.wake()
    assert inbox.take(timeout_s=None) == []


def test_senders_in_many_threads_lose_nothing():
    inbox = Inbox[int]()
    senders = [
        threading.Thread(target=lambda k=k: [inbox.put(i) for i in range(k, 8000, 8)])
        for k in range(8)
    ]
    for sender in senders:
        sender.start()
    for sender in senders:
        sender.join()
    assert sorted(inbox.take()) == list(range(8000))


def test_an_inbox_without_room_is_refused():
    with pytest.raises(ValueError, match="Give positive numbers"):
        Inbox(max_items=0)
