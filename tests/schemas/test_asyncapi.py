"""The AsyncAPI document says what the registry says, and is one by its own specification."""

import json
import shutil
import subprocess
import tarfile
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest

from slowtime_schemas import asyncapi
from slowtime_schemas.codec import decode
from slowtime_schemas.streams import REQUESTS, STREAMS, alive_key, request_key

SCHEMAS = Path(__file__).parents[2] / "schemas"
FILE, GOLDEN = SCHEMAS / "asyncapi.json", SCHEMAS / "golden"
DOCUMENT = json.loads(FILE.read_text())
SPECIFICATION = "@asyncapi/specs@6.11.1"


def resolve(reference: str) -> Any:
    node = DOCUMENT
    for step in reference.removeprefix("#/").split("/"):
        node = node[step]
    return node


def references(node: Any) -> list[str]:
    if isinstance(node, list):
        return [found for part in node for found in references(part)]
    if not isinstance(node, dict):
        return []
    own = [node["$ref"]] if isinstance(node.get("$ref"), str) else []
    return own + [found for part in node.values() for found in references(part)]


def test_the_file_is_what_the_code_makes():
    told = "Run `python -m slowtime_schemas.asyncapi` in schemas/."
    assert FILE.read_text() == asyncapi.text(), told


def test_its_channels_are_the_streams_and_requests_and_no_others():
    place = ("{site}", "{asset}")
    keys = {stream.key(*place) for stream in STREAMS} | {alive_key(*place)}
    keys |= {request_key(*place, what) for what in REQUESTS}
    assert {channel["address"] for channel in DOCUMENT["channels"].values()} == keys
    assert set(asyncapi.ANSWERED_BY) == set(REQUESTS)


def test_every_reference_leads_somewhere():
    found = references(DOCUMENT)
    assert len(found) > 50
    for reference in found:
        assert resolve(reference)


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.name)
def test_a_message_says_who_sends_it_and_how(stream):
    does = "send" if stream.sender == "twin" else "receive"
    operation = DOCUMENT["operations"][f"{does}_{stream.name}"]
    assert operation["action"] == does
    message = resolve(resolve(operation["messages"][0]["$ref"])["$ref"])
    assert message["contentType"] == stream.encoding
    assert message["x-recorded"] is stream.recorded


@pytest.mark.parametrize(
    "stream", [s for s in STREAMS if s.message is not None], ids=lambda stream: stream.name
)
def test_what_the_code_reads_the_schema_allows_and_what_it_refuses_not(stream):
    name, version = stream.message.MESSAGE, stream.message.VERSION
    payload = (GOLDEN / name / f"v{version}.json").read_bytes()
    decode(stream, payload)
    schema = {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "components": DOCUMENT["components"],
        **DOCUMENT["components"]["messages"][stream.name]["payload"],
    }
    validator = jsonschema_rs.validator_for(schema)
    content = json.loads(payload)
    assert [str(error) for error in validator.iter_errors(content)] == []
    assert not validator.is_valid(content | {"unheard_of": 1})
    assert not validator.is_valid(content | {"sequence": -1})


@pytest.mark.slow
def test_it_is_one_by_the_schema_that_asyncapi_publishes(tmp_path: Path):
    if (npm := shutil.which("npm")) is None:
        pytest.skip("the published schema comes as a package of npm, which is not here")
    packed = subprocess.run(
        [npm, "pack", "--silent", SPECIFICATION],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if packed.returncode:
        pytest.skip("npm cannot reach its registry")
    with tarfile.open(tmp_path / packed.stdout.split()[-1]) as package:
        member = package.extractfile("package/schemas/3.0.0-without-$id.json")
        assert member is not None
        validator = jsonschema_rs.validator_for(json.load(member))
    assert [str(error)[:300] for error in validator.iter_errors(DOCUMENT)] == []
    assert not validator.is_valid(DOCUMENT | {"channels": {"features": {"adress": "a"}}})
