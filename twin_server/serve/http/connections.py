"""Limits the time, size and number of connections, which uvicorn does not limit.

Who begins a request and does not go on with it, trickles a body or does not take the answer is
cut off; who opens many connections and says nothing on them loses the oldest of these to who
comes next. None of that is felt by others.
"""

import asyncio
import dataclasses
from collections import Counter
from collections.abc import Callable
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from .pace import Pace
from .problems import MEDIA_TYPE, problem

LARGEST_HEAD = 65_536
"""Bytes of a request's head."""

LOOK_S = 1.0
"""How often a body that arrives, or an answer that is taken, is looked at."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ConnectionLimits:
    """Limits of one connection, and of one address.

    Parameters
    ----------
    head_s
        Time for the head of a request, from its first byte or from the connection's beginning.
    body_s, slowest_bytes_per_s
        How long a body, or the taking of an answer, may be slower than that rate.
    upload_s
        Time for a whole body.
    most, most_of_one
        Connections, and those of one address; None for a proxy before all of them.
    """

    head_s: float = 10.0
    body_s: float = 30.0
    slowest_bytes_per_s: float = 8_192.0
    upload_s: float = 3_600.0
    most: int = 2_000
    most_of_one: int | None = 1_000


class Connections:
    """All connections of a server, by address, the oldest first; lives in the event loop."""

    def __init__(self, limits: ConnectionLimits) -> None:
        self.limits = limits
        self._of: dict[str, dict[LimitedConnection, None]] = {}
        self._count = 0
        self.counts: Counter[str] = Counter()

    def protocol(self) -> type[HttpToolsProtocol]:
        """Make the class that uvicorn makes connections of."""
        return type("Limited", (LimitedConnection,), {"connections_of": self})

    def add(self, one: "LimitedConnection", address: str) -> bool:
        """Admit a connection, if need be in place of an idle one; False if none is idle."""
        theirs = self._of.setdefault(address, {})
        limit = self.limits.most_of_one
        if limit is not None and len(theirs) >= limit and not self._cut_off_oldest(theirs):
            return False
        if self._count >= self.limits.most - 1:
            crowd = max(self._of.values(), key=len)
            self._cut_off_oldest(crowd)
        theirs[one] = None
        self._of[address] = theirs
        self._count += 1
        return True

    def discard(self, one: "LimitedConnection", address: str) -> None:
        """Forget one."""
        theirs = self._of.get(address, {})
        if one in theirs:
            del theirs[one]
            self._count -= 1
        if not theirs:
            self._of.pop(address, None)

    def _cut_off_oldest(self, theirs: "dict[LimitedConnection, None]") -> bool:
        """Close the oldest connection on which nothing has been asked."""
        for one in theirs:
            if one.waits:
                self.counts["evicted"] += 1
                one.cut_off()
                return True
        return False


class LimitedConnection(HttpToolsProtocol):
    """HTTP/1.1 within limits."""

    connections_of: Connections

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.limits = self.connections_of.limits
        self._address = ""
        self._in_head, self._head = True, 0
        self._received, self._begun_s, self._late_s = 0, 0.0, 0.0
        self._pace, self._looked = self._new_pace(), 0
        self._timer: asyncio.TimerHandle | None = None
        self._taking: asyncio.TimerHandle | None = None

    @property
    def waits(self) -> bool:
        """Whether nothing has been asked yet, or no more."""
        return self._in_head and (self.cycle is None or self.cycle.response_complete)

    def cut_off(self) -> None:
        """Close it, and forget it at once."""
        self.connections_of.discard(self, self._address)
        self._stop()
        self.transport.close()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Admit the connection, if the limits allow."""
        super().connection_made(transport)
        self._address = str((self.client or ("",))[0])
        if not self.connections_of.add(self, self._address):
            self.connections_of.counts["refused"] += 1
            most = self.limits.most_of_one
            self._refuse(
                503,
                "too-many-connections",
                f"{self._address} has {most} connections already. Allowed: {most} of one "
                "address (serve.max_connections_of_one). Close some.",
            )
            return
        self._timer = self.loop.call_later(self.limits.head_s, self._head_is_late)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self.connections_of.discard(self, self._address)
        self._stop()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take bytes, unless too many of a head have come."""
        if self.transport.is_closing():
            return
        if self._in_head and self._head > LARGEST_HEAD:
            self.connections_of.counts["head_too_large"] += 1
            self.transport.close()
            return
        if self._in_head:
            self._head += len(data)
            if self._timer is None:
                self._timer = self.loop.call_later(self.limits.head_s, self._head_is_late)
        else:
            self._received += len(data)
        super().data_received(data)

    def on_headers_complete(self) -> None:
        """Stop counting: a body follows, which has limits of its own."""
        self._in_head, self._head, self._received, self._looked = False, 0, 0, 0
        self._pace = self._new_pace()
        self._begun_s = self.loop.time()
        self._again(self._look_at_body)
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        """Count again: the next request follows."""
        self._in_head, self._head = True, 0
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        super().on_message_complete()

    def pause_writing(self) -> None:
        """Begin to measure whether the client reads the answer."""
        super().pause_writing()
        self._late_s = 0.0
        if self._taking is None:
            self._look_at_answer(self.transport.get_write_buffer_size() + 1, first=True)

    def resume_writing(self) -> None:
        """All is well."""
        super().resume_writing()
        if self._taking is not None:
            self._taking.cancel()
            self._taking = None

    def _again(self, look: Callable[[], None]) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_later(LOOK_S, look)

    def _stop(self) -> None:
        for timer in (self._timer, self._taking):
            if timer is not None:
                timer.cancel()
        self._timer = self._taking = None

    def _head_is_late(self) -> None:
        """End a connection on which nothing, or only a part of a head, has come."""
        self._timer = None
        self.connections_of.counts["head_late"] += 1
        if self._head and self.waits:
            self._refuse(
                408,
                "head-too-slow",
                f"The head of a request was not there after {self.limits.head_s:g} s "
                "(serve.head_s). Send it at once.",
            )
            return
        self.transport.close()

    def _look_at_body(self) -> None:
        """End a body that arrives too slowly; pauses of the server are not counted."""
        self._timer = None
        if self._in_head or self.transport.is_closing():
            return
        limits = self.limits
        took_s = self.loop.time() - self._begun_s
        came, self._looked = self._received - self._looked, self._received
        fast = self._pace.take(came, 0.0 if self.flow.read_paused else LOOK_S)
        if fast and took_s < limits.upload_s:
            self._again(self._look_at_body)
            return
        self.connections_of.counts["body_late"] += 1
        if self.cycle is None or self.cycle.response_started:
            self.transport.close()
            return
        self._refuse(
            408,
            "body-too-slow",
            f"{self._received:,} bytes of a body came within {took_s:.0f} s. Allowed: "
            f"{limits.slowest_bytes_per_s:,.0f} bytes a second, of which it may fall behind "
            f"by {limits.body_s:g} s, and {limits.upload_s:g} s in all (serve.body_s, "
            "serve.slowest_bytes_per_s, serve.upload_s). Send it faster, or less.",
        )

    def _new_pace(self) -> Pace:
        limits = self.limits
        return Pace(limits.slowest_bytes_per_s, limits.body_s)

    def _look_at_answer(self, before: int, *, first: bool = False) -> None:
        """End a connection whose client reads the answer too slowly."""
        self._taking = None
        if self.transport.is_closing():
            return
        left = self.transport.get_write_buffer_size()
        if not first:
            slow = before - left < self.limits.slowest_bytes_per_s * LOOK_S
            self._late_s = self._late_s + LOOK_S if slow else 0.0
        if self._late_s >= self.limits.body_s:
            self.connections_of.counts["answer_not_taken"] += 1
            self.transport.abort()
            return
        self._taking = self.loop.call_later(LOOK_S, self._look_at_answer, left)

    def _refuse(self, status: int, slug: str, detail: str) -> None:
        """Answer with a problem, without the application, and close the connection."""
        _, body = problem(status, slug, detail, "")
        reason = {408: b"Request Timeout", 503: b"Service Unavailable"}[status]
        self.transport.write(
            b"HTTP/1.1 %d %s\r\ncontent-type: %s\r\ncontent-length: %d\r\nretry-after: 5\r\n"
            b"connection: close\r\n\r\n%s"
            % (status, reason, MEDIA_TYPE.encode(), len(body), body)
        )
        self.transport.close()
