"""Composition root of the edge agent: settings in, real source, clock, bus and disk chosen."""

import contextlib
import datetime
import functools
import importlib.metadata
import logging
import secrets
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from slowtime.signals.block import Block
from slowtime_schemas.partitions import partition_of
from slowtime_services.bus import BackgroundBus, Bus, ZenohBus
from slowtime_services.clock import Clock, SystemClock
from slowtime_services.credentials import Credentials, options_for
from slowtime_services.shutdown import ended_by_signals
from slowtime_services.tracing import SpanTraces, traces_of

from .acquire import BlockSource, CountingSource, Pacer, check_input, open_source
from .inputs import BoardInput, BoardsInput
from .pipeline import Edge, listen
from .publish import Publisher, Spool
from .publish.uplink import TICK_S
from .settings import EdgeSettings, Origin

logger = logging.getLogger(__name__)

PRIVATE: dict[str, Any] = {
    name: True
    for name in ("source", "password_file", "ca_file", "certificate_file", "key_file", "sysfs")
}
PRIVATE["boards"] = {"__all__": dict(PRIVATE)}
"""Settings of inputs that are nobody's business beyond this machine."""

SETTLING_S = 0.2
"""From a connection until both sides know of each other's subscriptions."""

ATTEMPT_S = 2.0
"""Time of one attempt to reach any of several routers [s]."""


def run(
    settings: EdgeSettings,
    *,
    bus: Bus | None = None,
    clock: Clock | None = None,
    source: BlockSource | None = None,
    stop: threading.Event | None = None,
    traces: SpanTraces | None = None,
) -> int:
    """Run an edge agent until its input ends or it is stopped.

    Parameters
    ----------
    bus, clock, source
        Others than the settings would choose; a bus that is given stays open.
    stop
        Set it to end; None to end on SIGINT and SIGTERM.
    traces
        Others than the environment asks for.

    Returns
    -------
    Exit status: 0.
    """
    with contextlib.ExitStack() as stack:
        if stop is None:
            stop = stack.enter_context(ended_by_signals())
        if source is None and isinstance(settings.input, BoardsInput):
            return _run_boards(settings, settings.input, bus, clock, stop)
        clock = clock or SystemClock()
        if traces is None and (traces := traces_of("edge")) is not None:
            stack.callback(traces.close)
        check_input(settings.input)
        if bus is None:
            bus = stack.enter_context(_connected(settings, clock, stop))
        source = source or open_source(
            settings.input,
            clock,
            stop,
            tuple(settings.extract.covariates.values()),
            bus=bus,
            twin=(settings.site, settings.asset),
        )
        boot = settings.boot or new_boot(clock)
        blocks = iter(source)
        while (
            rest := _run_boot(settings, boot, source, blocks, bus, clock, stop, traces)
        ) is not None:
            boot, blocks = new_boot(clock), rest
            logger.warning("The sensor's time has gone backwards; a new boot begins.")
    return 0


