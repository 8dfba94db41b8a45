"""What is told is kept first, sent then, and told again to whoever asks."""

import json
import threading

import numpy as np
import pytest

from edge_agent.publish import Publisher, Ring, Spool, raw_message
from edge_agent.publish import publisher as publishing
from edge_agent.publish.digests import DigestCheck
from edge_agent.settings import Origin, PublishSettings
from slowtime.signals.block import Block
from slowtime_schemas.codec import decode, encode
from slowtime_schemas.messages import About, Acknowledgement, Features, Health, Quality
from slowtime_schemas.raw import decode_raw
from slowtime_schemas.streams import ABOUT, ACK, FEATURES, HEALTH, RAW, alive_key, request_key
from slowtime_services.bus import MemoryBus
from slowtime_services.clock import HandClock

from .interleaving import run_interleaved

ORIGIN = Origin(site="lab", asset="beam", boot="b1", time_base="simulated")


def features(sequence):
    return Features(
        **ORIGIN.model_dump(),
        sequence=sequence,
        t_ns=sequence,
        start_ns=0,
        slow_time=float(sequence),
        method="none",
        modes=(),
        quality=Quality(samples=1),
    )


def block_at(index, dtype="<i2", count=100):
    samples = np.arange(index, index + 2 * count).reshape(-1, 2).astype(dtype)
    return Block(
        samples=samples,
        rate_hz=100.0,
        first_index=index,
        start_ns=index * 10_000_000,
        channels=("x", "y"),
        units=("g", "g"),
        epoch=3,
        slow_time=1.5,
        covariates={"temperature_c": 3.0},
        truth={"stiffness_change": -0.1},
    )


@pytest.fixture
def bus():
    with MemoryBus() as bus:
        yield bus


def open_publisher(bus, folder, **chosen):
    spool = Spool(folder, ORIGIN.boot, segment_bytes=4096)
    publisher = Publisher(
        ORIGIN,
        spool,
        bus,
        HandClock(5 * 10**9),
        PublishSettings(**chosen),
        software="slowtime 0",
        about={"processing": {"a": 1}},
    )
    publisher.open()
    return publisher


@pytest.fixture
def publisher(bus, tmp_path):
    publisher = open_publisher(bus, tmp_path)
    yield publisher
    publisher.close()


def heard(bus, stream):
    got: list[bytes] = []
    bus.subscribe(stream.key("lab", "beam"), lambda sample: got.append(sample.payload))
    return got


def ask(bus, what, **parameters):
    return [
        sample.payload
        for sample in bus.ask(request_key("lab", "beam", what), parameters or None)
    ]


def test_a_feature_is_on_the_disk_before_it_is_on_the_bus(bus, publisher):
    seen = []

    def look(sample):
        seen.append(ask(bus, "features", boot="b1")[-1] == sample.payload)

    bus.subscribe(FEATURES.key("lab", "beam"), look)
    for sequence in range(3):
        publisher.features(features(sequence))
    assert seen == [True, True, True]


def test_features_are_told_again_in_order_and_only_those_asked_for(bus, publisher):
    for sequence in range(50):
        publisher.features(features(sequence))
    got = ask(bus, "features", boot="b1", first="7", last="31")
    assert got == [encode(features(n)) for n in range(7, 32)]
    assert ask(bus, "features", boot="other") == []


def test_the_account_lists_earlier_boots_too_and_an_acknowledgement_clears_them(bus, tmp_path):
    spool = Spool(tmp_path, "b0")
    for sequence in range(5):
        spool.append(sequence, b"{}")
    spool.close()
    publisher = open_publisher(bus, tmp_path)
    publisher.features(features(0))
    account = [json.loads(line) for line in ask(bus, "account")]
    assert account == [
        {"boot": "b0", "first": 0, "last": 4, "ack_version": 2},
        {"boot": "b1", "first": 0, "last": 0, "ack_version": 2},
    ]
    word = Acknowledgement(site="lab", asset="beam", boot="b0", sequence=4, t_ns=0)
    bus.publish(ACK.key("lab", "beam"), encode(word), encoding=ACK.encoding)
    assert [json.loads(line)["boot"] for line in ask(bus, "account")] == ["b1"]
    publisher.close()


