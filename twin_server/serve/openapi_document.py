"""Adds security schemes and refusals to the OpenAPI document that FastAPI writes."""

from typing import Any

from fastapi import FastAPI

from .access.guard import COOKIE, SAFE
from .access.policy import Reach, find
from .http import problems

SCHEMES = {
    "token": {
        "type": "http",
        "scheme": "bearer",
        "description": "A token of `slowtime tokens add`, or a JWT of the OpenID provider. A "
        "server without tokens, which listens on its own machine only, asks for none.",
    },
    "page": {
        "type": "apiKey",
        "in": "cookie",
        "name": COOKIE,
        "description": "What `POST /api/v1/session` leaves with a browser.",
    },
}
NEEDED: list[dict[str, list[str]]] = [{name: []} for name in SCHEMES]

REFUSALS = problems.answers(
    {
        401: "No token, or one that has ended, was revoked or is not known",
        403: "A token that may not, or a page of another site",
        429: "Asked too often; `Retry-After` says when to come back",
    }
)


def document(app: FastAPI) -> None:
    """Add to the document of `app` the token that each route needs, and the refusals."""
    written = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            found, schema = written(), problems.Problem.model_json_schema()
            found.setdefault("components", {})["securitySchemes"] = SCHEMES
            found["components"].setdefault("schemas", {})["Problem"] = schema
            for path, operations in found["paths"].items():
                for method, operation in operations.items():
                    _add(method.upper(), path, operation)
        assert app.openapi_schema is not None
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _add(method: str, path: str, operation: dict[str, Any]) -> None:
    rule, _ = find(method, path)
    refusals = {429} if method in SAFE else {403, 429}
    if rule.reach is not Reach.OPEN:
        refusals |= {401, 403}
        operation["security"] = NEEDED
        whom = f"{rule.scope.word} {rule.reach.value}"
        told = operation.get("description", "").rstrip()
        operation["description"] = f"{told}\n\nWants: {whom}.".lstrip()
    for status in sorted(refusals):
        operation["responses"].setdefault(str(status), REFUSALS[status])
