"""Routes whose bodies are JSON documents, read within bounds and refused with a reason."""

from collections.abc import Callable, Coroutine
from typing import Any

from fastapi import Request, Response
from fastapi.routing import APIRoute
from pydantic import BaseModel, ValidationError

from slowtime_services.documents.bounds import DATA, Bounds, DocumentError
from slowtime_services.documents.json_documents import read_json
from slowtime_services.documents.validation import WHOLE_CHARACTERS, validated
from slowtime_services.reasons import MOST_CHARACTERS

from .problems import UnreadableBodyError

BODY = Bounds(most_bytes=DATA.most_bytes)
"""`BodyLimit` bounds the size before; values and levels are those of a model file."""


class _DocumentRequest(Request):
    kind: Any = None

    async def json(self) -> Any:
        body = await self.body()
        try:
            values = read_json(body, BODY)
            if len(body) > WHOLE_CHARACTERS and issubclass(self.kind, BaseModel):
                # FastAPI would gather all the faults of half a million values.
                validated(self.kind, values, len(body))
        except DocumentError as error:
            raise UnreadableBodyError(str(error)) from None
        except ValidationError as error:
            raise UnreadableBodyError(_first(error)) from None
        return values


def _first(error: ValidationError) -> str:
    fault = error.errors(include_url=False)[0]
    where = ".".join(map(str, fault["loc"]))[:MOST_CHARACTERS]
    return f"At {where}: {fault['msg'][:MOST_CHARACTERS]}."


class DocumentRoute(APIRoute):
    """Route whose body is read by `read_json`.

    FastAPI's own reader takes the last of two equal keys, makes infinity of 1e400, and gives
    no reason where a body is nested too deep or has a number of thousands of digits.
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the handler of FastAPI, around another reader of bodies."""
        handle = super().get_route_handler()
        kind = self.body_field.field_info.annotation if self.body_field else None

        async def handle_document(request: Request) -> Response:
            document = _DocumentRequest(request.scope, request.receive)
            document.kind = kind
            return await handle(document)

        return handle_document