@pytest.mark.parametrize(
    ("what", "parameters", "says"),
    [
        ("features", {"first": "x"}, "first='x' is not a valid sequence number"),
        ("features", {"last": "-1"}, "last='-1' is not a valid sequence number"),
        ("raw", {"seconds": "nan"}, "seconds='nan' is not a valid time"),
        ("raw", {"seconds": "-3"}, "seconds='-3' is not a valid time"),
        ("raw", {"seconds": "all"}, "seconds='all' is not a valid time"),
    ],
)
def test_a_question_that_makes_no_sense_is_answered_with_what_would(
    bus, publisher, what, parameters, says
):
    answers = bus.ask(request_key("lab", "beam", what), parameters)
    assert list(answers) == []
    assert says in answers.errors[0]


def test_a_broken_acknowledgement_is_counted_and_clears_nothing(bus, publisher):
    publisher.features(features(0))
    bus.publish(ACK.key("lab", "beam"), b"{}", encoding=ACK.encoding)
    other = Acknowledgement(site="lab", asset="other", boot="b1", sequence=0, t_ns=0)
    bus.publish(ACK.key("lab", "beam"), encode(other), encoding=ACK.encoding)
    assert sum(n for word, n in publisher.counters.items() if "refused_ack" in word) == 2
    assert len(ask(bus, "features", boot="b1")) == 1


def test_health_tells_where_the_account_ends_and_what_has_been_counted(bus, publisher):
    got = heard(bus, HEALTH)
    publisher.health()
    for sequence in range(3):
        publisher.features(features(sequence))
    publisher.count("refused_backwards", 2)
    publisher.health()
    first, second = (Health.model_validate_json(payload) for payload in got)
    assert (first.last_sequence, first.first_held) == (-1, -1)
    assert (second.last_sequence, second.first_held, second.dropped) == (2, 0, 0)
    assert second.counters == {"features": 3, "refused_backwards": 2, "ack_version": 2}
    assert second.sequence == first.sequence + 1


def test_messages_of_several_threads_have_sequences_of_their_own(bus, publisher):
    got = heard(bus, HEALTH)
    run_interleaved(publishing, *[publisher.health] * 8)
    sequences = [Health.model_validate_json(payload).sequence for payload in got]
    assert len(set(sequences)) == len(sequences) == 8


def test_a_feature_is_on_the_disk_whatever_fails_after(bus, publisher, monkeypatch):
    def fails(*arguments):
        raise IndexError("a bug of ours")

    monkeypatch.setattr(DigestCheck, "note", fails)
    with pytest.raises(IndexError):
        publisher.features(features(0))
    assert ask(bus, "features", boot="b1") == [encode(features(0))]


def test_about_tells_the_settings_at_the_start_and_on_request(bus, tmp_path):
    got = heard(bus, ABOUT)
    publisher = open_publisher(bus, tmp_path)
    (asked,) = ask(bus, "about")
    for payload in (got[0], asked):
        assert About.model_validate_json(payload).settings == {"processing": {"a": 1}}
    publisher.close()


def test_the_agent_is_alive_from_open_to_close(bus, tmp_path):
    changes: list[bool] = []
    bus.watch(alive_key("lab", "beam"), lambda key, alive: changes.append(alive))
    open_publisher(bus, tmp_path).close()
    assert changes == [True, False]


