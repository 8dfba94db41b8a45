"""An acknowledgement clears what it speaks of, and nothing that another agent has made."""

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_agent.publish import digests as agreement
from edge_agent.publish.digests import DigestCheck
from slowtime_services.digests import digest_of, written

from .interleaving import run_interleaved


def payload(sequence, agent="mine"):
    return f"{agent} {sequence}".encode()


def digest(first, last, agent="mine"):
    return written(sum(digest_of(n, payload(n, agent)) for n in range(first, last + 1)))


def made(count, first=0):
    one = DigestCheck()
    for sequence in range(first, first + count):
        one.note(sequence, payload(sequence))
    return one


@given(data=st.data())
def test_any_range_that_grows_is_compared_and_one_strange_reading_in_it_is_noticed(data):
    ends = sorted(data.draw(st.sets(st.integers(0, 60), min_size=1, max_size=6)))
    starts = data.draw(st.lists(st.sampled_from([0, *(e + 1 for e in ends)]), max_size=6))
    one = made(61)
    for last, first in zip(ends, [*starts, *([0] * len(ends))], strict=False):
        if first > last:
            continue
        assert one.compare(first, last, digest(first, last)) in ("agrees", "unknown")
        assert one.compare(first, last, digest(first, last, "other")) in ("differs", "unknown")
    fresh = made(61)
    strange = data.draw(st.integers(0, 60))
    mixed = written(
        sum(digest_of(n, payload(n, "other" if n == strange else "mine")) for n in range(61))
    )
    assert fresh.compare(0, 60, mixed) == "differs"
    assert fresh.compare(0, 60, digest(0, 60)) == "agrees"


def test_what_was_never_made_is_another_s(monkeypatch):
    assert DigestCheck().compare(None, 0, None) == "differs"
    one = made(5)
    assert one.compare(None, 4, None) == "unknown"
    assert one.compare(0, 5, digest(0, 5)) == "differs"


def test_sums_go_on_where_they_can_be_told_and_are_bounded(monkeypatch):
    monkeypatch.setattr(agreement, "MOST_SUMS", 100)
    one = made(1000)
    assert len(one._sums) <= 100
    assert one.compare(0, 999, digest(0, 999)) == "agrees"
    assert one.compare(0, 10, digest(0, 10)) == "unknown"
    one.note(2000, payload(2000))
    assert one.compare(0, 2000, digest(0, 2000)) == "unknown"
    assert one.compare(2000, 2000, digest(2000, 2000)) == "agrees"


@pytest.mark.parametrize("first", [0, 50])
def test_a_twin_that_starts_again_counts_from_where_it_was(first):
    one = made(100)
    assert one.compare(0, 49, digest(0, 49)) == "agrees"
    assert one.compare(first, 99, digest(first, 99)) == "agrees"


def test_features_are_noted_while_acknowledgements_are_compared():
    one, verdicts, over = DigestCheck(), [], threading.Event()

    def note():
        try:
            for sequence in range(200):
                one.note(sequence, payload(sequence))
        finally:
            over.set()

    def compare():
        first = 0
        while not over.is_set():
            last = one.newest
            if last >= first:
                verdicts.append(one.compare(first, last, digest(first, last)))
                first = last + 1

    run_interleaved(agreement, note, compare)
    assert set(verdicts) == {"agrees"}
