"""Counts requests for their site and token, and refuses what is over a quota."""

import re

from starlette.types import ASGIApp, Receive, Scope, Send

from twin_server.fairness import Holder, OverQuotaError, acting_for
from twin_server.identity.principals import principal_of

from .problems import ProblemError

_TWIN = re.compile(r"^/api/v1/(?:twins|composites)/([^/]+)")


class CountedForHolder:
    """ASGI middleware around whatever takes slots or turns."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, in a context that says for whom it counts."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        found = _TWIN.match(scope["path"])
        holder = Holder.of(principal_of(scope), found[1] if found else None)
        with acting_for(holder):
            await self._app(scope, receive, send)


def over_quota(error: OverQuotaError, retry_after_s: int, slug: str = "busy") -> ProblemError:
    """Make the answer to who takes more than may be held now.

    Parameters
    ----------
    retry_after_s
        When to come back [s].
    slug
        Kind of the problem where the caller's own share is not what is exceeded.
    """
    headers = {"Retry-After": str(retry_after_s)}
    if error.own:
        return ProblemError(429, "over-quota", str(error), **headers)
    return ProblemError(503, slug, str(error), **headers)


def cancelled_error() -> ProblemError:
    """Make the answer to whose request was ended from outside."""
    return ProblemError(
        503, "cancelled", "It was cancelled by an admin of its site. Ask them, or ask again."
    )
