"""What one site is told is the same, to the byte, whether another uses the server or not."""

import itertools
import re

import pytest

from .worlds import Worlds

UNREACHED: dict[tuple[str, str, int], str] = {}
"""Documented answers that no scenario gives, and why."""


@pytest.fixture(scope="module")
def worlds(tmp_path_factory):
    """The scenario, alone and beside another site."""
    return Worlds(tmp_path_factory.mktemp("tenants"))


def reached(document, answers):
    """Operations and statuses that were answered, by the paths of the document."""
    paths = [(re.sub(r"\{[^}]+\}", r"[^/]+", path), path) for path in document["paths"]]
    paths.sort(key=lambda one: one[1].count("{"))
    found = set()
    for one in answers:
        for pattern, path in paths:
            if re.fullmatch(pattern, one.path):
                found.add((one.method.lower(), path, one.status))
                break
    return found


def test_every_answer_is_the_same_with_and_without_the_other_site(worlds):
    differing = [
        (alone, beside)
        for alone, beside in itertools.zip_longest(worlds.alone, worlds.beside)
        if alone != beside
    ]
    assert not differing, "\n\n".join(f"{a}\n{b}" for a, b in differing[:5])
    assert len(worlds.alone) > 500


def test_no_answer_has_the_secret_of_the_other_site(worlds):
    secret = worlds.secret.encode()
    assert sum(secret in one.body for one in worlds.of_other) > 20
    assert [one for one in worlds.beside if secret in one.body] == []


def test_every_documented_answer_of_every_route_was_compared(worlds):
    documented = {
        (method, path, int(status))
        for path, operations in worlds.document["paths"].items()
        for method, operation in operations.items()
        for status in operation["responses"]
    }
    missing = documented - reached(worlds.document, worlds.alone)
    assert missing == set(UNREACHED), sorted(missing ^ set(UNREACHED))
