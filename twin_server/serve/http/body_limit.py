"""Refuses request bodies above a size before they are read."""

import contextlib
from collections.abc import Mapping

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .problems import MEDIA_TYPE, problem


class _TooLarge(Exception):
    pass


class BodyLimit:
    """ASGI middleware that limits bodies to `max_bytes`, whatever their header states.

    Parameters
    ----------
    larger
        Of what is PUT below a path, how many bytes are allowed instead.
    """

    def __init__(
        self, app: ASGIApp, max_bytes: int, larger: Mapping[str, int] | None = None
    ) -> None:
        self._app, self._max_bytes, self._larger = app, max_bytes, dict(larger or {})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with a problem document."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        most = self._most(scope)
        stated = dict(scope["headers"]).get(b"content-length", b"0")
        if not stated.isdigit() or int(stated) > most:
            await self._refuse(scope, send, most, stated.decode("latin-1"))
            return
        read = 0

        async def limited() -> Message:
            nonlocal read
            message = await receive()
            read += len(message.get("body", b""))
            if read > most:
                raise _TooLarge
            return message

        async def unless_too_large(message: Message) -> None:
            # What the application makes of its interrupted reading is not the answer.
            if read <= most:
                await send(message)

        with contextlib.suppress(_TooLarge):
            await self._app(scope, limited, unless_too_large)
        if read > most:
            await self._refuse(scope, send, most, f"more than {most}")

    def _most(self, scope: Scope) -> int:
        if scope["method"] != "PUT":
            return self._max_bytes
        found = (most for path, most in self._larger.items() if scope["path"].startswith(path))
        return next(found, self._max_bytes)

    async def _refuse(self, scope: Scope, send: Send, most: int, given: str) -> None:
        detail = (
            f"A body of {given:.30} bytes was given. Allowed: up to {most:,}. Send "
            "less at once."
        )
        status, body = problem(413, "body-too-large", detail, scope["path"])
        headers = [
            (b"content-type", MEDIA_TYPE.encode()),
            (b"content-length", str(len(body)).encode()),
            (b"connection", b"close"),
        ]
        await send({"type": "http.response.start", "status": status, "headers": headers})
        await send({"type": "http.response.body", "body": body})
