"""What every bus promises, over every member of the family and every way to join two."""

import logging
import threading
import time

import pytest

from slowtime_services.bus import BusClosedError, InvalidKeyError, Sample

JSON = "application/json"
KEY = "slowtime/v1/lab/beam/features"


@pytest.fixture
def settled(eventually):
    """Return once a message of `publisher` reaches `receiver`: once both are joined."""

    def settle(publisher, receiver, key="warmup"):
        seen = threading.Event()
        handle = receiver.subscribe(key, lambda _: seen.set())
        assert eventually(lambda: publisher.publish(key, b"", encoding=JSON) or seen.wait(0.02))
        handle.close()

    return settle


def collect(bus, expression):
    got: list[Sample] = []
    return got, bus.subscribe(expression, got.append)


def test_what_is_published_arrives_once_as_it_was_sent(pair, eventually, settled):
    got, _ = collect(pair.other, KEY)
    settled(pair.one, pair.other)
    before = time.time_ns()
    pair.one.publish(KEY, b'{"a": 1}', encoding=JSON)
    assert eventually(lambda: got)
    time.sleep(0.05)
    (sample,) = got
    assert (sample.key, sample.payload, sample.replayed) == (KEY, b'{"a": 1}', False)
    assert before <= sample.sent_ns <= time.time_ns()


def test_a_subscriber_hears_its_own_bus_too(pair, eventually):
    got, _ = collect(pair.one, KEY)
    pair.one.publish(KEY, b"1", encoding=JSON)
    assert eventually(lambda: [s.payload for s in got] == [b"1"])


def test_wildcards_match_chunks_and_nothing_else(pair, eventually, settled):
    one_chunk, _ = collect(pair.other, "slowtime/v1/*/*/features")
    any_depth, _ = collect(pair.other, "slowtime/v1/lab/**")
    settled(pair.one, pair.other)
    keys = [KEY, "slowtime/v1/lab/beam/state", "slowtime/v1/mill/fan/features"]
    for key in keys:
        pair.one.publish(key, b"", encoding=JSON)
    assert eventually(lambda: len(one_chunk) == 2 and len(any_depth) == 2)
    assert [s.key for s in one_chunk] == [keys[0], keys[2]]
    assert [s.key for s in any_depth] == keys[:2]


def test_the_order_of_one_publisher_is_kept_and_nothing_is_lost(pair, eventually, settled):
    got, _ = collect(pair.other, "slowtime/v1/**")
    settled(pair.one, pair.other)
    for i in range(3000):
        pair.one.publish(f"slowtime/v1/lab/beam{i % 3}/features", b"%d" % i, encoding=JSON)
    assert eventually(lambda: len(got) >= 3000)
    assert [int(s.payload) for s in got] == list(range(3000))


def test_a_replayed_message_says_so(pair, eventually, settled):
    got, _ = collect(pair.other, KEY)
    settled(pair.one, pair.other)
    pair.one.publish(KEY, b"", encoding=JSON, replayed=True)
    assert eventually(lambda: got)
    assert got[0].replayed


def test_a_megabyte_arrives_whole(pair, eventually, settled):
    got, _ = collect(pair.other, KEY)
    settled(pair.one, pair.other)
    payload = bytes(range(256)) * 4096
    pair.one.publish(KEY, payload, encoding="application/x-slowtime-raw")
    assert eventually(lambda: got)
    assert got[0].payload == payload


def test_a_callback_that_raises_is_logged_and_counted_and_stops_nothing(
    pair, eventually, settled, caplog
):
    got = []

    def fussy(sample):
        got.append(sample.payload)
        if sample.payload == b"bad":
            raise RuntimeError("cannot digest this")

    pair.other.subscribe(KEY, fussy)
    settled(pair.one, pair.other)
    with caplog.at_level(logging.ERROR):
        for payload in (b"bad", b"good"):
            pair.one.publish(KEY, payload, encoding=JSON)
        assert eventually(lambda: got == [b"bad", b"good"])
    assert pair.other.callback_errors == 1
    assert "cannot digest this" in caplog.text


def test_a_closed_subscription_hears_nothing_more(pair, settled):
    got, handle = collect(pair.other, KEY)
    settled(pair.one, pair.other)
    handle.close()
    handle.close()
    pair.one.publish(KEY, b"", encoding=JSON)
    time.sleep(0.05)
    assert not got


def test_a_question_gets_all_answers_with_its_parameters(pair, eventually):
    key = "slowtime/v1/lab/beam/request/features"

    def handler(query):
        assert query.key == key
        yield KEY, repr(sorted(query.parameters.items())).encode()
        yield KEY, b"second"

    pair.other.answer(key, handler)
    parameters = {"boot": "a;b=c d/%", "first": "3"}
    assert eventually(lambda: pair.one.ask(key))
    answers = pair.one.ask(key, parameters)
    assert [s.key for s in answers] == [KEY, KEY]
    assert answers[0].payload == repr(sorted(parameters.items())).encode()
    assert answers.errors == ()


