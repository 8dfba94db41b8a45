"""What docs/events.md shows is what the server takes and what the commands understand."""

import json
import re
import shlex
from pathlib import Path

import pytest

from slowtime_schemas.asset_events import EventContent
from slowtime_schemas.twin_changes import CORRECTABLE, TwinChangeOrder
from tests.docs.commands import parse
from twin_server.events.asset_events import QUESTION, TOLD, AssetEventOrder

PAGE = (Path(__file__).parents[2] / "docs/events.md").read_text()
CHANGE = re.findall(r"```json change\n(.*?)```", PAGE, re.S)
BLOCKS = re.findall(r"```json order\n(.*?)```", PAGE, re.S)
TYPED = [shlex.split(line) for line in re.findall(r"^    slowtime (.+)$", PAGE, re.M)]


@pytest.mark.parametrize("text", BLOCKS)
def test_every_example_is_one(text):
    AssetEventOrder.model_validate(json.loads(text))


def test_the_example_of_a_correction_is_one():
    order = TwinChangeOrder.model_validate(json.loads(*CHANGE))
    assert order.event == AssetEventOrder.model_validate(json.loads(BLOCKS[0])).event


@pytest.mark.parametrize("arguments", TYPED, ids=" ".join)
def test_every_command_parses(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parse(arguments, tmp_path)


def test_every_field_and_kind_is_described():
    described = set(re.findall(r"`(\w+)`", PAGE))
    assert set(EventContent.model_fields) | {"event", "at", "slow_time", "person"} <= described
    assert {*CORRECTABLE, "corrects"} <= described
    assert {TOLD, QUESTION, "model_changed", "alarm_cleared"} <= described
    assert {arguments[2] for arguments in TYPED} == {"add", "list", "undo"}
