"""A request body larger than allowed is refused before it is read."""

import contextlib

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .problems import MEDIA_TYPE, problem


class _TooLarge(Exception):
    pass


class BodyLimit:
    """ASGI middleware: no body is longer than `max_bytes`, whatever its header says."""

    def __init__(self, app: ASGIApp, max_bytes: int) -> None:
        self._app, self._max_bytes = app, max_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with a problem document."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        stated = dict(scope["headers"]).get(b"content-length", b"0")
        if not stated.isdigit() or int(stated) > self._max_bytes:
            await self._refuse(scope, send, stated.decode("latin-1"))
            return
        read = 0

        async def limited() -> Message:
            nonlocal read
            message = await receive()
            read += len(message.get("body", b""))
            if read > self._max_bytes:
                raise _TooLarge
            return message

        async def unless_too_large(message: Message) -> None:
            # What the application makes of its interrupted reading is not the answer.
            if read <= self._max_bytes:
                await send(message)

        with contextlib.suppress(_TooLarge):
            await self._app(scope, limited, unless_too_large)
        if read > self._max_bytes:
            await self._refuse(scope, send, f"more than {self._max_bytes}")

    async def _refuse(self, scope: Scope, send: Send, given: str) -> None:
        detail = (
            f"A body of {given:.30} bytes was given. Allowed: up to {self._max_bytes:,}. Send "
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