def test_a_wildcard_question_reaches_everybody(pair, eventually):
    for asset in ("beam", "fan"):
        key = f"slowtime/v1/lab/{asset}/request/account"
        pair.other.answer(key, lambda q, name=asset: [(q.key.replace("*", name), b"")])
    everybody = "slowtime/v1/lab/*/request/account"
    assert eventually(lambda: len(pair.one.ask(everybody)) == 2)


def test_nobody_there_is_an_empty_answer_at_once(pair):
    started = time.monotonic()
    assert pair.one.ask("slowtime/v1/nobody/here/request/account", timeout_s=60.0) == []
    assert time.monotonic() - started < 30.0


def test_an_answer_that_raises_is_an_error_with_its_reason(pair, eventually, caplog):
    key = "slowtime/v1/lab/beam/request/raw"

    def handler(query):
        raise ValueError("seconds=-1 is negative")

    pair.other.answer(key, handler)
    assert eventually(lambda: pair.one.ask(key).errors)
    answers = pair.one.ask(key)
    assert answers == []
    assert answers.errors == ("ValueError: seconds=-1 is negative",)
    assert pair.other.callback_errors >= 1


def test_one_who_does_not_answer_costs_no_more_than_the_timeout(pair, eventually):
    key, release = "slowtime/v1/lab/beam/request/raw", threading.Event()

    def handler(query):
        if query.parameters:
            release.wait(60)
        return [(query.key, b"")]

    pair.other.answer(key, handler)
    assert eventually(lambda: pair.one.ask(key))
    started = time.monotonic()
    answers = pair.one.ask(key, {"wait": "1"}, timeout_s=0.3)
    release.set()
    assert answers == []
    assert set(answers.errors) == {"Timeout"}  # once by each road to the one who is asked
    assert 0.25 < time.monotonic() - started < 30.0


def test_presence_is_seen_by_those_before_and_after(pair, eventually):
    key = "slowtime/v1/lab/beam/alive"
    early, late = [], []
    pair.one.watch("slowtime/v1/*/*/alive", lambda *change: early.append(change))
    token = pair.other.announce(key)
    assert eventually(lambda: early == [(key, True)])
    pair.one.watch("slowtime/v1/lab/*/alive", lambda *change: late.append(change))
    assert eventually(lambda: late == [(key, True)])
    token.close()
    assert eventually(lambda: early[1:] == late[1:] == [(key, False)])


def test_a_bus_that_closes_takes_its_presence_with_it(pair, eventually):
    key, seen = "slowtime/v1/lab/fan/alive", []
    pair.one.watch("slowtime/v1/*/*/alive", lambda *change: seen.append(change))
    leaving = pair.join()
    leaving.announce(key)  # not kept in a variable: the bus keeps it
    assert eventually(lambda: seen == [(key, True)])
    time.sleep(0.05)
    assert seen == [(key, True)]
    leaving.close()
    assert eventually(lambda: seen == [(key, True), (key, False)])


def test_what_was_published_before_closing_still_arrives(pair, eventually, settled):
    leaving = pair.join()
    got, _ = collect(pair.one, KEY)
    settled(leaving, pair.one)
    for i in range(500):
        leaving.publish(KEY, b"%d" % i, encoding=JSON)
    leaving.close()
    assert eventually(lambda: len(got) == 500)


def test_a_closed_bus_says_so_and_leaves_the_others_alone(pair, eventually, settled):
    leaving = pair.join()
    handle = leaving.subscribe(KEY, lambda _: None)
    leaving.close()
    leaving.close()
    handle.close()
    with pytest.raises(BusClosedError, match="Open a new one"):
        leaving.publish(KEY, b"", encoding=JSON)
    with pytest.raises(BusClosedError):
        leaving.ask(KEY)
    got, _ = collect(pair.other, KEY)
    settled(pair.one, pair.other)
    pair.one.publish(KEY, b"", encoding=JSON)
    assert eventually(lambda: got)


@pytest.mark.parametrize("key", ["", "/slowtime", "slowtime//v1", "slowtime/v1/", "a?b", "a#b"])
def test_a_key_that_no_bus_accepts_is_refused(pair, key):
    with pytest.raises(InvalidKeyError, match="is not a valid bus address"):
        pair.one.publish(key, b"", encoding=JSON)
    with pytest.raises(InvalidKeyError):
        pair.one.subscribe(key, lambda _: None)


@pytest.mark.parametrize("key", ["slowtime/*/x", "slowtime/**"])
def test_a_message_and_a_presence_need_one_key(pair, key):
    with pytest.raises(InvalidKeyError, match="Give one key"):
        pair.one.publish(key, b"", encoding=JSON)
    with pytest.raises(InvalidKeyError, match="Give one key"):
        pair.one.announce(key)
