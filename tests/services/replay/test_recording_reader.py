"""A recording is read in the order it was written; anything else is named for what it is."""

import json
import os
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from slowtime_schemas.batches import MARK, pack
from slowtime_schemas.streams import FEATURES, HEALTH, STATE, former_key
from slowtime_services.bus import MemoryBus
from slowtime_services.record import RecordingWriter
from slowtime_services.replay import (
    RecordingError,
    contents,
    layout_of,
    read_recording,
    replay,
)

DATA = Path(os.environ.get("SLOWTIME_DATA", Path(__file__).parents[3] / "../shared/data"))


def test_messages_come_in_the_order_they_were_written_even_if_the_clock_stepped_back(tmp_path):
    log_times = [5, 9, 7, 7, 100, 1]
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        for i, log_ns in enumerate(log_times):
            writer.write(FEATURES, "lab", "beam", b"%d" % i, log_ns)
            writer.flush()
    got = list(read_recording(tmp_path / "a.mcap"))
    assert [m.log_ns for m in got] == log_times
    assert [int(m.payload) for m in got] == list(range(6))


def test_batches_that_another_recorder_wrote_are_read_as_their_messages(tmp_path):
    damaged = MARK + b"no batch"
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        writer.write(FEATURES, "lab", "beam", pack([b"1", b"2"]), 5)
        writer.write(FEATURES, "lab", "beam", damaged, 6)
        writer.write(STATE, "lab", "beam", pack([b"3"]), 7)
    got = [(m.log_ns, m.payload) for m in read_recording(tmp_path / "a.mcap")]
    assert got == [(5, b"1"), (5, b"2"), (6, damaged), (7, pack([b"3"]))]


def test_streams_and_times_can_be_chosen(tmp_path):
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        for i in range(10):
            for stream in (FEATURES, STATE):
                writer.write(stream, "lab", "beam", b"", i)
    got = read_recording(tmp_path / "a.mcap", streams=[STATE], start_ns=3, end_ns=6)
    assert [(m.log_ns, m.key.split("/")[3]) for m in got] == [(i, "state") for i in (3, 4, 5)]
    assert list(read_recording(tmp_path / "a.mcap", streams=[HEALTH])) == []


def test_times_are_exact_at_the_ends_of_chunks(tmp_path):
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        for i in range(10):
            writer.write(STATE, "lab", "beam", b"", i)
            if i % 2:
                writer.flush()
    for first in range(10):
        for last in range(first, 11):
            got = read_recording(tmp_path / "a.mcap", start_ns=first, end_ns=last)
            assert [m.log_ns for m in got] == list(range(first, min(last, 10)))


def test_contents_come_from_the_index(house):
    path, expected = house(100)
    inside = contents(path)
    assert inside.counts[FEATURES.key("lab", "beam")] == 150
    assert inside.messages == sum(map(len, expected.values())) + 2 + 2 + 1
    assert inside.metadata["software"].startswith("slowtime")
    assert inside.start_ns == 10**9 + 10**7
    assert contents(path, streams=[HEALTH]).messages == 5


def test_an_empty_recording_has_nothing_in_it_and_is_no_error(tmp_path):
    RecordingWriter(tmp_path / "a.mcap").close()
    assert list(read_recording(tmp_path / "a.mcap")) == []
    assert contents(tmp_path / "a.mcap").messages == 0


@pytest.mark.parametrize("content", [b"", b"\x89MCA", b"time;acc\n0;1\n", bytes(100)])
def test_what_is_no_recording_is_said_to_be_none(tmp_path, content):
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(RecordingError, match=r"is not a recording.*slowtime import"):
        read_recording(tmp_path / "a.mcap")


def test_damage_to_the_index_says_to_recover(house):
    path, _ = house(50)
    data = bytearray(path.read_bytes())
    data[-29:-21] = (len(data) - 40).to_bytes(8, "little")  # where the footer finds the summary
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"is damaged: .*Run `slowtime mcap recover"):
        contents(path)


def test_somebody_elses_recording_is_named_with_its_topics(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/camera", "cdr", 0)
        writer.add_message(channel, 1, b"", 1)
        writer.finish()
    with pytest.raises(
        RecordingError, match=r"no vibration in it: topics found: /camera \(cdr\)"
    ):
        read_recording(tmp_path / "a.mcap")


@pytest.mark.data
def test_recordings_of_ros_open_and_have_no_vibration_in_them():
    folder = DATA / "foreign_mcap"
    if not folder.is_dir():
        pytest.skip(f"no measurements at {folder}; set SLOWTIME_DATA")
    paths = sorted(folder.glob("*.mcap"))
    assert len(paths) >= 5
    for path in paths:
        with pytest.raises(RecordingError, match="has no vibration in it: topics found: ") as e:
            read_recording(path)
        assert "damaged" not in str(e.value)


def former_topics(recording, out):
    """Write a recording again, byte by byte, under topics of the former keys."""
    with recording.open("rb") as file, out.open("wb") as target:
        writer, channels = Writer(target), {}
        writer.start()
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    former_key(channel.topic) or "", channel.message_encoding, number
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()
    return out


def test_a_recording_with_former_topics_is_read_and_replayed_like_one_of_today(
    house, tmp_path, ledger
):
    today, expected = house(60)
    former = former_topics(today, tmp_path / "former.mcap")
    assert contents(former).topics[0].startswith("slowtime/v1/lab/")
    assert contents(former).counts == contents(today).counts
    assert list(read_recording(former)) == list(read_recording(today))
    with MemoryBus() as bus:
        twin = ledger(bus)
        played = replay(former, MemoryBus(joins=bus))
        twin.close()
    assert played.acknowledged == played.features
    assert twin.kept == expected


def test_a_layout_names_topics_as_the_recording_spells_them(house, tmp_path):
    former = former_topics(house(60)[0], tmp_path / "former.mcap")
    text = json.dumps(layout_of(contents(former).topics))
    assert "slowtime/v1/lab/beam/health.dropped" in text
    assert "slowtime/v2" not in text
