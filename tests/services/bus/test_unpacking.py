"""Receivers behind an unpacking bus hear single messages, however they were sent."""

from slowtime_schemas.batches import MARK, pack
from slowtime_schemas.streams import FEATURES, HEALTH
from slowtime_services.bus import MemoryBus, Sample, TwoVersionBus, UnpackingBus

ENCODING = "application/octet-stream"


def heard_of(sent):
    with MemoryBus() as bus:
        heard: list[Sample] = []
        listening = TwoVersionBus(UnpackingBus(bus))
        listening.subscribe(FEATURES.everywhere, heard.append)
        listening.subscribe(HEALTH.everywhere, heard.append)
        for key, payload in sent:
            bus.publish(key, payload, encoding=ENCODING)
    return [(sample.key, sample.payload) for sample in heard]


def test_a_batch_arrives_as_its_messages_in_their_order_on_keys_of_both_versions():
    key = FEATURES.key("lab", "beam")
    sent = [(key, b"1"), (key, pack([b"2", b"3"])), (key, b"4")]
    assert heard_of(sent) == [(key, b"1"), (key, b"2"), (key, b"3"), (key, b"4")]
    former = [("slowtime/v1/lab/beam/features", pack([b"5", b"6"]))]
    assert heard_of(former) == [(key, b"5"), (key, b"6")]


def test_damaged_batches_and_those_of_other_streams_are_left_for_the_receiver_to_refuse():
    features, health = FEATURES.key("lab", "beam"), HEALTH.key("lab", "beam")
    sent = [(features, MARK + b"no"), (health, pack([b"{}"]))]
    assert heard_of(sent) == sent
