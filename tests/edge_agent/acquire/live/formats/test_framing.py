"""Messages are found in any stream, however it is cut and whatever is between them."""

import random
import struct

import numpy as np
import pytest

from edge_agent.acquire.live.batch import GarbledError
from edge_agent.acquire.live.counts import SampleCounts
from edge_agent.acquire.live.formats.decoding import decoder_of
from edge_agent.acquire.live.formats.framing import framer_of
from edge_agent.acquire.live.formats.packed import checksum
from edge_agent.acquire.live.indexing.assembly import Assembler
from edge_agent.acquire.live.indexing.counters import ByCounter
from edge_agent.layouts import CounterField, CsvLayout, JsonLayout, PackedLayout

CHANNELS = [{"name": name} for name in "xyz"]


def layout_of(kind="crc16-modbus", order="little", number="i16", samples=4):
    return PackedLayout(
        channels=CHANNELS,
        byte_order=order,
        sync="a55a",
        header=("counter:u16", "stamp:u32", "skip:1"),
        counter={"bits": 16},
        stamp={"unit": "us"},
        type=number,
        samples=samples,
        checksum=kind,
    )


def frame_of(layout, counter, values):
    order = "<" if layout.byte_order == "little" else ">"
    if layout.type == "i24":
        body = b"".join(v.to_bytes(3, layout.byte_order, signed=True) for v in values)
    else:
        body = struct.pack(f"{order}{len(values)}h", *values)
    covered = struct.pack(f"{order}HIB", counter, counter * 1000, 7) + body
    sizes = {"none": 0, "sum8": 1, "xor8": 1, "crc32": 4}
    size = sizes.get(layout.checksum, 2)
    end = checksum(layout.checksum, covered).to_bytes(size, layout.byte_order) if size else b""
    return layout.sync_bytes + covered + end


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", ["sum8", "xor8", "crc16-modbus", "crc16-ccitt", "crc32"])
def test_frames_are_found_again_after_garbage_and_garbage_is_counted(kind, seed):
    rng, layout = random.Random(seed), layout_of(kind)
    stream, garbage, sent = b"", 0, 0
    for n in range(60):
        if rng.random() < 0.2:
            # The sync itself, and half a frame, are the garbage that deceives.
            rubbish = rng.choice(
                [rng.randbytes(40), b"\xa5\x5a", frame_of(layout, n, [1] * 12)[:9]]
            )
            stream, garbage = stream + rubbish, garbage + len(rubbish)
        stream += frame_of(layout, n, [rng.randrange(-9999, 9999) for _ in range(12)])
        sent += 1
    framer, decode, found, place = framer_of(layout), decoder_of(layout), [], 0
    while place < len(stream):
        step = rng.randrange(1, 50)
        found += list(framer.feed(stream[place : place + step]))
        place += step
    counters = [decode(frame, 0)[0].counter for frame in found]
    assert [n for n in counters if n is not None] == list(range(60)) or kind in ("sum8", "xor8")
    assert sum(map(len, found)) + framer.garbage_bytes >= len(stream) - layout.frame_bytes(4)
    if kind == "crc32":
        assert framer.garbage_bytes == garbage


def test_a_frame_without_checksum_is_believed_once_another_follows():
    layout = layout_of("none")
    frames = [frame_of(layout, n, [n] * 12) for n in range(5)]
    framer = framer_of(layout)
    found = list(framer.feed(b"\x01\xa5\x5a\x02" + b"".join(frames)))
    assert [decoder_of(layout)(frame, 0)[0].counter for frame in found] == list(range(5))
    assert framer.garbage_bytes == 4


@pytest.mark.parametrize("order", ["little", "big"])
def test_numbers_of_three_bytes_keep_their_sign(order):
    layout = layout_of("crc32", order, "i24", samples=1)
    (batch,) = decoder_of(layout)(frame_of(layout, 9, [-1, 8_388_607, -8_388_608]), 0)
    assert np.asarray(batch.rows).tolist() == [[-1.0, 8_388_607.0, -8_388_608.0]]
    assert (batch.counter, batch.stamp) == (9, 9_000)


def test_a_packed_stream_that_could_not_be_found_again_is_refused():
    with pytest.raises(ValueError, match=r"without `sync`.*Give the bytes"):
        framer_of(PackedLayout(channels=CHANNELS, samples=1))
    with pytest.raises(ValueError, match=r"how long a frame is. Give `samples`"):
        framer_of(PackedLayout(channels=CHANNELS, sync="a5"))


def test_lines_of_any_cut_are_whole_and_overlong_ones_are_garbage():
    framer = framer_of(CsvLayout(channels=CHANNELS))
    text = b"1,2,3\r\n\n4,5,6\n" + b"9" * 2**21 + b"\n7,8,9\n"
    found = [line for n in range(0, len(text), 997) for line in framer.feed(text[n : n + 997])]
    assert found == [b"1,2,3", b"4,5,6", b"7,8,9"]
    assert framer.garbage_bytes == 2**21 + 1


