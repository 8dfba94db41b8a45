"""Requests generated from the OpenAPI document: every operation with right and wrong parts."""

from typing import Any

from .house import Answer
from .scenario import Tenant

PARTS = {
    "twin_id": (
        "{site}.beam",
        "{site}.unknown",
        "{site}.Wrong",
        "{other}.beam",
        "{other}.none",
    ),
    "composite_id": (
        "{site}.line",
        "{site}.unknown",
        "{site}.Wrong",
        "{other}.line",
        "{other}.none",
    ),
    "name": ("monday.mcap", "unknown.mcap", "report.json", "x"),
    "number": ("1", "99", "none"),
    "event_id": ("0" * 32, "none"),
    "holding_id": ("0" * 16, "none"),
}
"""What stands in the place of each part of a path."""

BODIES: tuple[Any, ...] = ({}, [], {"unheard": "of"})


def sweep(tenant: Tenant, document: dict[str, Any]) -> list[Answer]:
    """Ask every operation with each of some parts of its path, queries and bodies.

    What deletes something of the site's own is left to the scenario.
    """
    for path, operations in sorted(document["paths"].items()):
        for method, operation in sorted(operations.items()):
            filled = _filled(tenant, path)
            tenant.ask(None, method.upper(), filled[0])
            if method != "get":
                elsewhere = {"Sec-Fetch-Site": "cross-site"}
                tenant.ask("admin", method.upper(), filled[0], headers=elsewhere)
            for one in filled:
                _ask_each(tenant, method.upper(), one, operation)
    return tenant.answers


def _filled(tenant: Tenant, path: str) -> list[str]:
    other = "plant" if tenant.site == "lab" else "lab"
    found = [path]
    for part, values in PARTS.items():
        found = [
            one.replace(f"{{{part}}}", value.format(site=tenant.site, other=other))
            for one in found
            for value in (values if f"{{{part}}}" in path else ("",))
        ]
    return found


def _ask_each(tenant: Tenant, method: str, path: str, operation: dict[str, Any]) -> None:
    own = any(f"{tenant.site}.{name}" in path for name in ("beam", "line"))
    if method == "DELETE" and (own or path.endswith("/session")):
        return
    for scope in ("viewer", "admin"):
        if "requestBody" not in operation:
            tenant.ask(scope, method, path)
            continue
        for body in BODIES:
            if method == "PUT" and body == {} and scope == "admin" and "twins" in path:
                continue  # it would register another twin, or this one anew
            tenant.ask(scope, method, path, json=body)
    for parameter in operation.get("parameters", ()):
        if parameter["in"] == "query":
            wrong = {parameter["name"]: "\u00e9\u0000"}
            tenant.ask("viewer", method, path, params=wrong)
