"""Routes whose bodies are JSON documents, read within bounds and refused with a reason."""

from collections.abc import Callable, Coroutine
from typing import Any

from fastapi import Request, Response
from fastapi.routing import APIRoute

from slowtime_services.documents.bounds import DATA, Bounds, DocumentError
from slowtime_services.documents.json_documents import read_json

from .problems import UnreadableBodyError

BODY = Bounds(most_bytes=DATA.most_bytes)
"""`BodyLimit` bounds the size before; values and levels are those of a model file."""


class _DocumentRequest(Request):
    async def json(self) -> Any:
        try:
            return read_json(await self.body(), BODY)
        except DocumentError as error:
            raise UnreadableBodyError(str(error)) from None


class DocumentRoute(APIRoute):
    """Route whose body is read by `read_json`.

    FastAPI's own reader takes the last of two equal keys, makes infinity of 1e400, and gives
    no reason where a body is nested too deep or has a number of thousands of digits.
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the handler of FastAPI, around another reader of bodies."""
        handle = super().get_route_handler()

        async def handle_document(request: Request) -> Response:
            return await handle(_DocumentRequest(request.scope, request.receive))

        return handle_document
