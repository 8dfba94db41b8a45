"""What was frozen stays: schemas, golden bytes, and what plotting tools read of them."""

import json
from pathlib import Path

import numpy as np
import pytest

from slowtime_schemas import freeze
from slowtime_schemas.codec import decode, encode
from slowtime_schemas.files.registry import DOCUMENTS, EARLIER
from slowtime_schemas.frozen import folder, plotting_schema_text, schema_text
from slowtime_schemas.messages import Features, TwinState
from slowtime_schemas.raw import decode_raw, encode_raw
from slowtime_schemas.streams import BY_NAME, FEATURES, MESSAGES, STATE

GOLDEN = Path(__file__).parents[2] / "schemas/golden"


@pytest.mark.parametrize(
    "message",
    [*MESSAGES.values(), *DOCUMENTS.values(), *EARLIER],
    ids=lambda message: f"{message.MESSAGE}-v{message.VERSION}",
)
def test_no_message_has_drifted_from_its_frozen_schema(message):
    assert "\n".join(freeze.drift(message)) == ""


@pytest.mark.parametrize("name", MESSAGES)
def test_every_version_that_was_frozen_has_its_golden_bytes(name):
    frozen = {path.stem for path in (folder() / name).iterdir()}
    assert frozen == {path.stem for path in (GOLDEN / name).iterdir()}
    assert f"v{MESSAGES[name].VERSION}" in frozen


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(GOLDEN.glob("*/*.json")) if path.parent.name in MESSAGES],
    ids=lambda p: f"{p.parent.name}-{p.stem}",
)
def test_golden_bytes_decode_for_ever(path):
    payload = path.read_bytes()
    message = decode(BY_NAME[path.parent.name], payload)
    assert (message.twin_id, message.sequence) == ("lab.beam-1", 41)
    if path.stem == f"v{message.VERSION}":
        assert encode(message) == payload


def test_features_of_the_first_version_have_modes_without_shape_that_nobody_followed():
    payload = (GOLDEN / "features" / "v1.json").read_bytes()
    message = decode(FEATURES, payload)
    assert isinstance(message, Features)
    assert (message.version, message.channels, message.method) == (3, (), "ambient")
    assert [mode.frequency_hz.value for mode in message.modes] == [3.141592653589793, 18.25]
    for mode in message.modes:
        assert (mode.identity, mode.kind, mode.shape) == (None, "structural", None)
    # Nothing of the old message is lost on the way.
    old, new = json.loads(payload), json.loads(encode(message))
    assert all(new[key] == old[key] for key in old.keys() - {"version", "modes"})
    for before, after in zip(old["modes"], new["modes"], strict=True):
        assert before == {key: after[key] for key in before}


def test_features_of_the_second_version_are_of_agents_that_did_not_tell_units():
    payload = (GOLDEN / "features" / "v2.json").read_bytes()
    message = decode(FEATURES, payload)
    assert isinstance(message, Features)
    assert (message.version, message.units) == (3, ())
    old, new = json.loads(payload), json.loads(encode(message))
    assert old | {"version": 3, "units": []} == new


def test_states_of_the_first_version_are_of_twins_without_elements():
    payload = (GOLDEN / "state" / "v1.json").read_bytes()
    message = decode(STATE, payload)
    assert isinstance(message, TwinState)
    assert (message.version, message.elements, message.modes, message.suspects) == (
        2,
        {},
        (),
        (),
    )
    old, new = json.loads(payload), json.loads(encode(message))
    assert all(new[key] == old[key] for key in old.keys() - {"version"})


@pytest.mark.parametrize(("version", "clock"), [(1, None), (2, (-0.0025, 1.5e-06))])
def test_the_golden_raw_blocks_decode_for_ever(version, clock):
    payload = (GOLDEN / "raw" / f"v{version}.bin").read_bytes()
    header, body = decode_raw(payload)
    samples = np.frombuffer(body, header.dtype).reshape(header.samples, -1)
    np.testing.assert_array_equal(samples, [[0.5, -1], [1.25, 2], [-3, 0.125]])
    assert (header.twin_id, header.rate_hz, header.epoch) == ("lab.beam-1", 256.0, 41)
    known = header.clock
    assert (known if known is None else (known.relative, known.sd)) == clock
    if version == header.version:
        assert encode_raw(header, bytes(body)) == payload


def test_freezing_again_changes_nothing_and_drift_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(freeze, "folder", lambda: tmp_path)
    assert freeze.main([]) == 0
    written = {path: path.read_text() for path in tmp_path.glob("*/v*.json")}
    assert len(written) == len(MESSAGES) + len(DOCUMENTS) + len(EARLIER)
    assert freeze.main([]) == 0
    path = tmp_path / "health" / "v2.json"
    path.write_text(path.read_text().replace("uptime_s", "up_s"))
    capsys.readouterr()
    assert freeze.main([]) == 2
    assert "Raise VERSION and declare a migration" in capsys.readouterr().err
    assert "up_s" in path.read_text()
    assert freeze.main(["--replace"]) == 0
    assert {path: path.read_text() for path in tmp_path.glob("*/v*.json")} == written


def test_a_version_never_frozen_names_those_that_are():
    with pytest.raises(LookupError, match=r"No schema of 'health' v9. Frozen: .*health v1"):
        schema_text("health", 9)


def describable(schema, path="message"):
    """What Lichtblick's parser of JSON schemas accepts, as far as we use it."""
    assert schema["type"] in ("object", "array", "string", "number", "integer", "boolean"), path
    if schema["type"] == "object":
        for name, part in schema["properties"].items():
            describable(part, f"{path}.{name}")
    if schema["type"] == "array":
        describable(schema["items"], f"{path}[]")


@pytest.mark.parametrize("name", MESSAGES)
def test_plotting_tools_can_read_every_schema(name):
    plain = json.loads(plotting_schema_text(name, MESSAGES[name].VERSION))
    describable(plain)
    assert set(plain["properties"]) == set(MESSAGES[name].model_fields)
