"""What docs/foresight.md shows is what the server takes and what the commands understand."""

import json
import re
import shlex
from pathlib import Path

import pytest
from pydantic import BaseModel

from slowtime_schemas.answers.forecasts import CrossingModel
from tests.docs.commands import parse
from twin_server.orders import SimulationOrder
from twin_server.registration.twin import Registration

PAGE = (Path(__file__).parents[2] / "docs/foresight.md").read_text()
BLOCKS = re.findall(r"```json ?(\w*)\n(.*?)```", PAGE, re.S)
TYPED = [shlex.split(line) for line in re.findall(r"^    slowtime (.+)$", PAGE, re.M)]
OF: dict[str, type[BaseModel]] = {
    "": CrossingModel,
    "registration": Registration,
    "order": SimulationOrder,
}


@pytest.mark.parametrize(("kind", "text"), BLOCKS)
def test_every_example_is_one(kind, text):
    OF[kind].model_validate(json.loads(text))


@pytest.mark.parametrize("arguments", TYPED, ids=" ".join)
def test_every_command_parses(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parse(arguments, tmp_path)


def test_all_kinds_of_example_are_shown():
    assert {kind for kind, _ in BLOCKS} == set(OF)
    assert {arguments[1] for arguments in TYPED} == {"forecast", "whatif"}
