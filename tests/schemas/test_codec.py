"""What is sent is what is read; what is hostile is refused, with its reason."""

import json
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime_schemas.codec import REASONS, Refused, decode, decode_sample, encode
from slowtime_schemas.messages import (
    Event,
    Features,
    Health,
    Mode,
    Quality,
    SeenMode,
    Shape,
    TwinState,
)
from slowtime_schemas.quantities import Estimate, Quantity
from slowtime_schemas.raw import RawHeader, decode_raw, encode_raw
from slowtime_schemas.streams import EVENT, FEATURES, HEALTH, RAW, STATE, STREAMS

finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=1e-300, allow_nan=False, allow_infinity=False)
names = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,20}", fullmatch=True)
counts = st.integers(0, 2**63 - 1)
numbers = st.dictionaries(st.text(min_size=1, max_size=20), finite, max_size=3)
headers = {
    "site": names,
    "asset": names,
    "boot": st.from_regex(r"[0-9A-Za-z][0-9A-Za-z._-]{0,20}", fullmatch=True),
    "sequence": st.integers(0, 2**40 - 1),
}
pairs = st.lists(st.complex_numbers(max_magnitude=9, allow_nan=False), min_size=2, max_size=2)


def shape_of(pair):
    vector = np.array([1.0, *pair])
    vector = vector / np.linalg.norm(vector)
    return Shape(re=tuple(vector.real), im=tuple(vector.imag), sd=(0.0, 0.1, 0.2))


modes = st.builds(
    Mode,
    frequency_hz=st.builds(Quantity, value=positive, sd=positive),
    damping_ratio=st.builds(Quantity, value=finite, sd=positive),
    correlation=st.floats(-1, 1),
    snr_db=st.none() | finite,
    kind=st.sampled_from(["structural", "harmonic"]),
    shape=st.none() | pairs.map(shape_of),
)


def in_order(found):
    """Ascending modes; every second one is followed."""
    ascending = sorted(found, key=lambda mode: mode.frequency_hz.value)
    return tuple(
        mode.model_copy(update={"identity": n if n % 2 else None})
        for n, mode in enumerate(ascending)
    )


features = st.builds(
    Features,
    **headers,
    t_ns=st.integers(2**62, 2**63 - 1),
    slow_time=finite,
    start_ns=st.integers(0, 2**62),
    method=st.sampled_from(["free_decay", "ambient", "peak", "ssi", "none"]),
    channels=st.just(("x", "y", "z")),
    modes=st.lists(modes, max_size=4).map(in_order),
    quality=st.builds(Quality, samples=counts),
    covariates=numbers,
    truth=st.none() | numbers,
)
estimates = st.builds(Estimate, value=finite, sd=positive, lo=finite, hi=finite)
states = st.builds(
    TwinState,
    **headers,
    t_ns=counts,
    id=st.text(max_size=20),
    slow_time=finite,
    frequency_hz=st.none() | estimates,
    damping_ratio=st.none() | estimates,
    stiffness_change=st.none() | estimates,
    mass_change=st.none() | estimates,
    valid=st.booleans(),
    elements=st.dictionaries(st.text(max_size=9), estimates, max_size=3),
    posterior_to_prior=st.dictionaries(st.text(max_size=9), finite, max_size=3),
    suspects=st.lists(st.text(min_size=1, max_size=20), max_size=3).map(tuple),
    channels=st.just(("x", "y", "z")),
    modes=st.lists(
        st.builds(
            SeenMode,
            identity=st.none() | counts,
            model_mode=st.none() | counts,
            frequency_hz=estimates,
            damping_ratio=st.none() | estimates,
            shape=st.none() | pairs.map(shape_of),
        ),
        max_size=3,
    ).map(tuple),
)
healths = st.builds(
    Health,
    **headers,
    t_ns=counts,
    last_sequence=st.integers(-1, 2**40 - 1),
    first_held=st.integers(-1, 9),
    uptime_s=st.floats(min_value=0.0, max_value=9e9),
)
events = st.builds(
    Event,
    **headers,
    t_ns=counts,
    kind=st.text(min_size=1, max_size=9),
    severity=st.sampled_from(["info", "warning", "alarm"]),
    message=st.text(),
    details=st.dictionaries(
        st.text(), st.recursive(finite | st.text() | st.booleans() | st.none(), st.lists)
    ),
)
MODE = {
    "frequency_hz": {"value": 3.0, "sd": 0.1},
    "damping_ratio": {"value": 0.02, "sd": 0.1},
}
VALID = {
    "version": 3,
    "site": "lab",
    "asset": "beam",
    "boot": "b1",
    "sequence": 3,
    "t_ns": 10,
    "slow_time": 1.5,
    "start_ns": 1,
    "method": "peak",
    "modes": [MODE],
    "quality": {"samples": 100},
}
SHAPE = {"re": [0.6, 0.0], "im": [0.0, -0.8], "sd": [0.1, 0.1]}


