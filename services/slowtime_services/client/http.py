"""HTTP requests to a twin server, over the standard library."""

import json
import ssl
import urllib.error
import urllib.request
from collections.abc import Mapping
from http.client import HTTPException, HTTPResponse
from pathlib import Path
from typing import cast
from urllib.parse import urlencode, urlsplit

from slowtime_services.documents.json_documents import read_json
from slowtime_services.outbound.connections import NoRedirects
from slowtime_services.reasons import reason_of


class AnswerError(Exception):
    """The server answered that it will not, or cannot.

    Parameters
    ----------
    status
        Of HTTP.
    kind
        Last part of the problem's type, such as ``no-such-twin``; empty where none was given.
    detail
        What was given, what is allowed, what to do.
    """

    def __init__(self, status: int, kind: str, detail: str) -> None:
        super().__init__(detail)
        self.status, self.kind, self.detail = status, kind, detail


class UnreachableError(ConnectionError):
    """The address does not answer, or is no twin server."""


class HttpConnection:
    """Where a server is asked.

    Parameters
    ----------
    url
        Such as ``https://twin.example:8000``.
    token
        Of `slowtime tokens add`, or a JWT.
    ca
        Certificates to trust instead of the system's (PEM).
    """

    def __init__(self, url: str, token: str | None, ca: Path | None, timeout_s: float) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise ValueError(
                f"{url!r} is not a valid address of a server. Give one such as http://127.0.0.1:8000."
            )
        self.url, self._timeout_s = url.rstrip("/"), timeout_s
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        context = ssl.create_default_context(cafile=None if ca is None else str(ca))
        self._opener = urllib.request.build_opener(
            urllib.request.HTTPSHandler(context=context), NoRedirects
        )

    def ask(
        self,
        method: str,
        path: str,
        query: Mapping[str, object] | None = None,
        body: object = None,
        headers: Mapping[str, str] | None = None,
    ) -> HTTPResponse:
        """Send a request; its answer, not yet read.

        Raises
        ------
        AnswerError
            Where the server refuses.
        UnreachableError
            Where it does not answer.
        """
        given = {name: value for name, value in (query or {}).items() if value is not None}
        where = f"{self.url}{path}" + (f"?{urlencode(given)}" if given else "")
        content = None if body is None else json.dumps(body).encode()
        more = {} if content is None else {"Content-Type": "application/json"}
        request = urllib.request.Request(
            where, content, {**self._headers, **more, **(headers or {})}, method=method
        )
        try:
            return cast(HTTPResponse, self._opener.open(request, timeout=self._timeout_s))
        except urllib.error.HTTPError as error:
            with error:
                raise _refusal(error) from error
        except (OSError, HTTPException) as error:
            raise self._away(error) from error

    def read(
        self,
        method: str,
        path: str,
        query: Mapping[str, object] | None = None,
        body: object = None,
    ) -> bytes:
        """Send a request; its whole answer."""
        try:
            with self.ask(method, path, query, body) as answer:
                return answer.read()
        except (OSError, HTTPException) as error:
            raise self._away(error) from error

    def _away(self, error: Exception) -> UnreachableError:
        if isinstance(error, UnreachableError):
            return error
        return UnreachableError(
            f"{self.url} did not answer: {reason_of(error)} Give the address of a running twin "
            "server, such as http://127.0.0.1:8000, or start one with `slowtime twin`."
        )


def _refusal(error: urllib.error.HTTPError) -> AnswerError:
    """Read the problem document, where there is one."""
    try:
        told = read_json(error.read())
        kind = str(told["type"]).removeprefix("urn:slowtime:problem:")
        return AnswerError(error.code, kind, str(told["detail"]))
    except (OSError, ValueError, KeyError, TypeError):
        return AnswerError(error.code, "", f"The server answered {error.code} {error.reason}.")