@pytest.mark.parametrize("dtype", ["<f8", "<f4", "<i4", "<i2"])
def test_raw_samples_travel_in_the_sensors_own_type(dtype):
    header, body = raw_message(block_at(0, dtype), ORIGIN, 4)
    assert (header.dtype, header.sequence, header.boot) == (dtype, 4, "b1")
    np.testing.assert_array_equal(
        np.frombuffer(body, dtype).reshape(-1, 2), block_at(0, dtype).samples
    )
    assert header.truth == {"stiffness_change": -0.1}
    assert (header.epoch, header.slow_time, header.t_ns) == (3, 1.5, 0)


def test_the_last_seconds_of_raw_samples_are_given_to_whoever_asks(bus, publisher):
    sent = heard(bus, RAW)
    for number in range(10):
        publisher.raw(block_at(100 * number))
    got = [decode_raw(payload)[0] for payload in ask(bus, "raw", seconds="2.5")]
    assert [header.first_index for header in got] == [700, 800, 900]
    assert sent == []


def test_raw_samples_are_sent_unasked_only_where_settings_say_so(bus, tmp_path):
    sent = heard(bus, RAW)
    publisher = open_publisher(bus, tmp_path, raw="on")
    for number in range(3):
        publisher.raw(block_at(100 * number))
    assert [decode_raw(payload)[0].sequence for payload in sent] == [0, 1, 2]
    publisher.close()


def test_the_ring_is_bounded_in_time_and_in_bytes_and_survives_a_clock_set_back():
    ring = Ring(seconds=5.0, max_bytes=1000)
    for second in range(1, 30):
        ring.put((second - 1) * 10**9, second * 10**9, b"x" * 10)
    assert ring.size == 50
    assert len(ring.last(100.0)) == 5
    assert len(ring.last(2.0)) == 2
    for second in range(30, 34):
        ring.put((second - 1) * 10**9, second * 10**9, b"y" * 400)
    assert ring.size <= 1000
    ring.put(0, 10**9, b"z")
    assert ring.last(100.0) == [b"z"]
    ring.put(10**9, 2 * 10**9, b"w" * 5000)
    assert ring.last(100.0) == [b"w" * 5000]


def test_the_ring_counts_seconds_of_samples_whatever_lies_between_records():
    ring = Ring(seconds=30.0, max_bytes=1000)
    for day in range(5):
        start_ns = day * 86_400 * 10**9
        ring.put(start_ns, start_ns + 10 * 10**9, bytes([day]))
    assert ring.last(1e12) == [b"\x02", b"\x03", b"\x04"]
    assert ring.last(10.0) == [b"\x04"]
    assert ring.last(10.5) == [b"\x03", b"\x04"]


def test_a_bus_that_fails_and_a_full_disk_stop_nothing(bus, tmp_path, monkeypatch):
    publisher = open_publisher(bus, tmp_path)
    monkeypatch.setattr(bus, "publish", lambda *a, **k: (_ for _ in ()).throw(OSError("gone")))
    publisher.features(features(0))
    monkeypatch.undo()
    monkeypatch.setattr(
        "os.write", lambda *a: (_ for _ in ()).throw(OSError(28, "No space left on device"))
    )
    got = heard(bus, FEATURES)
    publisher.features(features(1))
    monkeypatch.undo()
    publisher.features(features(2))
    assert publisher.counters == {"features": 3, "not_sent": 1, "not_spooled": 1}
    assert [decode(FEATURES, payload).sequence for payload in got] == [1, 2]
    assert ask(bus, "features", boot="b1") == [encode(features(0)), encode(features(2))]
    publisher.close()


def test_waiting_for_the_twin_ends_with_its_word_or_with_patience(bus, publisher):
    assert publisher.wait_acknowledged(0.0, threading.Event())
    publisher.features(features(0))
    assert not publisher.wait_acknowledged(0.1, threading.Event())
    word = Acknowledgement(site="lab", asset="beam", boot="b1", sequence=0, t_ns=0)
    bus.publish(ACK.key("lab", "beam"), encode(word), encoding=ACK.encoding)
    assert publisher.wait_acknowledged(0.1, threading.Event())
