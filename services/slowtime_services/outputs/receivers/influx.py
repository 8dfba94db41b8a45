"""Writes to databases that take the line protocol by HTTP, such as InfluxDB."""

import base64
import http.client
import ssl
from collections.abc import Iterator
from urllib.parse import urlencode, urlsplit

from slowtime_services.documents.json_documents import read_json
from slowtime_services.outputs.batch import Batch, NotSentError
from slowtime_services.outputs.secret_files import secret_of, user_and_password
from slowtime_services.outputs.settings import InfluxSettings
from slowtime_services.reasons import reason_of

from .line_protocol import lines_of

MOST_LINES = 5_000
"""Lines of one request, as InfluxData recommends."""
MOST_WAIT_S = 3_600.0
"""Longest wait that a database may ask for [s]."""
_MOST_ANSWER = 4_096


class InfluxOutput:
    """Sends lines to one database; each request is answered before the next is sent."""

    is_archive = True

    def __init__(self, _name: str, settings: InfluxSettings) -> None:
        self._settings = settings
        self._connection: http.client.HTTPConnection | None = None
        self._headers: dict[str, str] = {}

    def start(self) -> None:
        """Connect."""
        settings, parts = self._settings, urlsplit(self._settings.url)
        assert parts.hostname is not None
        self._headers = {"Content-Type": "text/plain; charset=utf-8", "User-Agent": "slowtime"}
        if settings.token_file is not None:
            self._headers["Authorization"] = f"Token {secret_of(settings.token_file)}"
        elif (known := user_and_password(settings.credentials_file)) is not None:
            self._headers["Authorization"] = f"Basic {_base64(':'.join(known))}"
        if parts.scheme == "http":
            self._connection = http.client.HTTPConnection(
                parts.hostname, parts.port, timeout=settings.timeout_s
            )
        else:
            context = ssl.create_default_context(
                cafile=None if settings.ca is None else str(settings.ca)
            )
            self._connection = http.client.HTTPSConnection(
                parts.hostname, parts.port, timeout=settings.timeout_s, context=context
            )

    def send(self, batch: Batch) -> None:
        """Write the points of a batch."""
        for text in _requests(lines_of(batch)):
            self._post(text)

    def close(self) -> None:
        """Disconnect."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _path(self) -> str:
        settings = self._settings
        base = urlsplit(settings.url).path.rstrip("/")
        if settings.bucket is None:
            asked = {"db": settings.database or "", "precision": "ns"}
            return f"{base}/write?{urlencode(asked)}"
        asked = {"bucket": settings.bucket, "org": settings.org or "", "precision": "ns"}
        return f"{base}/api/v2/write?{urlencode(asked)}"

    def _post(self, text: str) -> None:
        assert self._connection is not None
        try:
            self._connection.request("POST", self._path(), text.encode(), self._headers)
            with self._connection.getresponse() as answer:
                status, wait = answer.status, answer.getheader("Retry-After")
                said = answer.read(_MOST_ANSWER)
        except (OSError, http.client.HTTPException) as error:
            raise NotSentError(f"The database: {reason_of(error)}") from error
        if 200 <= status < 300:
            return
        if status == 429 or status >= 500:
            raise NotSentError(f"The database answered {status}.", _wait_s(wait))
        raise NotSentError(
            f"The database refused with {status}: {_message(said)} Correct the settings of the "
            "output, or the database.",
            is_refused=True,
        )


def _requests(lines: Iterator[str]) -> Iterator[str]:
    part: list[str] = []
    for one in lines:
        part.append(one)
        if len(part) == MOST_LINES:
            yield "\n".join(part)
            part = []
    if part:
        yield "\n".join(part)


def _base64(text: str) -> str:
    return base64.b64encode(text.encode()).decode()


def _wait_s(told: str | None) -> float:
    """Return the wait that a database asks for [s]; dates are not read."""
    return min(float(told), MOST_WAIT_S) if told is not None and told.isdecimal() else 0.0


def _message(said: bytes) -> str:
    """Return the reason of a refusal, without its JSON where it has some."""
    text = said.decode(errors="replace").strip()
    try:
        told = read_json(text)
        text = str(told.get("message") or told.get("error") or text)
    except (ValueError, AttributeError):
        pass
    return f"{' '.join(text.split())[:300].rstrip('.')}."
