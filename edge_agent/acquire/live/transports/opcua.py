"""Variables of an OPC UA server, by asyncua, whose loop is run by the reader's thread."""

import asyncio
import collections
import datetime
import json
import threading
from collections.abc import Iterator, Sequence
from typing import Any
from urllib.parse import urlsplit, urlunsplit

from asyncua.client.client import Client
from asyncua.common.node import Node

from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.registry import Opened, TransportContext
from edge_agent.inputs import LiveInput
from edge_agent.layouts import Channel, JsonLayout, Stamp
from slowtime_services.clock import Clock

POLL_S = 0.1
"""Time that data are waited for before `stop` is looked at [s]."""

QUEUE = 1_000
"""Values of a variable that the server keeps between two messages."""

EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)


class OpcUa:
    """Subscriptions to variables; each is a channel, stamped by the server's source."""

    is_stream = ends = False

    def __init__(
        self,
        url: str,
        nodes: Sequence[str],
        clock: Clock,
        *,
        interval_ms: float,
        user: str | None,
        password: str | None,
    ) -> None:
        self._url, self._nodes, self._clock, self._interval_ms = url, nodes, clock, interval_ms
        self._user, self._password = user, password
        self._arrived: collections.deque[Packet] = collections.deque()

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Return changes of value, as the server reports them."""
        with asyncio.Runner() as runner:
            client = Client(self._url)
            if self._user is not None:
                client.set_user(self._user)
                client.set_password(self._password or "")
            runner.run(client.connect())
            try:
                runner.run(self._subscribe(client))
                while not stop.is_set():
                    runner.run(asyncio.sleep(POLL_S))
                    while self._arrived:
                        yield self._arrived.popleft()
                    runner.run(client.check_connection())
                    yield None
            finally:
                runner.run(_ended(client))

    async def _subscribe(self, client: Client) -> None:
        subscription = await client.create_subscription(self._interval_ms, self)
        nodes = [client.get_node(name) for name in self._nodes]
        await subscription.subscribe_data_change(nodes, queuesize=QUEUE)

    def datachange_notification(self, node: Node, value: Any, data: Any) -> None:
        """Take one value, or an array of them; called by asyncua."""
        told = data.monitored_item.Value
        when = told.SourceTimestamp or told.ServerTimestamp
        values = value if isinstance(value, list) else float(value)
        stamp = (when.replace(tzinfo=datetime.UTC) - EPOCH) // datetime.timedelta(
            microseconds=1
        )
        text = json.dumps({"v": values, "t": stamp})
        self._arrived.append(
            Packet(text.encode(), self._clock.now_ns(), node.nodeid.to_string())
        )

    def close(self) -> None:
        """Do nothing: each connection closes its own resources."""


async def _ended(client: Client) -> None:
    try:
        await asyncio.wait_for(client.disconnect(), 2.0)
    except Exception:  # whatever is left of a lost connection
        return


def opened(settings: LiveInput, around: TransportContext) -> Opened:
    """Subscribe to the nodes that the URL names."""
    nodes = [name for name in settings.parameters.get("channels", "").split(",") if name]
    if not nodes or settings.rate_hz is None:
        raise ValueError(
            "opcua: needs the ids of variables and their rate. Give both, such as "
            "?channels=ns=2;s=ax,ns=2;s=ay&rate_hz=10."
        )
    layout = settings.layout or JsonLayout(
        channels=tuple(Channel(name=node, at="v", topic=node, unit="1") for node in nodes),
        stamp=Stamp(at="t", unit="us", clock="utc"),
    )
    parts = urlsplit(settings.bare)
    url = urlunsplit(parts._replace(scheme="opc.tcp", netloc=parts.netloc.rpartition("@")[2]))
    transport = OpcUa(
        url,
        nodes,
        around.clock,
        interval_ms=float(settings.parameters.get("interval_ms", "100")),
        user=parts.username,
        password=settings.password,
    )
    return Opened(transport, layout, settings.rate_hz)
