"""A recording written is a sound MCAP file, the same bytes each time, readable without us."""

import io
import json

import pytest
from mcap.reader import make_reader

from slowtime_schemas.codec import encode
from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import FEATURES, RAW
from slowtime_services.record import RecordingWriter, free_path


def raw_payload(index=0, rows=100):
    header = RawHeader(
        site="lab",
        asset="beam",
        boot="b",
        sequence=index,
        t_ns=index * 10**9,
        rate_hz=100.0,
        first_index=index * rows,
        dtype="<i2",
        samples=rows,
        channels=("x", "y"),
        units=("g", "g"),
    )
    return encode_raw(header, bytes(rows * 4))


def write(target, messages):
    with RecordingWriter(target) as writer:
        for message in messages:
            log_ns = message.t_ns + 5
            writer.write(FEATURES, "lab", "beam", encode(message), log_ns, message.t_ns)
        for i in range(40):
            writer.write(RAW, "lab", "beam", raw_payload(i), i)


def test_the_same_payloads_give_the_same_bytes(tmp_path, features_of):
    messages = features_of(5000)
    paths = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for path in paths:
        write(path, messages)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    stream = io.BytesIO()
    write(stream, messages)
    assert stream.getvalue() == paths[0].read_bytes()


def test_what_was_written_is_in_the_file_with_its_times(tmp_path, features_of):
    messages = features_of(50)
    write(tmp_path / "a.mcap", messages)
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        got = list(reader.iter_messages("slowtime/v2/lab/features/174/beam"))
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        summary = reader.get_summary()
    assert [m.data for _, _, m in got] == [encode(m) for m in messages]
    assert [m.sequence for _, _, m in got] == list(range(50))
    assert all((m.log_time - m.publish_time) == 5 for _, _, m in got)
    assert metadata["slowtime"]["software"].startswith("slowtime 0.")
    assert metadata["slowtime.counts"] == {"features": "50", "raw": "40"}
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 90


def test_json_channels_carry_a_schema_that_plots_and_raw_ones_their_layout(
    tmp_path, features_of
):
    write(tmp_path / "a.mcap", features_of(1))
    with (tmp_path / "a.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    by_topic = {c.topic: (c, summary.schemas[c.schema_id]) for c in summary.channels.values()}
    channel, schema = by_topic["slowtime/v2/lab/features/174/beam"]
    assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
    frequency = json.loads(schema.data)["properties"]["modes"]["items"]["properties"]
    assert frequency["frequency_hz"]["properties"]["value"] == {"type": "number"}
    channel, schema = by_topic["slowtime/v2/lab/raw/174/beam"]
    assert channel.message_encoding == schema.encoding == "x-slowtime-raw"
    assert "the four bytes ``STB1``" in json.loads(schema.data)["layout"]


def test_an_existing_recording_is_not_overwritten(tmp_path):
    path = tmp_path / "a.mcap"
    RecordingWriter(path).close()
    before = path.read_bytes()
    with pytest.raises(FileExistsError, match="may be the only copy"):
        RecordingWriter(path)
    assert path.read_bytes() == before
    RecordingWriter(path, overwrite=True).close()
    assert free_path(path).name == "a-0001.mcap"
    assert free_path(tmp_path / "b.mcap").name == "b.mcap"


def test_a_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no folder .*nowhere. Make it first"):
        RecordingWriter(tmp_path / "nowhere" / "a.mcap")