def changed(**changes):
    return json.dumps(VALID | changes).encode()


@given(st.one_of(features, states, healths, events))
def test_what_is_sent_is_what_is_read(message):
    stream = next(s for s in STREAMS if s.message is type(message))
    assert decode(stream, encode(message)) == message
    key = stream.key(message.site, message.asset)
    assert decode_sample(key, encode(message)) == message


@given(rows=st.integers(0, 9), columns=st.integers(1, 3), dtype=st.sampled_from(["<f8", "<i2"]))
def test_a_raw_block_is_what_was_sent(rows, columns, dtype):
    header = RawHeader(
        site="lab",
        asset="beam",
        boot="b",
        sequence=0,
        t_ns=0,
        rate_hz=100.0,
        first_index=0,
        dtype=dtype,
        samples=rows,
        channels=tuple("xyz"[:columns]),
        units=("m",) * columns,
    )
    body = bytes(range(header.body_bytes))
    payload = encode_raw(header, body)
    read, samples = decode_raw(payload)
    assert (read, bytes(samples)) == (header, body)
    assert decode(RAW, payload) == header


@pytest.mark.parametrize(
    ("payload", "reason", "sentence"),
    [
        (b"", "not_json", "JSON with finite numbers"),
        (b"\xff\xfe\x00", "not_json", "begins with"),
        (b'{"version": 1', "not_json", "EOF"),
        (b"[" * 10**5, "not_json", "recursion limit"),
        (b"[1, 2]", "invalid", "Allowed: a JSON object"),
        (changed(slow_time=float("nan")), "not_finite", "NaN or infinity was given"),
        (changed(slow_time=float("-inf")), "not_finite", "finite numbers"),
        (
            changed(slow_time=0).replace(b'time": 0', b'time": 1e999'),
            "not_finite",
            "",
        ),
        (
            changed(version=99),
            "unknown_version",
            "Allowed: 1, 2, 3. It comes from newer software",
        ),
        (changed(version="1"), "unknown_version", "version '1' was given. Allowed: 1, 2, 3"),
        (
            json.dumps({k: v for k, v in VALID.items() if k != "version"}).encode(),
            "unknown_version",
            'without a version was given. Send "version": 3',
        ),
        (changed(surprise=1), "unknown_field", "at surprise, 1 was given"),
        (changed(sequence=-1), "invalid", "at sequence, -1 was given"),
        (changed(sequence=2**63), "invalid", "less than"),
        (changed(sequence="3"), "invalid", "valid integer"),
        (changed(site="Lab/../x"), "invalid", "at site"),
        (changed(start_ns=11), "invalid", "start_ns=11 is later than t_ns=10"),
        (changed(modes={}), "invalid", "at modes"),
        (changed(modes=[MODE] * 65), "invalid", "at most 64"),
        (
            changed(modes=[{**MODE, "frequency_hz": {"value": -1.0, "sd": 0.1}}]),
            "invalid",
            "not positive",
        ),
        (changed(quality={"samples": 1, "flags": ["x" * 201]}), "invalid", "200 characters"),
    ],
)
def test_hostile_features_are_refused_with_reason_and_cure(payload, reason, sentence):
    with pytest.raises(Refused) as refused:
        decode(FEATURES, payload)
    assert refused.value.reason == reason
    assert sentence in str(refused.value)
    assert len(str(refused.value)) < 500


def test_modes_out_of_order_are_refused():
    high = {**MODE, "frequency_hz": {"value": 9.0, "sd": 0.1}}
    assert decode(FEATURES, changed(modes=[MODE, high]))
    with pytest.raises(Refused, match=r"Modes at \[9.0, 3.0\] Hz are not in order"):
        decode(FEATURES, changed(modes=[high, MODE]))


def shaped(shape=(), channels=("x", "y"), **mode):
    return changed(
        modes=[{**MODE, **mode, "shape": {**SHAPE, **dict(shape)}}], channels=channels
    )


