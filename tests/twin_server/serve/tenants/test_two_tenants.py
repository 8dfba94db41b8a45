"""What one site is told is the same, to the byte, whether another uses the server or not."""

import itertools
import re

import pytest

from .scenario import brief, scenario
from .worlds import Worlds

OVER_QUOTA = 429
"""What `tests/twin_server/serve/routes/test_quotas.py` tests with two sites."""

UNREACHED: dict[tuple[str, str, int], str] = {}
"""Documented answers that no scenario gives, and why."""


@pytest.fixture(scope="module")
def worlds(tmp_path_factory):
    """The scenario, alone and beside another site."""
    return Worlds(tmp_path_factory.mktemp("tenants"), scenario, swept=True)


def compare(worlds):
    """Compare all answers of one site, and look for the secret of the other."""
    differing = [
        (alone, beside)
        for alone, beside in itertools.zip_longest(worlds.alone, worlds.beside)
        if alone != beside
    ]
    assert not differing, "\n\n".join(f"{a}\n{b}" for a, b in differing[:5])
    secret = worlds.secret.encode()
    assert sum(secret in one.body for one in worlds.of_other) > 10
    assert [one for one in worlds.beside if secret in one.body] == []


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


def test_what_is_quick_is_the_same_with_and_without_the_other_site(tmp_path):
    compare(Worlds(tmp_path, brief, swept=False))


@pytest.mark.long
def test_every_answer_is_the_same_with_and_without_the_other_site(worlds):
    compare(worlds)
    assert len(worlds.alone) > 500


@pytest.mark.long
def test_every_documented_answer_of_every_route_was_compared(worlds):
    documented = {
        (method, path, int(status))
        for path, operations in worlds.document["paths"].items()
        for method, operation in operations.items()
        for status in operation["responses"]
        if int(status) != OVER_QUOTA
    }
    missing = documented - reached(worlds.document, worlds.alone)
    assert missing == set(UNREACHED), sorted(missing ^ set(UNREACHED))
