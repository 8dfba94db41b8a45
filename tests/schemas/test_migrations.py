"""Old versions come up to date step by step; unknown ones are refused with what to do."""

import copy
import json
from pathlib import Path

import pytest

from slowtime_schemas.migrations import MIGRATIONS, Migrations, UnknownVersionError, migrate
from slowtime_schemas.streams import MESSAGES


@pytest.fixture
def registry():
    registry = Migrations({"note": 3, "other": 1})

    @registry.step("note", from_version=1)
    def _(payload):
        payload["text"] = payload.pop("body")
        return payload

    @registry.step("note", from_version=2)
    def _(payload):
        return {**payload, "lines": [*payload["lines"], "end"], "tags": ["migrated"]}

    return registry


def test_a_chain_of_steps_leads_to_the_current_version(registry):
    assert registry.versions("note") == [1, 2, 3]
    assert registry.missing() == []
    assert registry.migrate("note", {"version": 1, "body": "b", "lines": []}) == {
        "version": 3,
        "text": "b",
        "tags": ["migrated"],
        "lines": ["end"],
    }


OLDER = [
    path
    for path in sorted((Path(__file__).parents[2] / "schemas" / "golden").glob("*/v*.json"))
    if path.parent.name in MESSAGES and path.stem != f"v{MESSAGES[path.parent.name].VERSION}"
]


@pytest.mark.parametrize("path", OLDER, ids=lambda path: f"{path.parent.name}_{path.stem}")
def test_what_was_given_is_left_as_it_was(path):
    given = json.loads(path.read_text())
    before = copy.deepcopy(given)
    migrate(path.parent.name, given)
    assert given == before


def test_the_current_version_passes_unchanged(registry):
    payload = {"version": 3, "anything": 1}
    assert registry.migrate("note", payload) == payload


@pytest.mark.parametrize(
    ("version", "text"),
    [
        (4, "version 4 was given. Allowed: 1, 2, 3. It comes from newer software: update"),
        (0, 'version 0 was given. Allowed: 1, 2, 3. Send "version" as one of these'),
        ("1", "version '1' was given"),
        (None, "version None was given"),
        (True, "version True was given"),
        (1.0, "version 1.0 was given"),
    ],
)
def test_an_unknown_version_says_what_is_allowed_and_what_to_do(registry, version, text):
    with pytest.raises(UnknownVersionError, match=text):
        registry.migrate("note", {"version": version, "body": "", "lines": []})


def test_a_missing_step_is_found_and_not_jumped_over():
    registry = Migrations({"note": 3})
    registry.step("note", from_version=1)(lambda payload: payload)
    assert registry.missing() == [("note", 2)]
    assert registry.versions("note") == [3]
    with pytest.raises(UnknownVersionError, match="Allowed: 3"):
        registry.migrate("note", {"version": 1})


@pytest.mark.parametrize("version", [0, 1, 3])
def test_a_step_that_leads_nowhere_or_exists_is_refused(registry, version):
    with pytest.raises(ValueError, match=r"cannot be declared.*Raise VERSION first"):
        registry.step("note", from_version=version)


def test_every_message_of_the_house_has_all_its_steps():
    assert MIGRATIONS.missing() == []
    for name, message in MESSAGES.items():
        assert migrate(name, {"version": message.VERSION})["version"] == message.VERSION
