"""Admits only the front of a fleet to a shard, by a secret that both were given."""

import hmac

from starlette.types import ASGIApp, Receive, Scope, Send

from twin_server.serve.http.problems import MEDIA_TYPE, problem

from .messages import PREFIX

HEADER = b"x-slowtime-shard-key"
"""Header in which the front sends the secret; one that a client sends is not passed on."""


class ShardDoor:
    """ASGI application of one shard: its REST, and the routes for the front alone.

    Parameters
    ----------
    rest
        Application of REST and page, with its access control.
    interface
        Application of the routes below `PREFIX`. The front has checked who asks.
    key
        The secret.
    """

    def __init__(self, rest: ASGIApp, interface: ASGIApp, key: str) -> None:
        self._rest, self._interface, self._key = rest, interface, key.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what comes from the front, and refuse all else."""
        if scope["type"] != "http":
            await self._rest(scope, receive, send)
            return
        given = dict(scope["headers"]).get(HEADER, b"")
        if not hmac.compare_digest(given, self._key):
            await _refuse(scope, send)
        elif scope["path"].startswith(PREFIX):
            await self._interface(scope, receive, send)
        else:
            await self._rest(scope, receive, send)


async def _refuse(scope: Scope, send: Send) -> None:
    status, body = problem(
        403,
        "only-for-the-front",
        "This is the port of one shard, which answers the front of its fleet only. Ask at the "
        "address that `slowtime twin --shards` logs.",
        scope["path"][:300],
    )
    headers = [
        (b"content-type", MEDIA_TYPE.encode()),
        (b"content-length", str(len(body)).encode()),
    ]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
