"""Answers requests that the server gives up when it ends."""

import asyncio
import logging

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from . import problems

logger = logging.getLogger(__name__)

RETRY_AFTER_S = 5
"""When to ask again [s]: about as long as a server takes to start."""


class ShutdownAnswer:
    """ASGI middleware: a request that is cancelled is answered with 503.

    uvicorn cancels what has not ended within `timeout_graceful_shutdown`, such as an upload
    whose client waits, and would log the cancellation as a fault with its traceback.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        begun = False

        async def noting(message: Message) -> None:
            nonlocal begun
            begun = True
            await send(message)

        try:
            await self._app(scope, receive, noting)
        except asyncio.CancelledError:
            if scope["type"] != "http":
                raise
            asked = f"{scope['method']} {scope['path']:.200}"
            logger.info("%s was ended, because the server ends.", asked)
            if begun:  # the rest is missing, which only a broken connection can say
                raise
            detail = f"{asked} was not done, because the server ends. Ask again later."
            status, body = problems.problem(503, "server-ends", detail, scope["path"])
            headers = [
                (b"content-type", problems.MEDIA_TYPE.encode()),
                (b"content-length", str(len(body)).encode()),
                (b"retry-after", str(RETRY_AFTER_S).encode()),
                (b"connection", b"close"),
            ]
            await send({"type": "http.response.start", "status": status, "headers": headers})
            await send({"type": "http.response.body", "body": body})
