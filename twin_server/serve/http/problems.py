"""Errors as problem documents (RFC 9457): the value given, the values allowed, advice."""

import logging
import reprlib
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, Field
from pydantic_core import to_json
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from slowtime_services.reasons import MOST_CHARACTERS, without_internals

logger = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"

MOST_ERRORS = 20
"""Faults of one request that are listed; all are counted."""

_SHORT = reprlib.Repr()
"""Quotes what was given only as deep and as far as it is shown."""
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 4, 80, 80
_SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxdict = 20

RETRY_AFTER_S = 5
"""When a caller is to come back whom the database did not answer [s]; a restart takes about so
long."""

CLIENT_LEFT = 499
"""What nginx calls it; nobody is there to read it."""


class Problem(BaseModel):
    """A problem document."""

    type: str = Field(examples=["urn:slowtime:problem:no-such-twin"])
    title: str = Field(examples=["No such twin"])
    status: int = Field(examples=[404])
    detail: str = Field(examples=["No twin is called lab.beam. Allowed: demo.tower."])
    instance: str = Field(examples=["/api/v1/twins/lab.beam"])
    errors: list[dict[str, Any]] | None = None


def answers(says: Mapping[int, str]) -> dict[int | str, dict[str, Any]]:
    """Describe, for the document, the problems that a route may answer with, by status."""
    schema = {"$ref": f"#/components/schemas/{Problem.__name__}"}
    return {
        status: {"description": text, "content": {MEDIA_TYPE: {"schema": schema}}}
        for status, text in says.items()
    }


class ProblemError(Exception):
    """An error that is answered with a problem document.

    Parameters
    ----------
    slug
        Last part of the problem's type.
    detail
        What was given, what is allowed, what to do.
    """

    def __init__(self, status: int, slug: str, detail: str, **headers: str) -> None:
        super().__init__(detail)
        self.status, self.slug, self.detail, self.headers = status, slug, detail, headers


class UnreadableBodyError(HTTPException):
    """A body that is no JSON, or more than is allowed of it; FastAPI lets it through."""

    def __init__(self, reason: str) -> None:
        super().__init__(422, reason)


def problem(
    status: int, slug: str, detail: str, instance: str, **more: Any
) -> tuple[int, bytes]:
    """Status and body of a problem document."""
    title = slug.replace("-", " ").capitalize()
    body = {
        "type": f"urn:slowtime:problem:{slug}",
        "title": title,
        "status": status,
        "detail": without_internals(detail),
        "instance": instance,
        **more,
    }
    return status, to_json(body)


def respond(request: Request, status: int, slug: str, detail: str, **more: Any) -> Response:
    """Answer with a problem document."""
    code, body = problem(status, slug, detail, request.url.path, **more)
    return Response(body, code, media_type=MEDIA_TYPE)


def install(app: FastAPI) -> None:
    """Convert every error of `app` to a problem document."""
    app.add_exception_handler(ProblemError, _ours)
    app.add_exception_handler(RequestValidationError, _not_valid)
    app.add_exception_handler(UnreadableBodyError, _unreadable)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(ClientDisconnect, _left)
    app.add_exception_handler(Exception, _fault)


def install_unavailable(app: FastAPI, *errors: type[Exception]) -> None:
    """Answer these errors, of a database that cannot be used, with 503 and `Retry-After`."""
    for error in errors:
        app.add_exception_handler(error, _unavailable)


async def _unavailable(request: Request, error: Exception) -> Response:
    # What the error names, such as a path or a host, is for the log and `/readyz`.
    logger.warning("%s %s: %s", request.method, request.url.path, error)
    detail = (
        f"{request.method} {request.url.path:.200} needs the database, which cannot be used at "
        f"the moment. Ask again in {RETRY_AFTER_S} s; /readyz and the server's log say why. "
        "Nothing is lost: edge agents keep what is not acknowledged."
    )
    response = respond(request, 503, "database-away", detail)
    response.headers["Retry-After"] = str(RETRY_AFTER_S)
    return response


async def _ours(request: Request, error: Exception) -> Response:
    assert isinstance(error, ProblemError)
    response = respond(request, error.status, error.slug, error.detail)
    response.headers.update(error.headers)
    return response


async def _not_valid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    faults = error.errors()
    errors = [
        {
            "where": ".".join(str(part) for part in fault["loc"])[:MOST_CHARACTERS],
            "given": _short(fault.get("input")),
            "problem": _problem(fault["msg"]),
        }
        for fault in faults[:MOST_ERRORS]
    ]
    first = errors[0]
    detail = (
        f"At {first['where']}, {first['given']} was given: {first['problem']}. {len(faults)} "
        "fault(s) in all. What is allowed is in /api/v1/openapi.json; correct it and send it "
        "again."
    )
    return respond(request, 422, "not-valid", detail, errors=errors)


async def _unreadable(request: Request, error: Exception) -> Response:
    assert isinstance(error, UnreadableBodyError)
    reason = error.detail.removesuffix(".")
    detail = f"The body cannot be read: {reason}. Correct it and send it again."
    fault = {"where": "body", "problem": reason}
    return respond(request, 422, "not-valid", detail, errors=[fault])


async def _http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    path, method = request.url.path, request.method
    if error.status_code == HTTPStatus.NOT_FOUND:
        slug, detail = (
            "no-such-address",
            (
                f"{path:.200} was asked for, which does not exist. What does is listed in "
                "/api/v1/openapi.json."
            ),
        )
    elif error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        slug, detail = (
            "method-not-allowed",
            (
                f"{method} {path:.200} was given. Allowed: {headers.get('Allow', 'GET')}. Use "
                "one of these."
            ),
        )
    else:
        slug = HTTPStatus(error.status_code).phrase.lower().replace(" ", "-")
        detail = f"{method} {path:.200} was given: {error.detail}."
    response = respond(request, error.status_code, slug, detail)
    response.headers.update(headers)
    return response


async def _left(request: Request, error: Exception) -> Response:
    """Answer nothing: the client has disconnected."""
    logger.debug("%s %s: the client disconnected.", request.method, request.url.path)
    return Response(status_code=CLIENT_LEFT)


async def _fault(request: Request, error: Exception) -> Response:
    logger.error("%s %s failed.", request.method, request.url.path, exc_info=error)
    detail = (
        f"{request.method} {request.url.path:.200} failed. This is a fault of the server, not "
        "of the request; its log says more. Try again, and report it."
    )
    return respond(request, 500, "fault-of-ours", detail)


def _problem(message: str) -> str:
    """Return what pydantic says, which quotes some values whole, at its largest length."""
    text = message.removeprefix("Value error, ").removesuffix(".")
    return text if len(text) <= MOST_CHARACTERS else f"{text[:MOST_CHARACTERS]} ..."


def _short(given: Any) -> str:
    text = _SHORT.repr(given)
    return text if len(text) <= 80 else text[:77] + "..."