def _run_boards(
    settings: EdgeSettings,
    given: BoardsInput,
    bus: Bus | None,
    clock: Clock | None,
    stop: threading.Event,
) -> int:
    """Run an agent a board, each in a thread of its own, until all have ended."""
    check_input(given)
    logger.warning(
        "%d boards are kept apart, as %s: their clocks are not aligned, and samples that are "
        "not taken at the same time must not share a mode shape.",
        len(given.boards),
        ", ".join(f"{settings.asset}-{board.name}" for board in given.boards),
    )
    failed: list[str] = []

    def one(board: BoardInput) -> None:
        try:
            own = {"asset": f"{settings.asset}-{board.name}", "input": board}
            run(settings.model_copy(update=own), bus=bus, clock=clock, stop=stop)
        except Exception:
            failed.append(board.name)
            logger.exception("Board %s cannot be read; the others can.", board.name)

    threads = [
        threading.Thread(target=one, args=(board,), name=f"board {board.name}")
        for board in given.boards
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return int(len(failed) == len(threads))


def _run_boot(
    settings: EdgeSettings,
    boot: str,
    source: BlockSource,
    blocks: Iterator[Block | None],
    bus: Bus,
    clock: Clock,
    stop: threading.Event,
    traces: SpanTraces | None,
) -> Iterator[Block | None] | None:
    """Listen under one boot; give the blocks from where sensor time runs back, if it does."""
    origin = Origin(
        site=settings.site,
        asset=settings.asset,
        boot=boot,
        time_base=source.time_base,
        slow_time_unit=source.slow_time_unit,
    )
    with contextlib.ExitStack() as stack:
        spool = Spool(
            settings.spool.folder / f"{origin.site}.{origin.asset}",
            origin.boot,
            max_bytes=settings.spool.max_bytes,
            segment_bytes=settings.spool.segment_bytes,
            keep_acknowledged_s=settings.spool.keep_acknowledged_s,
            fsync=settings.spool.fsync,
        )
        stack.callback(spool.close)
        publisher = Publisher(
            origin,
            spool,
            bus,
            clock,
            settings.publishing,
            software=f"slowtime {importlib.metadata.version('slowtime')}",
            about=_about(settings),
            traces=traces,
            counts=source.counts if isinstance(source, CountingSource) else None,
            link=settings.link,
        )
        publisher.open()
        stack.callback(publisher.close)
        logger.info("Edge %s.%s, boot %s.", origin.site, origin.asset, origin.boot)
        assess = None
        if settings.virtual is not None or settings.fatigue.points:
            from .assess import Assess  # an edge that assesses nothing imports no mechanics

            assess = Assess(settings, origin)
        with _heartbeat(publisher, settings):
            edge = Edge.of(settings.processing, origin)
            rest = listen(blocks, edge, settings.admission, publisher, clock, stop, assess)
            publisher.flush_unless_held()
            publisher.health()
            if rest is None and not stop.is_set():
                publisher.wait_acknowledged(settings.publish.linger_s, stop)
            return rest


def _connected(settings: EdgeSettings, clock: Clock, stop: threading.Event) -> Bus:
    """Open the bus and give the router a moment; without it the agent begins all the same."""
    if settings.credentials is not None:
        own = Credentials.read(settings.credentials, at_any_time=True)
        own.check_is_of_edge(settings.site, settings.asset)
    options = options_for(
        settings.credentials, settings.connect, settings.zenoh, at_any_time=True
    )
    bus = _bus(settings, options, clock)
    patience = Pacer(SystemClock(), stop)
    waited = 0.0
    while not bus.connected and waited < settings.connect_wait_s:
        waited += 0.05
        if not patience.wait_until(waited):
            break
    if bus.connected:
        patience.wait_until(waited + SETTLING_S)
    else:
        logger.warning("No router at %s yet; listening begins.", ", ".join(settings.connect))
    return bus


def _bus(
    settings: EdgeSettings, options: Mapping[str, object], clock: Clock
) -> ZenohBus | BackgroundBus:
    """Open a bus over the one router, or over one of several."""
    # A peer connects to all routers it is given, and would send everything to each. A client
    # takes the first that answers, and the next one when that dies; but it waits for one.
    bus = functools.partial(
        ZenohBus,
        lease_s=settings.publishing.lease_s,
        keep_alives=settings.publishing.keep_alives,
        options=options,
        clock=clock,
    )
    if len(settings.connect) == 1:
        return bus("peer", settings.connect)
    routers = own_order(settings.connect, settings.asset)

    def opened() -> ZenohBus:
        return bus("client", routers, open_timeout_s=ATTEMPT_S)

    return BackgroundBus(opened)


def own_order(routers: Sequence[str], asset: str) -> tuple[str, ...]:
    """Return the routers of a site in the order in which an asset tries them.

    Examples
    --------
    >>> own_order(("tcp/a:7447", "tcp/b:7447"), "bridge-7")
    ('tcp/b:7447', 'tcp/a:7447')
    """
    # The assets of a site begin with different routers, by their partition, so that each has
    # its share.
    first = partition_of(asset) % len(routers)
    return (*routers[first:], *routers[:first])


def new_boot(clock: Clock) -> str:
    """Name a run: names sort as runs began, and no two are the same.

    Examples
    --------
    >>> from slowtime_services.clock import HandClock
    >>> new_boot(HandClock(1_767_225_600_123_000_000))[:-6]
    '20260101T000000.123Z-'
    """
    now = clock.now_ns()
    when = datetime.datetime.fromtimestamp(now // 10**9, datetime.UTC)
    return f"{when:%Y%m%dT%H%M%S}.{now // 10**6 % 1000:03d}Z-{secrets.token_hex(3)}"


@contextlib.contextmanager
def _heartbeat(publisher: Publisher, settings: EdgeSettings) -> Iterator[None]:
    """Publish what is due, such as health, from a thread of its own."""
    over = threading.Event()
    every_s = min(settings.publishing.health_every_s, TICK_S)

    def beat() -> None:
        before_s = time.monotonic()
        while not over.wait(every_s):
            now_s = time.monotonic()
            passed_s, before_s = now_s - before_s, now_s
            try:
                publisher.tick(passed_s)
            except Exception:
                publisher.count("failed_heartbeats")
                logger.exception("Health could not be published; the next one follows.")

    thread = threading.Thread(target=beat, name="heartbeat", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _about(settings: EdgeSettings) -> dict[str, object]:
    """Make the `About` message: the settings that decide the features, without secrets."""
    return {
        "processing": settings.processing.model_dump(mode="json"),
        "input": settings.input.model_dump(mode="json", exclude=PRIVATE),
        "raw": settings.publish.raw,
    }


def main() -> None:
    """Run with settings from flags, environment and file; exit 2 where they are wrong."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)-7s %(message)s")
    try:
        status = run(EdgeSettings(_cli_parse_args=True))
    except (ValueError, OSError) as error:
        sys.stderr.write(f"edge_agent: {error}\n")
        status = 2
    sys.exit(status)


if __name__ == "__main__":
    main()
