"""Composition root of the twin server: creates database, bus, clock and HTTP server."""

import contextlib
import gc
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Sequence

import anyio
import uvicorn
from starlette.types import ASGIApp

from slowtime_services.bus import BackgroundBus, Bus, PartialBus, ZenohBus
from slowtime_services.clock import Clock, SystemClock
from slowtime_services.credentials import CredentialsError, options_for
from slowtime_services.shutdown import ended_by_signals
from slowtime_services.supervision import BEAT_S, Heartbeat, WatchReport, notify
from slowtime_services.tracing import NoTelemetryError, SpanTraces, traces_of
from twin_server.fairness import Holdings, Processors, usable_processors
from twin_server.notify import Notifier, WrongReceiverError, senders_of
from twin_server.persist import (
    Store,
    StoreError,
    StoreInUseError,
    WrongStoreError,
    note_path,
    open_store,
)
from twin_server.pipeline import (
    Alarms,
    AssetEvents,
    ChangeHistory,
    CompositeRegistry,
    Diagnoses,
    FeatureTraces,
    LiveUpdates,
    ModelChangeMonitor,
    NotifierTrigger,
    Pipeline,
    QuarantineDesk,
    Recordings,
    TwinKnowledge,
    WorkerProcesses,
)
from twin_server.pipeline.progress import ProgressMonitor
from twin_server.registration.twin import (
    Registration,
    WrongRegistrationsError,
    registrations,
)
from twin_server.serve import ComputeQueue, Hub, create_app
from twin_server.serve.access import (
    Guard,
    NotSecuredError,
    WrongTokenFileError,
    guarded,
)
from twin_server.serve.http.connections import ConnectionLimits, Connections
from twin_server.serve.http.problems import install_unavailable
from twin_server.serve.http.shutdown import ShutdownAnswer
from twin_server.serve.request_traces import Traced
from twin_server.serve.shard_interface import ShardDoor, create_shard_interface
from twin_server.settings import TwinSettings

logger = logging.getLogger(__name__)

DIAGNOSIS = (sys.executable, "-m", "twin_server.diagnose")
"""Command of the process that makes one diagnosis."""

STANDBY_S = 0.5
"""How often a standby looks whether the database is free [s]."""

ATTEMPT_S = 2.0
"""For how long Zenoh is asked to find the router at once, and the server does not begin yet."""


def run(
    settings: TwinSettings,
    *,
    bus: Bus | None = None,
    clock: Clock | None = None,
    stop: threading.Event | None = None,
    ready: Callable[[str], None] | None = None,
    diagnosis: Sequence[str] = DIAGNOSIS,
    traces: SpanTraces | None = None,
    owned: bool | None = None,
) -> int:
    """Serve until `stop` is set, or until SIGINT or SIGTERM.

    Parameters
    ----------
    bus
        An open bus to use instead of Zenoh; it is not closed.
    clock
        Judges the clocks of messages.
    stop
        Set from outside to end.
    ready
        Told the URL once the server answers.
    diagnosis
        Command of the process that makes one diagnosis, of the folder that is added.
    traces
        Others than the environment asks for.
    owned
        Whether the process is this server's, which may end it where it stands still; by
        default if it runs in the main thread.

    Returns
    -------
    0 after a clean end, 2 where settings or surroundings are wrong: the log says what to do.
    """
    stop = stop or threading.Event()
    if owned is None:
        owned = threading.current_thread() is threading.main_thread()
    try:
        with contextlib.ExitStack() as open_things:
            grace_s = settings.shutdown_s + settings.progress.end_s
            open_things.enter_context(ended_by_signals(stop, grace_s=grace_s))
            heartbeat = open_things.enter_context(Heartbeat(_watch(settings, grace_s, owned)))
            guard = guarded(settings)
            if traces is None and (traces := traces_of("twin")) is not None:
                open_things.callback(traces.close)
            listening = open_things.enter_context(
                listening_socket(settings.host, settings.port)
            )
            store = _open_store(settings, stop)
            if store is None:
                return 0
            open_things.callback(store.close)
            if bus is None:
                late = open_things.enter_context(_late_bus(settings, clock))
                late.wait(min(ATTEMPT_S, settings.connect_timeout_s))
                bus = late
            if settings.shards.share is not None:
                bus = PartialBus(bus, settings.shards.share.has)
            _serve(
                settings, guard, listening, store, bus, clock, stop, ready, diagnosis, traces,
                heartbeat,
            )  # fmt: skip
    except (
        CredentialsError,
        NotSecuredError,
        NoTelemetryError,
        WrongTokenFileError,
        WrongStoreError,
        WrongReceiverError,
        WrongRegistrationsError,
        AddressError,
    ) as error:
        logger.error("%s", error)
        return 2
    logger.info("The twin server has ended.")
    return 0


class AddressError(OSError):
    """An address that cannot be listened on."""


OTHER_FILES = 512
"""Files beside connections: database, bus, recordings, processes."""

