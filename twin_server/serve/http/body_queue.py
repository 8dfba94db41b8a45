"""Reads request bodies whole, and lets one at a time be validated.

To check twenty thousand numbers takes milliseconds of the event loop. Behind this queue they
are taken between the turns of all others: eighty large bodies at once delay nobody by more
than one, and those of one site delay the other sites' bodies by no more than one either.
"""

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from twin_server.fairness import FairGate, current_holder

KEY = "slowtime.body_queue"

LARGE = 4_096
"""Bytes of a body from which on looking at it is felt by others."""


class BodyQueue:
    """ASGI middleware around whatever reads bodies.

    A route that goes on to wait calls `release_body_slot`; otherwise the next request is
    admitted when the answer begins.
    """

    def __init__(self, app: ASGIApp, streamed: str) -> None:
        self._app, self._streamed = app, streamed
        self._one = FairGate(1)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, at its turn."""
        if (
            scope["type"] != "http"
            or scope["method"] in ("GET", "HEAD", "OPTIONS")
            or scope["path"].startswith(self._streamed)
        ):
            await self._app(scope, receive, send)
            return
        messages, size = [], 0
        while True:
            message = await receive()
            messages.append(message)
            size += len(message.get("body", b""))
            if message["type"] != "http.request" or not message.get("more_body", False):
                break
        if messages[-1]["type"] == "http.disconnect":
            return
        messages.reverse()

        async def again() -> Message:
            return messages.pop() if messages else await receive()

        if size < LARGE:
            await self._app(scope, again, send)
            return
        turn = await self._one.acquire(current_holder())
        inside = True

        def leave() -> None:
            nonlocal inside
            if inside:
                inside = False
                self._one.release(*turn)

        async def leaving(message: Message) -> None:
            leave()
            await send(message)

        scope[KEY] = leave
        try:
            await self._app(scope, again, leaving)
        finally:
            leave()


def release_body_slot(scope: Scope) -> None:
    """Release the validation slot: this request is valid and goes on."""
    leave = scope.get(KEY)
    if leave is not None:
        leave()
