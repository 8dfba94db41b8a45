"""What one site is told is the same, to the byte, whether another uses the server or not."""

import itertools
import re

import pytest

from .scenario import brief, scenario
from .worlds import Worlds

BEFORE_ROUTES = {
    429: "the guard and quotas count requests, whatever the route; it depends on time",
    413: "a limit of all bodies",
    503: "a queue is full, or the server ends; the texts have no counts",
    507: "the folder of recordings is full; the text is that of the setting",
    501: "of a server without pyarrow",
}
"""Documented statuses that do not depend on what a route knows, and why none is asked for."""

UNREACHED: dict[str, tuple[str, ...]] = {
    "for tokens of all sites": (
        "get /ledger/heads 200",
        "get /ledger/heads 422",
        "get /ledger/chains/{chain}/consistency 200",
        "get /ledger/chains/{chain}/consistency 404",
        "get /ledger/chains/{chain}/consistency 409",
        "get /ledger/chains/{chain}/consistency 422",
        "get /ledger/chains/{chain}/inclusion 200",
        "get /ledger/chains/{chain}/inclusion 404",
        "get /ledger/chains/{chain}/inclusion 409",
        "get /ledger/chains/{chain}/inclusion 422",
        "get /metrics 200",
    ),
    "needs a key; a tree head is a hash of entries that are sealed with it": (
        "get /twins/{twin_id}/ledger 200",
        "get /twins/{twin_id}/ledger 409",
    ),
    "a token of any site may": (
        "get /composites 403",
        "get /dtdl 403",
        "get /fleet/plan 403",
        "get /holdings 403",
        "get /recordings 403",
        "get /recordings/{name} 403",
        "get /session 403",
        "get /twins 403",
    ),
    "asked without keeping the answer, whose state depends on the machine": (
        "delete /twins/{twin_id}/diagnoses/{number} 202",
        "post /twins/{twin_id}/diagnoses 202",
    ),
    "needs a model with a geometry": ("get /twins/{twin_id}/shapes 200",),
    "needs a message whose estimation fails": (
        "delete /twins/{twin_id}/quarantine/{number} 204",
        "delete /twins/{twin_id}/quarantine/{number} 409",
        "get /twins/{twin_id}/quarantine 409",
        "post /twins/{twin_id}/quarantine/{number}/release 204",
        "post /twins/{twin_id}/quarantine/{number}/release 409",
    ),
    "documented for all routes of its module, given by others of them": (
        "delete /holdings/{holding_id} 200",
        "delete /holdings/{holding_id} 409",
        "get /composites/{composite_id} 409",
        "get /composites/{composite_id}/events 404",
        "get /composites/{composite_id}/events 409",
        "get /composites/{composite_id}/members 409",
        "get /composites/{composite_id}/revisions 409",
        "get /recordings 404",
        "get /recordings 409",
        "get /recordings 422",
        "get /recordings/{name} 409",
        "get /twins/{twin_id}/alarms 409",
        "get /twins/{twin_id}/alarms/deliveries 409",
        "get /twins/{twin_id}/changes 409",
        "get /twins/{twin_id}/diagnoses 409",
        "get /twins/{twin_id}/diagnoses/{number} 409",
        "get /twins/{twin_id}/diagnoses/{number}/{name} 409",
        "get /twins/{twin_id}/events/recorded 409",
        "get /twins/{twin_id}/gap 409",
        "get /twins/{twin_id}/memberships 409",
        "put /composites/{composite_id} 404",
        "put /composites/{composite_id} 409",
        "put /recordings/{name} 404",
        "put /twins/{twin_id} 404",
    ),
}
"""Documented answers that the scenario does not give, by the reason."""


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
        if int(status) not in BEFORE_ROUTES
    }
    missing = {
        f"{method} {path.removeprefix('/api/v1')} {status}"
        for method, path, status in documented - reached(worlds.document, worlds.alone)
    }
    stated = {one for several in UNREACHED.values() for one in several}
    assert missing == stated, sorted(missing ^ stated)