SWITCH_S = 0.001
"""How long one thread may keep the interpreter from the others: the door's is one of many."""


class _Server(uvicorn.Server):
    """Uvicorn that ends the live streams before it waits for its clients."""

    def __init__(self, config: uvicorn.Config, hub: Hub, threads: int) -> None:
        super().__init__(config)
        self._hub, self._threads = hub, threads

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        anyio.to_thread.current_default_thread_limiter().total_tokens = self._threads
        await super().startup(sockets)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._hub.close()
        await super().shutdown(sockets)


def _serve(
    settings: TwinSettings,
    guard: Guard,
    listening: socket.socket,
    store: Store,
    bus: Bus,
    clock: Clock | None,
    stop: threading.Event,
    ready: Callable[[str], None] | None,
    diagnosis: Sequence[str],
    traces: SpanTraces | None,
    heartbeat: Heartbeat,
) -> None:
    senders = senders_of(settings.alarms)
    pipeline = Pipeline(settings, store, bus=bus, clock=clock)
    limits = settings.serve
    hub = Hub(limits.max_live_clients, limits.live_backlog, limits.max_live_of_one)
    pipeline.listen(LiveUpdates(hub))
    change_monitor = ModelChangeMonitor(pipeline, store)
    pipeline.listen(change_monitor)
    if traces is not None:
        pipeline.listen(FeatureTraces(pipeline, traces, clock or SystemClock()))
    alarms = Alarms(pipeline, store, clock)
    notifier = Notifier(settings.alarms, alarms, senders, clock or SystemClock())
    pipeline.listen(NotifierTrigger(notifier.wake))
    allow_files(limits.max_connections + OTHER_FILES)
    # The shards of a machine share its processors, as they do the workers.
    processors = Processors(max(1, usable_processors() // settings.shards.count))
    workers = WorkerProcesses(
        limits.workers + limits.spare_workers, limits.work_timeout_s, processors
    )
    queue = ComputeQueue(
        limits.workers, limits.max_waiting, limits.max_waiting_of_one, limits.spare_workers,
        processors.usage,
    )  # fmt: skip
    recordings = Recordings(
        settings.diagnose.recordings,
        settings.recordings,
        lambda twin_id: pipeline.twin(twin_id) is not None,
        bus,
        processors,
    )
    orders = Diagnoses(
        pipeline, store, settings.diagnose, settings.gap, diagnosis, bus=bus, clock=clock,
        recordings=recordings.folder, processors=processors,
    )  # fmt: skip
    knowledge = TwinKnowledge(
        pipeline,
        store,
        bus=bus,
        refresh=limits.forecast_refresh_readings,
        workers=workers,
        disagrees=orders.disagrees,
    )
    holdings = Holdings()
    for quota in (recordings.uploads.quota, recordings.replays, orders.quota):
        holdings.add(quota)
    compositions = CompositeRegistry(pipeline, store, clock)
    asset_events = AssetEvents(pipeline, store, clock)
    app = create_app(
        knowledge, hub, settings.serve, orders, recordings,
        largest_recording=settings.recordings.max_bytes, queue=queue, alarm_service=alarms,
        composite_service=compositions,
        events=asset_events, holdings=holdings,
        changes=ChangeHistory(pipeline, store, asset_events),
        quarantine_service=QuarantineDesk(pipeline, store, clock),
    )  # fmt: skip
    install_unavailable(app, StoreError, WrongStoreError)
    door_of: ASGIApp = guard.around(app)
    if settings.shards.key:
        interface = create_shard_interface(knowledge, compositions, queue)
        install_unavailable(interface, StoreError, WrongStoreError)
        door_of = ShardDoor(door_of, interface, settings.shards.key)
    connections = Connections(limits_of(settings))
    config = http_config(Traced(door_of, traces) if traces else door_of, settings, connections)
    server = _Server(config, hub, limits.reading_threads)
    # Off the main thread, where uvicorn leaves the signals alone.
    door = threading.Thread(
        target=server.run, kwargs={"sockets": [listening]}, name="http", daemon=True
    )
    wanted = _wanted(settings)
    for twin_id, registration in wanted.items():
        pipeline.routing.check(twin_id, registration)
    pipeline.start()
    heartbeat.look = _monitor(pipeline, end=heartbeat.watches).look
    for twin_id, registration in wanted.items():
        if pipeline.twin(twin_id) is None:
            pipeline.register(twin_id, registration)
    orders.start()
    change_monitor.start()
    knowledge.prospects.start()
    notifier.start()
    door.start()
    collect_less_often()
    sys.setswitchinterval(SWITCH_S)
    try:
        while not server.started and door.is_alive():
            stop.wait(0.01)
        host, port = listening.getsockname()[:2]
        scheme = "http" if settings.tls is None else "https"
        url = f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"
        logger.info("The twin server answers at %s.", url)
        if ready is not None:
            ready(url)
        heartbeat.ready()
        workers.warm()  # only now: loading takes seconds of a processor that the start needs
        while not stop.wait(0.2) and door.is_alive():
            pass
    finally:
        heartbeat.leaving()
        server.should_exit = True
        queue.close()
        workers.close()
        door.join(settings.shutdown_s + 1.0)
        recordings.stop()
        orders.stop()
        change_monitor.stop()
        knowledge.prospects.stop()
        notifier.stop(settings.shutdown_s)
        pipeline.stop(settings.progress.end_s / 4)


def _watch(settings: TwinSettings, grace_s: float, owned: bool) -> WatchReport | None:
    """Return what the watcher of this process is told; None where it is not ours to end."""
    if not owned:
        return None
    marked = note_path(settings.database, settings.shards.share)
    return WatchReport(silent_s=settings.progress.silent_s, grace_s=grace_s, marked=marked)


def _monitor(pipeline: Pipeline, *, end: bool) -> ProgressMonitor:
    """Return what looks after the pipeline, and ends the process where it stands still."""
    aside = pipeline.setting_aside
    return ProgressMonitor(
        pipeline.settings.progress,
        aside.progress,
        aside.budget,
        lambda: pipeline.waits,
        pipeline.stall,
        look_s=BEAT_S,
        end=os._exit if end else None,
    )


def _open_store(settings: TwinSettings, stop: threading.Event) -> Store | None:
    """Open the database; a standby waits for it, and gives None once it is stopped."""
    said = False
    while True:
        try:
            return open_store(
                settings.database, synchronous=settings.synchronous, share=settings.shards.share
            )
        except StoreInUseError as error:
            if not settings.standby:
                raise
            if not said:
                logger.info("Standing by. %s", error)
                notify("READY=1", "STATUS=Standing by: another server has the database.")
            said = True
        if stop.wait(STANDBY_S):
            return None


def _wanted(settings: TwinSettings) -> dict[str, Registration]:
    """Read the registrations to begin with, of the assets that this server has."""
    share = settings.shards.share
    found = registrations(settings.registrations)
    if share is None:
        return found
    return {
        twin_id: registration
        for twin_id, registration in found.items()
        if share.has(twin_id.partition(".")[2])
    }


def allow_files(count: int) -> None:
    """Raise the limit of open files of this process, as far as the system allows."""
    try:
        import resource
    except ModuleNotFoundError:  # not on every system
        return

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = count if hard == resource.RLIM_INFINITY else min(count, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    if most < count:
        logger.warning(
            "%d files may be open here, and %d connections need more. Raise the limit "
            "(ulimit -n, or LimitNOFILE= of the unit), or lower serve.max_connections.",
            most,
            count - OTHER_FILES,
        )


def collect_less_often() -> None:
    """Keep the garbage collector from walking through all twins for every batch.

    Half the time of a busy server went into that. What lives as long as the server is set
    aside; a batch makes tens of thousands of objects, none of them in a cycle.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 20, 50)


def limits_of(settings: TwinSettings) -> ConnectionLimits:
    """Return the limits of connections."""
    serve = settings.serve
    return ConnectionLimits(
        head_s=serve.head_s,
        body_s=serve.body_s,
        slowest_bytes_per_s=serve.slowest_bytes_per_s,
        upload_s=serve.upload_s,
        most=serve.max_connections,
        # A proxy has all connections; it is for that to bound those of its own clients.
        most_of_one=None if settings.access.behind_proxy else serve.max_connections_of_one,
    )


def http_config(
    app: ASGIApp, settings: TwinSettings, connections: Connections
) -> uvicorn.Config:
    """Return how uvicorn serves `app`."""
    return uvicorn.Config(
        ShutdownAnswer(app),
        http=connections.protocol(),
        log_config=None,
        access_log=False,
        lifespan="off",
        ws="none",
        server_header=False,
        proxy_headers=settings.access.behind_proxy,
        limit_concurrency=settings.serve.max_connections,
        ssl_certfile=settings.tls.certificate if settings.tls else None,
        ssl_keyfile=settings.tls.key if settings.tls else None,
        timeout_graceful_shutdown=max(1, int(settings.shutdown_s)),
    )


def _late_bus(settings: TwinSettings, clock: Clock | None) -> BackgroundBus:
    """Wait for the router as long as it takes; page and history need none."""
    options = options_for(settings.credentials, settings.connect, settings.zenoh)

    def opened() -> ZenohBus:
        return ZenohBus(
            "client",
            connect=settings.connect,
            open_timeout_s=min(ATTEMPT_S, settings.connect_timeout_s),
            options=options,
            clock=clock,
        )

    return BackgroundBus(opened, say_every_s=settings.connect_timeout_s)


@contextlib.contextmanager
def listening_socket(host: str, port: int) -> Iterator[socket.socket]:
    """Open the listening socket first, so that a taken port is detected early."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((host, port))
        except OSError as error:
            raise AddressError(
                f"The server cannot listen on {host}:{port}: {error.strerror or error}. "
                "Give another --port or --host, or stop the process that uses it."
            ) from error
        yield listening


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)
    sys.exit(run(TwinSettings()))
