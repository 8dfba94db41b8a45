"""The scope and sites that each route requires; unknown ones require an admin of all sites.

A new route is added here, with the least scope that will do, and to `docs/access.md` by the
command that its test prints.
"""

import dataclasses
import enum
import re

from starlette.routing import compile_path

from twin_server.identity.principals import Scope


class Reach(enum.Enum):
    """The sites that a caller must belong to."""

    OPEN = "anybody, without a token"
    ANY = "of any site"
    LISTED = "of any site; sees its own"
    TWIN = "of the twin's site"
    ALL = "of all sites"


@dataclasses.dataclass(frozen=True, slots=True)
class Rule:
    """Scope and sites that one route requires."""

    method: str
    path: str
    reach: Reach
    scope: Scope = Scope.VIEWER

    @property
    def pattern(self) -> re.Pattern[str]:
        """The expression by which Starlette matches the path."""
        return compile_path(self.path)[0]


_V1 = "/api/v1"
_TWIN = f"{_V1}/twins/{{twin_id}}"
_COMPOSITE = f"{_V1}/composites/{{composite_id}}"
_RECORDING = f"{_V1}/recordings/{{name}}"
_SEE = [(f"{_TWIN}{more}", Scope.VIEWER) for more in (
    "", "/history", "/history/hash", "/history/export", "/dtdl", "/modes", "/shapes",
    "/forecast", "/forecast/record",
    "/plan", "/risk", "/events", "/events/recorded", "/changes",
    "/live", "/gap", "/fatigue", "/virtual",
    "/alarms", "/alarms/deliveries",
    "/memberships", "/quarantine", "/ledger",
    "/diagnoses", "/diagnoses/{number}", "/diagnoses/{number}/{name}",
)]  # fmt: skip
_DO = [
    ("PUT", _TWIN, Scope.OPERATOR),
    ("DELETE", _TWIN, Scope.ADMIN),
    ("POST", f"{_TWIN}/simulate", Scope.VIEWER),
    ("POST", f"{_TWIN}/events", Scope.OPERATOR),
    ("POST", f"{_TWIN}/changes", Scope.OPERATOR),
    ("POST", f"{_TWIN}/alarms/test", Scope.OPERATOR),
    ("POST", f"{_TWIN}/alarms/{{event_id}}/acknowledge", Scope.OPERATOR),
    ("POST", f"{_TWIN}/quarantine/{{number}}/release", Scope.OPERATOR),
    ("DELETE", f"{_TWIN}/quarantine/{{number}}", Scope.OPERATOR),
    ("POST", f"{_TWIN}/diagnoses", Scope.OPERATOR),
    ("DELETE", f"{_TWIN}/diagnoses/{{number}}", Scope.OPERATOR),
    ("POST", f"{_TWIN}/diagnoses/{{number}}/adopt", Scope.OPERATOR),
    ("POST", f"{_TWIN}/diagnoses/{{number}}/undo", Scope.OPERATOR),
]

POLICY: tuple[Rule, ...] = (
    Rule("GET", "/", Reach.OPEN),
    Rule("GET", "/assets/{name}", Reach.OPEN),
    Rule("GET", "/assets/messages/{name}", Reach.OPEN),
    Rule("GET", "/healthz", Reach.OPEN),
    Rule("GET", "/readyz", Reach.OPEN),
    Rule("GET", f"{_V1}/openapi.json", Reach.OPEN),
    Rule("GET", f"{_V1}/asyncapi.json", Reach.OPEN),
    Rule("GET", "/metrics", Reach.ALL),
    Rule("GET", f"{_V1}/session", Reach.ANY),
    Rule("POST", f"{_V1}/session", Reach.ANY),
    Rule("DELETE", f"{_V1}/session", Reach.OPEN),
    Rule("GET", f"{_V1}/twins", Reach.LISTED),
    Rule("GET", f"{_V1}/dtdl", Reach.LISTED),
    Rule("GET", f"{_V1}/fleet/plan", Reach.LISTED),
    # Entries hold numbers of boots, which are counted over all sites.
    Rule("GET", f"{_V1}/ledger/heads", Reach.ALL),
    Rule("GET", f"{_V1}/ledger/chains/{{chain}}/consistency", Reach.ALL),
    Rule("GET", f"{_V1}/ledger/chains/{{chain}}/inclusion", Reach.ALL),
    Rule("GET", f"{_V1}/recordings", Reach.LISTED),
    Rule("GET", _RECORDING, Reach.LISTED),
    Rule("PUT", _RECORDING, Reach.LISTED, Scope.OPERATOR),
    Rule("DELETE", _RECORDING, Reach.LISTED, Scope.ADMIN),
    Rule("POST", f"{_RECORDING}/replay", Reach.LISTED, Scope.OPERATOR),
    Rule("DELETE", f"{_RECORDING}/replay", Reach.LISTED, Scope.OPERATOR),
    Rule("GET", f"{_V1}/holdings", Reach.LISTED),
    Rule("DELETE", f"{_V1}/holdings/{{holding_id}}", Reach.LISTED, Scope.ADMIN),
    Rule("GET", f"{_V1}/composites", Reach.LISTED),
    Rule("GET", _COMPOSITE, Reach.TWIN),
    Rule("PUT", _COMPOSITE, Reach.TWIN, Scope.OPERATOR),
    Rule("DELETE", _COMPOSITE, Reach.TWIN, Scope.ADMIN),
    Rule("GET", f"{_COMPOSITE}/members", Reach.TWIN),
    Rule("GET", f"{_COMPOSITE}/revisions", Reach.TWIN),
    Rule("GET", f"{_COMPOSITE}/events", Reach.TWIN),
    *(Rule("GET", path, Reach.TWIN, scope) for path, scope in _SEE),
    *(Rule(method, path, Reach.TWIN, scope) for method, path, scope in _DO),
)

UNKNOWN = Rule("*", "*", Reach.ALL, Scope.ADMIN)
"""What a route wants that has no rule."""

_PATTERNS = [(rule, rule.pattern) for rule in POLICY]


def find(method: str, path: str) -> tuple[Rule, str | None]:
    """Rule of a request, and the twin or the composite it is about.

    Examples
    --------
    >>> rule, twin_id = find("GET", "/api/v1/twins/lab.beam/history")
    >>> rule.reach.name, rule.scope.word, twin_id
    ('TWIN', 'viewer', 'lab.beam')
    >>> find("GET", "/api/v1/secret")[0] is UNKNOWN
    True
    """
    asked = "GET" if method == "HEAD" else method
    for rule, pattern in _PATTERNS:
        if rule.method == asked and (match := pattern.match(path)) is not None:
            found = match.groupdict()
            return rule, found.get("twin_id", found.get("composite_id"))
    return UNKNOWN, None
