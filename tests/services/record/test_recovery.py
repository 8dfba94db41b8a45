"""What can be read of a damaged file is kept, and the rest is stated."""

import random
import struct

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

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
        with pytest.raises(RecordingError, match="Run `slowtime mcap recover"):
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
    with pytest.raises(ValueError, match=r"is not a valid MCAP file.*nothing in it to recover"):
        recover(path, tmp_path / "out.mcap")
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_an_existing_file_is_not_overwritten(tmp_path, whole):
    with pytest.raises(FileExistsError, match="Give another name"):
        recover(whole, whole)


def foreign(path, count=1500, **how):
    """A recording of somebody else, and its messages."""
    rng = random.Random(4)
    with path.open("wb") as file:
        writer = Writer(file, **how)
        writer.start("ros2", "other")
        schema = writer.register_schema("s", "jsonschema", b"{}")
        channel = writer.register_channel("/a", "json", schema)
        for i in range(count):
            data = b"%d " % i + rng.randbytes(60) + b"x" * 200
            writer.add_message(channel, i * 10**7, data, i * 10**7, i)
        writer.finish()
    return messages_of(path)


def messages_of(path):
    with path.open("rb") as file:
        found = make_reader(file).iter_messages(log_time_order=False)
        return [(c.topic, m.log_time, m.sequence, m.data) for _, c, m in found]


@pytest.mark.parametrize(
    ("how", "least"),
    [
        ({"compression": CompressionType.ZSTD, "chunk_size": 1 << 26}, 0.25),
        ({"compression": CompressionType.LZ4, "chunk_size": 1 << 26}, 0.45),
        ({"compression": CompressionType.NONE, "chunk_size": 1 << 26}, 0.45),
        ({"compression": CompressionType.ZSTD, "chunk_size": 1 << 14}, 0.4),
        ({"use_chunking": False}, 0.45),
    ],
    ids=["zstd", "lz4", "unpacked", "small chunks", "no chunks"],
)
def test_a_torn_chunk_gives_what_is_whole_in_it_however_it_is_packed(tmp_path, how, least):
    path, cut, out = (tmp_path / name for name in ("f.mcap", "cut.mcap", "out.mcap"))
    everything = foreign(path, **how)
    data = path.read_bytes()
    for percent in range(3, 100, 12):
        cut.write_bytes(data[: len(data) * percent // 100])
        out.unlink(missing_ok=True)
        recovered = recover(cut, out)
        assert messages_of(out) == everything[: recovered.messages]
        if percent == 51:
            assert recovered.messages >= least * len(everything)


@pytest.mark.data
def test_recordings_of_others_cut_anywhere_give_their_first_messages(tmp_path, data):
    paths = sorted((data / "foreign_mcap").glob("*.mcap"))
    assert paths
    for path in paths:
        whole, everything = path.read_bytes(), messages_of(path)
        for percent in range(1, 100, 6):
            cut, out = tmp_path / f"{path.stem}{percent}.mcap", tmp_path / f"out{percent}.mcap"
            cut.write_bytes(whole[: max(8, len(whole) * percent // 100)])
            recovered = recover(cut, out)
            assert messages_of(out) == everything[: recovered.messages]
            out.unlink()


def test_behind_any_flipped_bit_the_recording_goes_on_and_the_loss_is_counted(tmp_path, whole):
    data, everything = whole.read_bytes(), payloads(whole)
    rng = random.Random(5)
    for number in range(60):
        place = rng.randrange(64, len(data) * 8)
        flipped = bytearray(data)
        flipped[place // 8] ^= 1 << place % 8
        hurt, out = tmp_path / "hurt.mcap", tmp_path / f"out{number}.mcap"
        hurt.write_bytes(flipped)
        recovered = recover(hurt, out)
        kept = payloads(out)
        assert set(kept) <= set(everything)
        assert len(kept) >= 900
        assert len(kept) == 1000 or not recovered.was_sound


def test_a_chunk_that_somebody_never_closed_is_read_to_the_end_of_the_file(tmp_path, whole):
    data, offset = bytearray(whole.read_bytes()), chunk_offsets(whole)[9]
    end = offset + 9 + struct.unpack_from("<Q", data, offset + 1)[0]
    struct.pack_into("<Q", data, offset + 1, 2**64 - 1)
    struct.pack_into("<Q", data, offset + 9 + 16, 0)
    struct.pack_into("<Q", data, offset + 9 + 28 + 8, 2**64 - 1)
    (tmp_path / "open.mcap").write_bytes(data[:end])
    recovered = recover(tmp_path / "open.mcap", tmp_path / "out.mcap")
    assert (recovered.messages, recovered.torn_chunks) == (1000, 1)


def test_what_a_power_cut_left_as_zeros_is_no_message(tmp_path, whole):
    data = whole.read_bytes()
    cut = chunk_offsets(whole)[5] + 300
    (tmp_path / "zeros.mcap").write_bytes(data[:cut] + bytes(5000))
    recovered = recover(tmp_path / "zeros.mcap", tmp_path / "out.mcap")
    assert recovered.messages >= 500
    assert payloads(tmp_path / "out.mcap") == payloads(whole)[: recovered.messages]