@pytest.mark.parametrize(
    ("payload", "sentence"),
    [
        (shaped({"re": [0.6]}), "1 real parts, 2 imaginary parts and 2 standard deviations"),
        (shaped({"re": [6.0, 0.0]}), "A shape of norm 6.0531. Divide it by its norm"),
        (shaped({"sd": [0.1, -0.1]}), "greater than or equal to 0"),
        (shaped(channels=["x"]), r"Shapes of [2] components for 1 channels"),
        (shaped(channels=[]), r"Shapes of [2] components for 0 channels"),
        (
            changed(channels=["x", "y"], units=["m"]),
            "1 units for 2 channels. Give one unit per channel",
        ),
        (shaped(kind="electric"), "'structural' or 'harmonic'"),
        (shaped(identity=-1), "at modes.0.identity, -1 was given"),
        (
            changed(modes=[{**MODE, "identity": 3}, {**MODE, "identity": 3}]),
            r"Identities [3, 3] name more than one mode alike",
        ),
    ],
)
def test_shapes_and_identities_that_contradict_each_other_are_refused(payload, sentence):
    assert decode(FEATURES, shaped())
    assert decode(FEATURES, changed(modes=[{**MODE, "identity": None}] * 2))
    with pytest.raises(Refused) as refused:
        decode(FEATURES, payload)
    assert refused.value.reason == "invalid"
    assert sentence in str(refused.value)


@pytest.mark.parametrize("modes", [None, {}, "x", [None], [[]], [{"frequency_hz": 3}], [MODE]])
def test_what_only_claims_to_be_an_older_message_is_refused_as_any_other(modes):
    payload = changed(version=1, modes=modes)
    if modes == [MODE]:
        assert decode(FEATURES, payload) == decode(FEATURES, changed())
        return
    with pytest.raises(Refused) as refused:
        decode(FEATURES, payload)
    assert refused.value.reason == "invalid"


def test_no_infinity_hides_in_free_form_content():
    event = {k: VALID[k] for k in ("site", "asset", "boot", "sequence", "t_ns")}
    event |= {"version": 1, "kind": "k", "severity": "info", "message": "m"}
    for value in ("NaN", "1e999", "-Infinity"):
        text = json.dumps(event | {"details": {"a": [{"b": "here"}]}}).replace('"here"', value)
        with pytest.raises(Refused) as refused:
            decode(EVENT, text.encode())
        assert refused.value.reason in ("not_finite", "invalid")


class OnlyLength:
    """A payload of a hundred megabytes of which nothing but the length can be had."""

    def __len__(self):
        return 100_000_001


def test_a_hundred_megabytes_are_refused_before_they_are_looked_at():
    payload = cast(bytes, OnlyLength())
    for stream in STREAMS:
        with pytest.raises(Refused, match="Allowed: up to") as error:
            decode(stream, payload)
        assert "100,000,001 bytes" in str(error.value)
        assert error.value.reason == "too_large"


def test_the_largest_allowed_payload_is_looked_at():
    payload = changed().ljust(FEATURES.max_bytes)
    assert decode(FEATURES, payload).sequence == 3
    with pytest.raises(Refused, match="Allowed: up to 1,048,576"):
        decode(FEATURES, payload + b" ")


def test_a_message_on_another_assets_key_is_refused():
    assert decode_sample("slowtime/v1/lab/beam/features", changed())
    for key in ("slowtime/v1/lab/fan/features", "slowtime/v1/mill/beam/features"):
        with pytest.raises(Refused, match="each asset on its own key") as refused:
            decode_sample(key, changed())
        assert refused.value.reason == "foreign_key"


@pytest.mark.parametrize("key", ["slowtime/v1/lab/beam/alive", "slowtime/v2/a/b/features", "x"])
def test_a_key_without_a_stream_is_refused(key):
    with pytest.raises(Refused, match="is no key of ours") as refused:
        decode_sample(key, changed())
    assert refused.value.reason == "unknown_key"


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"STB1",
        b"STB1\xff\xff\xff\xff",
        b"STB1\x02\x00\x00\x00{}",
        b"MCAP" * 9,
    ],
)
def test_what_is_not_a_raw_block_is_refused(payload):
    with pytest.raises(Refused) as refused:
        decode(RAW, payload)
    assert refused.value.reason == "not_raw"


@given(payload=st.binary(max_size=200), stream=st.sampled_from(STREAMS))
@settings(max_examples=300)
def test_noise_is_refused_and_nothing_else_happens(payload, stream):
    with pytest.raises(Refused) as refused:
        decode(stream, payload)
    assert refused.value.reason in REASONS


@given(where=st.integers(0, 400), value=st.integers(0, 255), cut=st.integers(0, 400))
@settings(max_examples=300)
def test_a_damaged_message_is_refused_or_valid_and_nothing_else_happens(where, value, cut):
    damaged = bytearray(changed())
    damaged[where % len(damaged)] = value
    for payload in (bytes(damaged), bytes(damaged[:cut])):
        try:
            outcome = decode(FEATURES, payload).MESSAGE
        except Refused as refused:
            outcome = refused.reason
        assert outcome in {"features", *REASONS}


def test_a_stream_decodes_its_own_message_only():
    with pytest.raises(Refused):
        decode(HEALTH, changed())
    with pytest.raises(Refused):
        decode(STATE, changed())
