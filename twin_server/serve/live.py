"""The live stream: server-sent events, the same for all clients; losses are reported.

Each event carries an id, ``BOOT:SEQUENCE-NUMBER``: boot and sequence of the last state, and the
number of the last event, that a client has seen. A client that comes back with it is first told
what it missed, out of the history; one that falls too far behind is cut off, and comes back.
No id has a number that counts boots or events of other twins.
"""

import asyncio
import collections
import logging
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

from pydantic_core import to_json
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from twin_server.fairness import Quota, QuotaHolding, current_holder
from twin_server.history.details import Bodies, part
from twin_server.history.rendering import event_object, state_objects
from twin_server.history.states import States

from .knowledge import Knowledge

logger = logging.getLogger(__name__)

PING_S = 10.0
"""Interval of comments that keep a stream open [s]."""

STUCK_S = 15.0
"""Time after which a client that takes nothing is cut off [s]."""

SHIFT = 40
"""A key is number << SHIFT | sequence, as in the history."""

_SEQUENCE = (1 << SHIFT) - 1

LAST_ID = re.compile(
    r"(?P<boot>[0-9A-Za-z._-]{0,64}):(?P<sequence>\d{1,12})-(?P<number>\d{1,18})"
)
"""Id of an event: boot and sequence of the last state, number of the last event."""


class Item(NamedTuple):
    """One event; `key` or `number` give a client's position after it, 0 leaves it unchanged.

    Parameters
    ----------
    boot
        Of a state: the part of its key that is told.
    """

    key: int
    number: int
    text: str
    boot: str = ""

    @classmethod
    def of_state(cls, key: int, boot: str, text: str) -> "Item":
        """Make the item of a state."""
        return cls(key, 0, f"event: state\ndata: {text}\n\n", boot)

    @classmethod
    def of_event(cls, number: int, body: str) -> "Item":
        """Make the item of an event."""
        text = to_json(event_object(number, body)).decode()
        return cls(0, number, f"event: event\ndata: {text}\n\n")


RESET = Item(0, 0, "event: reset\ndata: {}\n\n")


class LiveClient:
    """One client of a twin's stream; used in the event loop."""

    def __init__(self, twin_id: str, backlog: int) -> None:
        self.twin_id, self._backlog = twin_id, backlog
        self.holding: QuotaHolding | None = None
        self._items: collections.deque[Item] = collections.deque()
        self.changed = asyncio.Event()
        self.ended = False

    def offer(self, items: Sequence[Item]) -> bool:
        """Queue an item; False if the client is too far behind."""
        if self.ended:
            return True
        if len(self._items) + len(items) > self._backlog:
            self.end()
            return False
        self._items.extend(items)
        self.changed.set()
        return True

    def end(self) -> None:
        """Send nothing more."""
        self.ended = True
        self._items.clear()
        self.changed.set()

    def take(self) -> list[Item]:
        """Everything that waits."""
        self.changed.clear()
        items = list(self._items)
        self._items.clear()
        return items


class Hub:
    """Passes updates to all clients; `tell` and `reset` may be called from any thread.

    Parameters
    ----------
    max_clients, backlog, max_of_one
        How many may watch, how many items each may be behind, and how many may watch for one
        caller.
    """

    def __init__(self, max_clients: int, backlog: int, max_of_one: int | None = None) -> None:
        self.backlog = backlog
        self.quota = Quota(
            "streams", max_clients, of_token=max_of_one, setting="serve.max_live_clients"
        )
        self._clients: dict[str, set[LiveClient]] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closed = False
        self.dropped = 0

    @property
    def count(self) -> int:
        """Number of clients that watch."""
        return self.quota.count

    def join(self, twin_id: str) -> LiveClient | None:
        """Watch a twin from now on; None where the server is ending.

        Raises
        ------
        OverQuotaError
            Where there is no room, or none for the caller.
        """
        self._loop = asyncio.get_running_loop()
        if self._closed:
            return None
        client = LiveClient(twin_id, self.backlog)
        client.holding = self.quota.take(current_holder(), f"live {twin_id}", client.end)
        self._clients.setdefault(twin_id, set()).add(client)
        return client

    def leave(self, client: LiveClient) -> None:
        """Watch no longer."""
        of_twin = self._clients.get(client.twin_id, set())
        of_twin.discard(client)
        if client.holding is not None:
            client.holding.release()
        if not of_twin:
            self._clients.pop(client.twin_id, None)

    def tell(
        self,
        twin_id: str,
        states: States,
        runs: Sequence[tuple[int, str, str]],
        events: Sequence[tuple[int, str]],
        bodies: Bodies = (),
    ) -> None:
        """Pass items of a twin to its clients; costs nothing where there are none."""
        if twin_id not in self._clients:
            return
        # More at once than a client may be behind: it fetches the history again instead.
        items = [RESET] if len(states) > self.backlog // 2 else []
        newest = slice(-1, None) if items else slice(None)
        numbers, boots, units = zip(*runs[newest], strict=True) if runs else ((), (), ())
        texts = state_objects(states[newest], twin_id, boots, units, part(bodies, newest))
        sequences = states["sequence"][newest].tolist()
        items += [
            Item.of_state(number << SHIFT | sequence, boot, text)
            for number, boot, sequence, text in zip(
                numbers, boots, sequences, texts, strict=True
            )
        ]
        items += [Item.of_event(number, body) for number, body in events]
        self._hand_over(twin_id, items)

    def reset(self, twin_id: str) -> None:
        """Notify clients that a twin's history has been rewritten or deleted."""
        if twin_id in self._clients:
            self._hand_over(twin_id, [RESET])

    def close(self) -> None:
        """End all streams; from within the event loop."""
        self._closed = True
        for clients in self._clients.values():
            for client in clients:
                client.end()

    def _hand_over(self, twin_id: str, items: Sequence[Item]) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._deliver, twin_id, items)

    def _deliver(self, twin_id: str, items: Sequence[Item]) -> None:
        for client in self._clients.get(twin_id, ()):
            if not client.offer(items):
                self.dropped += 1
                logger.warning("A live client of %s is too slow and is disconnected.", twin_id)


