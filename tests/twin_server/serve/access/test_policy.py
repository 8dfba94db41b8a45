"""Every route × every kind of caller, found from the application itself, and its table."""

import os
from pathlib import Path

import pytest
from fastapi.routing import iter_route_contexts

from twin_server.registration.twin import Registration
from twin_server.serve.access import POLICY, Reach, Scope, find
from twin_server.serve.access.policy import UNKNOWN

ROOT = Path(__file__).parents[4]
TABLE = ROOT / "docs/access.md"
UPDATE = "SLOWTIME_WRITE=1 pytest tests/twin_server/serve/access/test_policy.py"
CALLERS = (
    "no token", "viewer", "operator", "admin", "admin of all", "other site", "expired",
    "revoked",
)  # fmt: skip
FILLED = {
    "{twin_id}": "lab.beam", "{composite_id}": "lab.line",
    "{name}": "report.json", "{number}": "1", "{event_id}": "0" * 32,
    "{holding_id}": "0" * 16, "{chain}": "lab.beam",
}  # fmt: skip
HEAD = """\
# Who may ask what

Written by the test that tries it (`tests/twin_server/serve/access/test_policy.py`): each route
of the application, asked with each kind of token, over the real door. *viewer*, *operator* and
*admin* are tokens of the twin's site, *other site* is an admin's of another; *expired* and
*revoked* were an admin's of all sites. 401 is "who are you?", 403 "not you". A route that is
not in the policy (`twin_server/serve/access/policy.py`) fails the build, and is an admin's of
all sites until then.

Whoever asks, with a token or on a server without: what changes anything (`PUT`, `POST`,
`DELETE`) is refused with 403 where a browser says that a page of another site asks
(`Sec-Fetch-Site`, or `Origin` with another host than the request's). Programs say neither.

"""


def routes(app):
    """Method and path of everything that the application answers."""
    found = {
        (method, context.path)
        for context in iter_route_contexts(app.routes)
        for method in context.methods or ()
    }
    return sorted((m, p) for m, p in found if m != "HEAD" or ("GET", p) not in found)


def path_of(template):
    for part, value in FILLED.items():
        template = template.replace(part, value)
    assert "{" not in template, f"tell FILLED what {template} is asked with"
    return template


def body_of(template):
    return {"members": ["lab.beam"]} if template.endswith("{composite_id}") else {}


def wanted(rule, caller):
    """What the policy says of a caller: None where it may."""
    if rule.reach is Reach.OPEN:
        return None
    if caller in ("no token", "expired", "revoked"):
        return 401
    scope = Scope.ADMIN if caller in ("other site", "admin of all") else Scope.of(caller)
    if scope < rule.scope:
        return 403
    beyond = (rule.reach is Reach.TWIN and caller == "other site") or (
        rule.reach is Reach.ALL and caller != "admin of all"
    )
    return 403 if beyond else None


@pytest.fixture(scope="module")
def tried(door):
    """Status of each route for each caller."""
    found = {}
    for method, template in routes(door.app):
        for caller in CALLERS:
            door.pipeline.register("lab.beam", Registration())
            answer = door.ask(
                method,
                path_of(template),
                door.words.get(caller),
                json=body_of(template) if method in ("PUT", "POST") else None,
            )
            found[method, template, caller] = answer.status_code
    return found


def test_every_route_has_a_rule(door):
    without = [
        route for route in routes(door.app) if find(route[0], path_of(route[1]))[0] is UNKNOWN
    ]
    assert without == [], "give each a line in twin_server/serve/access/policy.py"


def test_every_rule_has_a_route(door):
    known = set(routes(door.app))
    assert [rule for rule in POLICY if (rule.method, rule.path) not in known] == []


def test_every_route_lets_in_whom_the_policy_says_and_nobody_else(door, tried):
    wrong = [
        (method, template, caller, status)
        for (method, template, caller), status in tried.items()
        for want in [wanted(find(method, path_of(template))[0], caller)]
        if (status if status in (401, 403) else None) != want or status >= 500
    ]
    assert wrong == []


def test_the_table_in_the_documents_is_what_was_found(door, tried):
    lines = [
        "| route | wants | " + " | ".join(CALLERS) + " |",
        "|---" * (2 + len(CALLERS)) + "|",
    ]
    for method, template in routes(door.app):
        rule, _ = find(method, path_of(template))
        cells = [
            str(status) if status in (401, 403) else "yes"
            for caller in CALLERS
            for status in [tried[method, template, caller]]
        ]
        wants = (
            "nothing" if rule.reach is Reach.OPEN else f"{rule.scope.word} {rule.reach.value}"
        )
        lines.append(f"| `{method} {template}` | {wants} | " + " | ".join(cells) + " |")
    text = HEAD + "\n".join(lines) + "\n"
    if os.environ.get("SLOWTIME_WRITE"):
        TABLE.write_text(text)
    assert TABLE.read_text() == text, f"write it anew: {UPDATE}"


def test_what_has_no_rule_is_for_an_admin_of_all_sites(door):
    for caller in ("viewer", "operator", "admin"):
        answer = door.ask("GET", "/api/v1/unheard-of", door.words[caller])
        assert answer.status_code == 403
    assert door.ask("GET", "/api/v1/unheard-of").status_code == 401
    assert door.ask("GET", "/api/v1/unheard-of", door.words["admin of all"]).status_code == 404


@pytest.mark.parametrize(
    "path",
    [
        "/api/v1/twins/lab.beam/",
        "/api/v1//twins/lab.beam",
        "/api/v1/twins/lab.beam%2Fhistory",
        "/api/v1/twins/lab.beam/../other.secret",
        "//api/v1/twins",
        "/API/v1/twins",
        "/api/v1/twins/other.secret%00",
        "/api/v1/twins/other.secret;lab.beam",
        "/assets/../../settings.py",
        "/assets/..%2f..%2fsettings.py",
    ],
)
def test_no_spelling_of_a_path_goes_around_the_door(door, path):
    answer = door.ask("GET", path, door.words["viewer"])
    if answer.status_code == 200:
        assert answer.json()["id" if "id" in answer.json() else "points"] in ("lab.beam", [])
    else:
        assert answer.status_code in (307, 403, 404, 422)
    if "assets" not in path:
        assert door.ask("GET", path).status_code == 401


def test_what_is_about_a_twin_or_a_composite_is_for_its_site_alone():
    about_one = [
        rule for rule in POLICY if "{twin_id}" in rule.path or "{composite_" in rule.path
    ]
    assert about_one
    assert [rule for rule in about_one if rule.reach is not Reach.TWIN] == []
