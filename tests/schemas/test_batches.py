"""Batches give back the bytes that were packed, for ever, and refuse what is damaged."""

import json
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime_schemas import batches
from slowtime_schemas.batches import BatchError, is_batch, pack, unpack, unpacked_or_whole
from slowtime_schemas.codec import Refused, decode
from slowtime_schemas.streams import FEATURES

GOLDEN = Path(__file__).parents[2] / "schemas/golden"


def deflated(content):
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15)
    plain = content if isinstance(content, bytes) else json.dumps(content).encode()
    return batches.MARK + deflate.compress(plain) + deflate.flush()


numbers = st.one_of(
    st.integers(-(2**70), 2**70).map(str),
    st.floats().map(repr),
    st.from_regex(r"-?[0-9]{1,25}(\.[0-9]{1,5})?([eE][+-]?[0-9]{1,3})?", fullmatch=True),
)
messages = st.one_of(
    st.binary(max_size=60),
    st.tuples(numbers, numbers).map(lambda two: '{{"a":{},"b":"é{}"}}'.format(*two).encode()),
)


@given(st.lists(messages, max_size=30))
def test_every_payload_comes_back_byte_for_byte(payloads):
    packed = pack(payloads)
    assert is_batch(packed)
    assert unpack(packed) == payloads


def test_the_golden_batch_decodes_for_ever():
    features = [(GOLDEN / "features" / f"v{n}.json").read_bytes() for n in (1, 2, 3)]
    found = unpack((GOLDEN / "batch" / "v1.bin").read_bytes())
    assert found[:3] == features
    assert [decode(FEATURES, one).sequence for one in found] == [41, 41, 41, 42]


def test_readings_of_one_agent_take_a_fraction_of_their_text():
    payload = (GOLDEN / "features" / "v3.json").read_bytes()
    readings = [payload.replace(b'"sequence":41', b'"sequence":%d' % n) for n in range(60)]
    assert len(pack(readings)) < sum(map(len, readings)) / 20


@given(st.data())
def test_a_damaged_batch_is_refused_or_gives_messages_and_nothing_else(data):
    packed = bytearray(pack([b'{"t":%d,"f":%r}' % (n, n / 7) for n in range(20)]))
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(4, len(packed) - 1))
        packed[place] = data.draw(st.integers(0, 255))
    cut = bytes(packed[: data.draw(st.integers(4, len(packed)))])
    try:
        unpack(cut)
    except BatchError:
        assert unpacked_or_whole(cut) == [cut]


@pytest.mark.parametrize(
    "content",
    [
        b"not JSON",
        b"[]",
        {},
        {"order": ["=", "0", 1], "texts": [["a", "b"]], "columns": [[]]},
        {"order": ["=", "-1", 1], "texts": [["a"]], "columns": [[]]},
        {"order": ["=", "1", 1], "texts": [["a"]], "columns": [[]]},
        {"order": ["=", "0", 10**9], "texts": [["a"]], "columns": [[]]},
        {"order": ["=", "0", 2], "texts": [["a", "b"]], "columns": [[["+", 1]]]},
        {"order": ["=", "0", 1], "texts": [["a", "b"]], "columns": [[["?", 1]]]},
        {"order": ["=", "0", 2_000], "texts": [["a" * 10**4]], "columns": [[]]},
        b'"' + b"a" * (batches.MOST_BYTES + 1) + b'"',
    ],
)
def test_what_nobody_packs_is_refused_within_bounds(content):
    with pytest.raises(BatchError):
        unpack(deflated(content))


@pytest.mark.parametrize("payloads", [[b"{}"] * 2_001, [b"a" * 2**20] * 9])
def test_more_than_a_batch_holds_is_refused(payloads):
    with pytest.raises(BatchError, match="Pack them in several batches"):
        pack(payloads)


def test_where_one_message_is_expected_a_batch_is_refused_with_its_reason():
    with pytest.raises(Refused, match=r"batches\.unpack") as refused:
        decode(FEATURES, pack([b"{}"]))
    assert refused.value.reason == "batch"