class LiveResponse(Response):
    """The stream to one client.

    Parameters
    ----------
    last_id
        What the client has seen before, as it says itself; None for a new one.
    still
        Whether the client may still see it: a token may be taken back, or expire.
    """

    media_type = "text/event-stream"

    def __init__(
        self,
        hub: Hub,
        client: LiveClient,
        knowledge: Knowledge,
        last_id: str | None,
        still: Callable[[], bool] = lambda: True,
    ) -> None:
        self._hub, self._client, self._knowledge = hub, client, knowledge
        self._last_id, self._still = last_id, still
        self._key, self._boot, self._number = 0, "", 0
        self.background = None
        self.status_code = 200
        self.init_headers({"Cache-Control": "no-store", "X-Accel-Buffering": "no"})
        # The length is not known, and a stream is not a body.
        self.raw_headers = [h for h in self.raw_headers if h[0] != b"content-length"]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until either side ends it."""
        gone = asyncio.ensure_future(_disconnected(receive))
        gone.add_done_callback(lambda _: self._client.end())
        try:
            await send(
                {
                    "type": "http.response.start",
                    "status": self.status_code,
                    "headers": self.raw_headers,
                }
            )
            await self._stream(send)
        except TimeoutError:
            self._hub.dropped += 1
            logger.warning("A live client of %s reads nothing.", self._client.twin_id)
        finally:
            gone.cancel()
            self._hub.leave(self._client)

    async def _stream(self, send: Send) -> None:
        missed = await asyncio.to_thread(self._catch_up)
        await _send(send, "retry: 1000\n\n" + self._numbered(missed))
        while not self._client.ended:
            try:
                await asyncio.wait_for(self._client.changed.wait(), PING_S)
            except TimeoutError:
                if self._still():
                    await _send(send, ": still here\n\n")
                    continue
            if not self._still():
                break
            items = [item for item in self._client.take() if self._is_new(item)]
            if items:
                await _send(send, self._numbered(items))
        await send({"type": "http.response.body", "body": b"", "more_body": False})

    def _catch_up(self) -> list[Item]:
        """Collect events that a client missed; for a new one, the latest state."""
        seen = LAST_ID.fullmatch(self._last_id or "")
        knowledge, twin_id = self._knowledge, self._client.twin_id
        chapter = knowledge.latest(twin_id, None)
        newest = knowledge.events(twin_id, after=0, limit=1, newest=True)
        last_key, last_number = max(chapter.keys, default=0), newest[-1][0] if newest else 0
        key = None if seen is None else self._key_of(seen["boot"], int(seen["sequence"]))
        before: list[Item] = []
        # Ahead of all there is: the history is another, such as one out of a backup.
        if seen is None or key is None or key > last_key or int(seen["number"]) > last_number:
            self._number = last_number
            if self._last_id is not None:
                before = [RESET]  # of a history that is not there any more
        else:
            self._key, self._boot, self._number = key, seen["boot"], int(seen["number"])
            chapter = knowledge.since(twin_id, self._key, self._hub.backlog)
            before = [] if len(chapter.keys) < self._hub.backlog else [RESET]
        texts = state_objects(
            chapter.states, twin_id, chapter.boots, chapter.units, chapter.bodies
        )
        states = map(Item.of_state, chapter.keys, chapter.boots, texts)
        events = knowledge.events(
            twin_id, after=self._number, limit=self._hub.backlog, newest=False
        )
        return [*before, *states, *(Item.of_event(*event) for event in events)]

    def _key_of(self, boot: str, sequence: int) -> int | None:
        """Find the key of a state; 0 for a client that has seen none yet."""
        if not boot:
            return 0
        number = self._knowledge.boot_number(self._client.twin_id, boot)
        return None if number is None else number << SHIFT | sequence

    def _is_new(self, item: Item) -> bool:
        return item.key > self._key or item.number > self._number or item is RESET

    def _numbered(self, items: Sequence[Item]) -> str:
        parts = []
        for item in items:
            if item.key > self._key:
                self._key, self._boot = item.key, item.boot
            self._number = max(self._number, item.number)
            place = f"{self._boot}:{self._key & _SEQUENCE}"
            parts.append(f"id: {place}-{self._number}\n{item.text}")
        return "".join(parts)


async def _send(send: Send, text: str) -> None:
    message = {"type": "http.response.body", "body": text.encode(), "more_body": True}
    await asyncio.wait_for(send(message), STUCK_S)


async def _disconnected(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