def test_json_is_one_sample_a_block_or_rows():
    scalars = decoder_of(JsonLayout(channels=CHANNELS, counter={"at": "n"}))
    (one,) = scalars(b'{"n": 7, "x": 1, "y": 2.5, "z": null}', 5)
    assert (one.counter, list(one.rows[0])[:2], one.arrival_ns) == (7, [1.0, 2.5], 5)
    (block,) = scalars(b'{"n": 7, "x": [1, 2], "y": [3, 4], "z": [5, 6]}', 5)
    assert np.asarray(block.rows).tolist() == [[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]
    nested = JsonLayout(channels=CHANNELS, rows="data.rows")
    (rows,) = decoder_of(nested)(b'{"data": {"rows": [[1, 2, 3]]}}', 5)
    assert np.asarray(rows.rows).tolist() == [[1.0, 2.0, 3.0]]
    many = scalars(b'[{"n":1,"x":1,"y":1,"z":1},{"n":5,"x":1,"y":1,"z":1}]', 0)
    assert [batch.counter for batch in many] == [1, 5]


def test_lines_of_one_message_are_cut_where_their_counter_is():
    layout = CsvLayout(
        channels=[{"name": "x"}], columns=("t", "n", "x"), counter={"at": "n", "bits": 8}
    )
    batches = decoder_of(layout)(b"0,254,1\n1,255,2\n2,0,3\n3,9,4\n", 0)
    assert [(batch.counter, len(batch.rows)) for batch in batches] == [(254, 3), (9, 1)]


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        (CsvLayout, b"7,1\n7,2\n7,3\n8,4"),
        (JsonLayout, b'{"n": [7, 7, 7, 8], "x": [1, 2, 3, 4]}'),
        (JsonLayout, b'[{"n": 7, "x": [1, 2]}, {"n": 7, "x": 3}, {"n": 8, "x": 4}]'),
    ],
)
def test_rows_that_have_one_counter_of_messages_are_one_batch(layout, message):
    at = "n" if layout is JsonLayout else 0
    given = layout(channels=[{"name": "x"}], counter={"at": at, "counts": "messages"})
    batches = decoder_of(given)(message, 0)
    assert [batch.counter for batch in batches] == [7, 8]
    assert [np.ravel(batch.rows).tolist() for batch in batches] == [[1, 2, 3], [4]]


def test_no_sample_of_lines_with_a_counter_of_messages_is_overwritten():
    counter = CounterField(at=0, counts="messages")
    layout = CsvLayout(channels=[{"name": "x"}], counter=counter)
    decode, tally = decoder_of(layout), SampleCounts()
    positions = ByCounter(counter, 100.0, 25, tally)
    assembler, values = Assembler(((0,),), 10, 25, tally), []
    for number in range(20):
        lines = b"\n".join(b"%d,%d" % (number, 10 * number + row) for row in range(10))
        for batch in decode(lines, 10**18 + number * 10**8):
            for placed in positions.place(batch):
                assembler.put(placed.first_index, placed.batch.rows)
    for run in assembler.take(all_of_it=True):
        values += run.rows[:, 0].tolist()
    assert values == list(range(200))
    assert tally["samples_duplicated"] == 0


def test_a_counter_of_64_bits_in_a_line_keeps_its_last_digit():
    layout = CsvLayout(channels=[{"name": "x"}], counter={"at": 0})
    batches = decoder_of(layout)(b"9007199254740993,1\n9007199254740994,2\n7.0,3", 0)
    assert [batch.counter for batch in batches] == [9007199254740993, 7]
    with pytest.raises(GarbledError, match=r"7\.5 is not a whole number"):
        decoder_of(layout)(b"7.5,1", 0)


HOSTILE = [
    b"", b"{", b"[]]", b"null", b'{"x": 1}', b'{"n": 1, "x": "1", "y": 1, "z": 1}',
    b'{"n": 1.5, "x": 1, "y": 1, "z": 1}', b'{"n": 1, "x": [1], "y": [1, 2], "z": [1]}',
    b'{"n": 1, "x": [1], "y": 1, "z": 1}', b'{"n": 1, "x": [], "y": [], "z": []}',
    b'{"n": 1, "x": true, "y": 1, "z": 1}', b"[" * 100_000, b'{"n": ' + b"9" * 5000 + b"}",
    b"\xff\xfe", b'{"n": 1, "x": 1e999, "y": [[1]], "z": 1}',
]  # fmt: skip


@pytest.mark.parametrize("payload", HOSTILE, ids=range(len(HOSTILE)))
def test_what_is_not_the_layout_is_garbled_and_nothing_else(payload):
    for layout in (
        JsonLayout(channels=CHANNELS, counter={"at": "n"}),
        CsvLayout(channels=CHANNELS, counter={"at": 0}),
        layout_of(),
    ):
        if isinstance(layout, JsonLayout) and payload == b"[]]":
            payload = b"[1]"
        with pytest.raises(GarbledError):
            decoder_of(layout)(payload, 0)


@pytest.mark.parametrize("seed", range(20))
def test_random_bytes_are_garbled_or_decoded_but_never_raise_otherwise(seed):
    rng = random.Random(seed)
    for layout in (JsonLayout(channels=CHANNELS), CsvLayout(channels=CHANNELS), layout_of()):
        framer, decode = framer_of(layout), decoder_of(layout)
        for _ in range(50):
            data = rng.choice(
                [rng.randbytes(rng.randrange(200)), b"1,2\n", b"{}\n", b"\xa5\x5a"]
            )
            for message in framer.feed(data):
                try:
                    decode(message, 0)
                except GarbledError:
                    continue
