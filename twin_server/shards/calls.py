"""Calls of the front to its shards, from threads, about what it composes itself."""

import concurrent.futures
import http.client
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

from pydantic import BaseModel
from pydantic_core import from_json

from slowtime_schemas.partitions import partition_of
from slowtime_services.shards import owners
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.shard_interface import HEADER

from .supervisor import Shards

RETRY_S = 2
"""When a client may ask again after a shard was down [s]; a shard starts in some seconds."""


def owner(twin_id: str, count: int) -> int:
    """Return which of `count` shards has a twin.

    Examples
    --------
    >>> owner("lab.bridge-7", 4)
    3
    """
    return owners(count)[partition_of(twin_id.partition(".")[2])]


def is_down(index: int, count: int) -> str:
    """Say that a shard does not answer."""
    return (
        f"Shard {index} of {count} does not answer: it is being started, or it has failed, and "
        "the log says why."
    )


def unavailable(detail: str) -> ProblemError:
    """Make the refusal of what needs a shard that does not answer."""
    return ProblemError(
        503,
        "shard-down",
        f"{detail} Try again in {RETRY_S} s; edges keep what it misses.",
        **{"Retry-After": str(RETRY_S)},
    )


class Calls:
    """Asks shards, several at once.

    Parameters
    ----------
    shards
        Where each answers.
    key
        Secret of the fleet.
    timeout_s
        How long an answer may take [s].
    """

    def __init__(self, shards: Shards, key: str, timeout_s: float) -> None:
        self._shards, self._timeout_s = shards, timeout_s
        self._headers = {HEADER.decode(): key, "Content-Type": "application/json"}
        self._threads = concurrent.futures.ThreadPoolExecutor(16, "calls")

    @property
    def count(self) -> int:
        """Number of shards."""
        return self._shards.count

    def ask(self, index: int, path: str, body: BaseModel | None = None) -> Any:
        """Return the answer of one shard.

        Raises
        ------
        ProblemError
            503 if it does not answer; else as it refuses.
        """
        url = self._shards.url(index)
        if url is None:
            raise unavailable(is_down(index, self.count))
        parts = urlsplit(url)
        connection = http.client.HTTPConnection(
            parts.hostname or "", parts.port, timeout=self._timeout_s
        )
        try:
            text = None if body is None else body.model_dump_json()
            connection.request("GET" if body is None else "POST", path, text, self._headers)
            answer = connection.getresponse()
            told = from_json(answer.read())
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise unavailable(is_down(index, self.count)) from error
        finally:
            connection.close()
        if answer.status != http.HTTPStatus.OK:
            raise _refusal(answer, told)
        return told

    def ask_each(self, path: str, bodies: Mapping[int, BaseModel]) -> dict[int, Any]:
        """Return the answer of each shard to a body of its own."""
        under_way = {
            index: self._threads.submit(self.ask, index, path, body)
            for index, body in bodies.items()
        }
        return {index: one.result() for index, one in under_way.items()}


def _refusal(answer: http.client.HTTPResponse, told: Mapping[str, Any]) -> ProblemError:
    """Make the refusal of a shard that of the front."""
    later = answer.headers.get("Retry-After")
    return ProblemError(
        answer.status,
        str(told["type"]).rpartition(":")[2],
        str(told["detail"]),
        **({} if later is None else {"Retry-After": later}),
    )
