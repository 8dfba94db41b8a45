"""What runs in each process of the house: the real thing, with the harness's clock in it."""

import contextlib
import json
import logging
import os
import sys
from pathlib import Path
from typing import Any

import edge_agent.__main__ as edge_process
import edge_agent.publish.publisher as publisher
import twin_server.__main__ as twin_process
from edge_agent.settings import EdgeSettings
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, TimeBase
from slowtime_services import router as router_process
from slowtime_services.shutdown import ended_by_signals
from twin_server.settings import TwinSettings

from .instruments import Dial, FaultySource, SkewedClock, ledger_spool


def router(home: Path, endpoint: str) -> None:
    """Run a router."""
    _begin(home, "router")
    router_process.run([endpoint])


def twin(home: Path, settings: dict[str, Any]) -> None:
    """Run a twin server."""
    _begin(home, "twin")
    clock = SkewedClock(Dial(home / "twin.clock"))

    def ready(url: str) -> None:
        (home / "twin.url").write_text(url)

    sys.exit(twin_process.run(TwinSettings(**settings), clock=clock, ready=ready))


def edge(
    home: Path,
    settings: dict[str, Any],
    ledger: Any,
    first_epoch: int,
    time_base: TimeBase,
    old: bool,
) -> None:
    """Run an edge agent; an `old` one speaks the version of features before this one."""
    asset = settings["asset"]
    _begin(home, asset)
    given = EdgeSettings(**settings)
    clock = SkewedClock(Dial(home / f"{asset}.clock"))
    edge_process.Spool = ledger_spool(ledger)  # type: ignore[attr-defined]
    if old:
        publisher.encode = _encode_as_before  # type: ignore[attr-defined]
    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(ended_by_signals())
        source = FaultySource(
            clock, Dial(home / f"{asset}.rate"), stop, first_epoch, len(asset), time_base
        )
        bus = stack.enter_context(edge_process._connected(given, clock, stop))
        sys.exit(edge_process.run(given, bus=bus, clock=clock, source=source, stop=stop))


def _encode_as_before(message: Any) -> bytes:
    if not isinstance(message, Features):
        return encode(message)
    plain = json.loads(encode(message)) | {"version": 1}
    del plain["channels"]
    for mode in plain["modes"]:
        for name in ("identity", "kind", "shape"):
            del mode[name]
    return json.dumps(plain, separators=(",", ":")).encode()


def _begin(home: Path, name: str) -> None:
    log = os.open(home / f"{name}.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)
    logging.basicConfig(
        level=logging.INFO, format="%(asctime)s %(process)d %(levelname)-7s %(message)s"
    )
    logging.info("%s begins.", name)
