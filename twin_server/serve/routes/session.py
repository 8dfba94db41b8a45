"""Routes of the page's session; the browser keeps the token in an HTTP-only cookie."""

import time

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field
from pydantic_core import to_json

from twin_server.identity.principals import principal_of
from twin_server.serve.access.guard import COOKIE

LONGEST_S = 30 * 86_400
"""Longest life of the cookie [s]: 30 days."""


class SessionModel(BaseModel):
    """The principal of the session."""

    name: str = Field(examples=["ann (1a2b3c4d)"])
    scope: str = Field(examples=["operator"])
    sites: list[str] = Field(examples=[["lab"]])
    until: float | None = Field(description="[s since 1970]", examples=[1_800_000_000.0])


def session() -> APIRouter:
    """Routes of the session."""
    api = APIRouter(tags=["session"], prefix="/api/v1")

    @api.get("/session", response_model=SessionModel)
    def who(request: Request) -> Response:
        """Tell who asks, and what the token is good for."""
        return Response(
            to_json(principal_of(request.scope).to_dict()), media_type="application/json"
        )

    @api.post("/session", response_model=SessionModel)
    def begin(request: Request) -> Response:
        """Keep the token of the header `Authorization` in a cookie, for the page."""
        principal = principal_of(request.scope)
        response = Response(to_json(principal.to_dict()), media_type="application/json")
        kind, _, text = request.headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer" and text.strip():
            left = min(principal.until - time.time(), LONGEST_S)
            response.set_cookie(
                COOKIE,
                text.strip(),
                max_age=max(0, int(left)),
                secure=request.url.scheme == "https",
                httponly=True,
                samesite="strict",
            )
        return response

    @api.delete("/session", status_code=204)
    def end(request: Request) -> Response:
        """Forget the token."""
        response = Response(status_code=204)
        response.delete_cookie(
            COOKIE, secure=request.url.scheme == "https", httponly=True, samesite="strict"
        )
        return response

    return api
