"""What an output is given, from where it has come to."""

import pytest

from slowtime_services.outputs import Positions
from slowtime_services.outputs.history_reader import PAGE, HistoryReader
from tests.services.outputs.conftest import TWIN, event, state


@pytest.fixture
def reading(server, tmp_path):
    """Make a reader, and what an output that acknowledges everything is given by it."""

    def start(*, from_beginning=True, is_archive=True):
        positions = Positions(tmp_path / "a.json")
        reader = HistoryReader(
            server, positions, lambda _: True,
            from_beginning=from_beginning, is_archive=is_archive, now_s=lambda: 0.0,
        )  # fmt: skip

        def read():
            batches = []
            for found in reader.read():
                batches.append(found.batch)
                positions.move(TWIN, found.position)
            return batches

        return read

    return start


def sequences(batches):
    return [(one.boot, one.sequence) for batch in batches for one in batch.states]


def numbers(batches):
    return [one.number for batch in batches for one in batch.events]


def test_a_long_history_comes_in_pages_and_whole(server, reading):
    server.states = [state(n) for n in range(2 * PAGE + 7)]
    server.given_events = [event(n + 1) for n in range(PAGE + 3)]
    batches = reading()()
    assert sequences(batches) == [("b1", n) for n in range(2 * PAGE + 7)]
    assert numbers(batches) == list(range(1, PAGE + 4))
    assert [batch.is_latest for batch in batches] == [False, False, True]


def test_another_process_goes_on_where_the_former_was(server, reading):
    server.states = [state(n) for n in range(5)]
    reading()()
    server.states += [state(5), state(0, "b2")]
    assert sequences(reading()()) == [("b1", 5), ("b2", 0)]


def test_the_latest_state_is_the_first_of_a_twin_that_begins_there(server, reading):
    server.states = [state(n) for n in range(5)]
    server.given_events = [event(1)]
    read = reading(from_beginning=False)
    assert sequences(found := read()) == [("b1", 4)]
    assert numbers(found) == []
    server.states.append(state(5))
    server.given_events.append(event(2))
    assert sequences(found := read()) == [("b1", 5)]
    assert numbers(found) == [2]


def test_another_database_is_sent_from_its_beginning(server, reading):
    server.states = [state(n) for n in range(5)]
    reading()()
    server.states = [state(n, "new") for n in range(3)]
    assert sequences(reading()()) == [("new", 0), ("new", 1), ("new", 2)]


@pytest.mark.parametrize(("is_archive", "again"), [(True, 5), (False, 0)])
def test_archives_alone_are_sent_a_history_that_was_estimated_anew(
    server, reading, is_archive, again
):
    server.states = [state(n) for n in range(5)]
    read = reading(is_archive=is_archive)
    read()
    server.given_events = [event(1, "registered")]
    assert len(sequences(reading(is_archive=is_archive)())) == again


def test_a_twin_without_news_is_not_asked_for_its_history(server, reading):
    server.states = [state(n) for n in range(5)]
    read = reading()
    read()
    before = server.asked
    assert read() == []
    assert server.asked == before
