"""What can be read of a damaged file is kept, and the rest is stated."""

import struct

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.record import RecordingWriter, recover
from slowtime_services.replay import RecordingError, contents, read_recording

KEY = FEATURES.key("lab", "beam")


@pytest.fixture
def whole(tmp_path, features_of):
    """A sound recording of ten chunks of a hundred features."""
    path = tmp_path / "whole.mcap"
    with RecordingWriter(path) as writer:
        for i, message in enumerate(features_of(1000)):
            writer.write(FEATURES, "lab", "beam", encode(message), 1000 + i)
            if i % 100 == 99:
                writer.flush()
    return path


def _summary(file):
    summary = make_reader(file).get_summary()
    assert summary is not None
    return summary


def chunk_offsets(path):
    with path.open("rb") as file:
        return [index.chunk_start_offset for index in _summary(file).chunk_indexes]


def payloads(path):
    return [m.payload for m in read_recording(path)]


def test_a_file_cut_anywhere_keeps_every_complete_chunk(tmp_path, whole, features_of):
    everything = [encode(m) for m in features_of(1000)]
    data, offsets = whole.read_bytes(), chunk_offsets(whole)
    for number, cut in enumerate([*range(len(data) - 1, 400, -len(data) // 23), 60, 8]):
        broken = tmp_path / f"cut{number}.mcap"
        broken.write_bytes(data[:cut])
        with pytest.raises(RecordingError, match="Run `slowtime recover"):
            read_recording(broken)
        out = tmp_path / f"sound{number}.mcap"
        recovered = recover(broken, out)
        complete = sum(end <= cut for end in [*offsets[1:], offsets[-1] + 1])
        assert recovered.messages >= 100 * (complete - 1)
        assert not recovered.was_sound
        kept = payloads(out)
        assert kept == everything[: recovered.messages]
        assert recovered.counts == ({KEY: len(kept)} if kept else {})


def test_a_damaged_chunk_is_left_out_and_counted(tmp_path, whole, features_of):
    data, offset = bytearray(whole.read_bytes()), chunk_offsets(whole)[3]
    data[offset + 200] ^= 0xFF
    (tmp_path / "hurt.mcap").write_bytes(data)
    with pytest.raises(RecordingError, match="is damaged"):
        payloads(tmp_path / "hurt.mcap")
    recovered = recover(tmp_path / "hurt.mcap", tmp_path / "out.mcap")
    assert (recovered.messages, recovered.damaged_chunks) == (900, 1)
    assert not recovered.was_sound
    expected = [encode(m) for m in features_of(1000)]
    assert payloads(tmp_path / "out.mcap") == expected[:300] + expected[400:]


def test_a_sound_file_comes_out_with_everything_it_had(tmp_path, whole):
    recovered = recover(whole, tmp_path / "out.mcap")
    assert recovered.was_sound
    assert (recovered.messages, recovered.unread_bytes) == (1000, 0)
    assert (recovered.first_ns, recovered.last_ns) == (1000, 1999)
    assert [tuple(m) for m in read_recording(whole)] == [
        tuple(m) for m in read_recording(tmp_path / "out.mcap")
    ]
    assert contents(tmp_path / "out.mcap") == contents(whole)


def test_attachments_and_unchunked_messages_of_others_are_kept(tmp_path):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start("ros2", "other")
        channel = writer.register_channel("/x", "cdr", 0, {"qos": "1"})
        writer.add_message(channel, 5, b"hello", 4, 7)
        writer.add_attachment(1, 2, "photo", "image/png", b"png")
        writer.add_message(channel, 6, b"again", 6, 8)
        writer.finish()
    path.write_bytes(path.read_bytes()[:-60])
    recovered = recover(path, tmp_path / "out.mcap")
    assert recovered.messages == 2
    with (tmp_path / "out.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        assert [a.data for a in reader.iter_attachments()] == [b"png"]
        messages = [(c.metadata, m.data, m.sequence) for _, c, m in reader.iter_messages()]
    assert messages == [({"qos": "1"}, b"hello", 7), ({"qos": "1"}, b"again", 8)]


def test_a_record_that_claims_to_be_endless_ends_the_reading(tmp_path, whole):
    path = tmp_path / "endless.mcap"
    path.write_bytes(
        whole.read_bytes()[: chunk_offsets(whole)[1]] + struct.pack("<BQ", 6, 2**64 - 1)
    )
    recovered = recover(path, tmp_path / "out.mcap")
    assert (recovered.messages, recovered.unread_bytes) == (100, 9)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"time,value\n0,1\n"])
def test_what_was_never_a_recording_is_said_to_be_none(tmp_path, content):
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"is no MCAP file.*nothing in it to recover"):
        recover(path, tmp_path / "out.mcap")
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_an_existing_file_is_not_overwritten(tmp_path, whole):
    with pytest.raises(FileExistsError, match="Give another name"):
        recover(whole, whole)
