"""The bus over Zenoh.

Congestion: BLOCK. A burst then slows its sender instead of vanishing; it is not a guarantee
(Zenoh cuts a receiver off that does not drain for five seconds), which is why callbacks only
enqueue and why the twin keeps an account of sequences. Not express: batching costs about
20 us of latency and gives ten times the throughput. Raw blocks travel at low priority, so that
a burst of samples does not delay features. Shared memory is off: our messages are small, and
containers do not share it. The library's own log goes to standard output, where it would
corrupt a command's result, so it is only switched on by setting RUST_LOG.
"""

import atexit
import json
import logging
import os
import re
import struct
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, Self
from urllib.parse import quote, unquote

import zenoh

from slowtime_schemas.streams import RAW, STREAMS
from slowtime_services.clock import Clock, SystemClock

from .keys import check_key
from .protocol import (
    MOST_ANSWER_BYTES,
    Answers,
    BusClosedError,
    BusUnreachableError,
    Query,
    Sample,
)
from .socket_table import established_ports, ports_of

logger = logging.getLogger(__name__)

Mode = Literal["client", "peer", "router"]
Handler = Callable[[Query], Iterable[tuple[str, bytes]]]

ATTACHMENT = struct.Struct("<BQ")
FORMAT = 0x10
REPLAYED = 0x01

MOST_ERRORS = 100
"""Errors in answer to one query that are told."""


def pack_attachment(sent_ns: int, replayed: bool) -> bytes:
    """Nine bytes beside the payload: format and flags, then the sender's clock [ns]."""
    return ATTACHMENT.pack(FORMAT | (REPLAYED if replayed else 0), sent_ns)


def unpack_attachment(attachment: bytes | None) -> tuple[int | None, bool]:
    """Sender's clock and replayed flag; (None, False) of a foreign sender."""
    if attachment is None or len(attachment) != ATTACHMENT.size:
        return None, False
    flags, sent_ns = ATTACHMENT.unpack(attachment)
    if flags & ~REPLAYED != FORMAT:
        return None, False
    return sent_ns, bool(flags & REPLAYED)


class _Declared:
    """A Zenoh entity, referenced as long as it shall last: Zenoh drops those that are not.

    It keeps how it was declared, so that it can be declared again in another session.
    """

    def __init__(self, bus: "ZenohBus", declare: Callable[[zenoh.Session], Any]) -> None:
        self._bus, self.declare = bus, declare
        self.entity: Any = None

    def close(self) -> None:
        self._bus._withdraw(self)


WATCH_DELAY_S = 1.0
CHECK_S = 5.0
"""Interval at which sockets are looked for, at most [s]."""
SOUND_CHECKS = 12
"""Checks in which a new link must have a socket [1]: a minute. Source: on a machine at load
20, a router that closed kept a socket open for some seconds."""


class ZenohBus:
    """Messages between processes and machines.

    Parameters
    ----------
    mode
        ``"client"`` needs a router to open at all. ``"peer"`` opens at once and connects when
        the router appears, which is what an edge agent wants; but peers do not hear each
        other through a router (since Zenoh 1.9), so that every other process is a client.
        ``"router"`` is what they connect to.
    connect, listen
        Endpoints such as ``"tcp/10.0.0.2:7447"``. Nothing is discovered: who is not named is
        not spoken to.
    open_timeout_s
        How long a client waits for the router; None for ever. Others do not wait.
    lease_s
        After how long a silent process (cut cable, frozen machine) counts as gone; a process
        that died is noticed at once.
    keep_alives
        Keep-alives that are sent in that time, where nothing else is.
    shared_memory
        Whether large payloads between processes of one machine go through shared memory.
    options
        Further Zenoh settings, key to value, such as those of TLS or access control.
    clock
        Stamps `sent_ns`.

    Raises
    ------
    BusUnreachableError
        Where a client finds no router, or a listening port is taken.
    """

    def __init__(
        self,
        mode: Mode = "client",
        connect: Sequence[str] = (),
        listen: Sequence[str] = (),
        *,
        open_timeout_s: float | None = 10.0,
        lease_s: float = 5.0,
        keep_alives: int = 4,
        shared_memory: bool = False,
        options: Mapping[str, object] | None = None,
        clock: Clock | None = None,
    ) -> None:
        if "RUST_LOG" in os.environ:
            zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]
        self.mode, self.connect, self.listen = mode, tuple(connect), tuple(listen)
        self._clock = clock or SystemClock()
        self._callback_errors = 0
        self._lock = threading.Lock()
        self._declared: set[_Declared] = set()
        self._closed = False
        config = _configure(mode, connect, listen, open_timeout_s, shared_memory)
        config.insert_json5("transport/link/tx/lease", str(round(1000 * lease_s)))
        config.insert_json5("transport/link/tx/keep_alive", str(keep_alives))
        for name, value in (options or {}).items():
            config.insert_json5(name, json.dumps(value))
        self._config = config
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise BusUnreachableError(_why(mode, connect, listen, error)) from error
        self._ending = threading.Event()
        _close_at_exit(self)
        if mode != "router" and connect and established_ports() is not None:
            threading.Thread(
                target=_reconnect_dead,
                args=(weakref.ref(self), self._ending, min(lease_s, CHECK_S)),
                name="bus connection",
            ).start()

    @property
    def callback_errors(self) -> int:
        """Number of exceptions raised by callbacks and handlers of this bus."""
        return self._callback_errors

    @property
    def watch_delay_s(self) -> float:
        """A round trip to the router, with much to spare on a busy machine."""
        return WATCH_DELAY_S

    @property
    def connected(self) -> bool:
        """Whether any other process is connected right now."""
        return not self._closed and bool(
            list(self._session.info.routers_zid()) or list(self._session.info.peers_zid())
        )

    def publish(
        self, key: str, payload: bytes, *, encoding: str, replayed: bool = False
    ) -> None:
        """Send; may wait for seconds where receivers do not drain, and drops while offline."""
        self._check_open()
        self._session.put(
            check_key(key, wildcards=False),
            payload,
            encoding=encoding,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=_BULK if encoding == RAW.encoding else _USUAL,
            attachment=pack_attachment(self._clock.now_ns(), replayed),
        )

    def subscribe(self, key_expression: str, callback: Callable[[Sample], None]) -> _Declared:
        """Call `callback`, from a thread of the bus, for each message; it must only enqueue."""
        self._check_open()
        key = check_key(key_expression, wildcards=True)

        def declare(session: zenoh.Session) -> Any:
            entity = session.declare_subscriber(key, zenoh.handlers.FifoChannel(_WAITING))
            # A thread of Zenoh's own would pass the interpreter's lock back and forth for each
            # message, which costs a busy process more than receiving does. No daemon: one that
            # wakes up while the interpreter ends takes the process down with it.
            threading.Thread(
                target=self._pump, args=(entity.handler, callback), name=f"bus {key}"
            ).start()
            return entity

        return self._keep(declare)

    def _pump(self, channel: Any, callback: Callable[[Sample], None]) -> None:
        """Empty a channel into `callback`, all there is at a time, until it is closed."""
        put, sample = zenoh.SampleKind.PUT, None
        while True:
            try:
                sample = channel.try_recv() or channel.recv()
            except zenoh.ZError:
                return
            try:
                if sample.kind == put:
                    callback(_as_sample(sample))
            except Exception:
                self._failed(str(sample.key_expr))

    def answer(self, key: str, handler: Handler) -> _Declared:
        """Answer questions on `key`, one at a time, in a thread of the bus."""

        def reply(query: zenoh.Query) -> None:
            with query:
                try:
                    for reply_key, payload in handler(_as_query(query)):
                        stamp = pack_attachment(self._clock.now_ns(), False)
                        query.reply(reply_key, payload, attachment=stamp)
                except Exception as error:
                    self._callback_errors += 1
                    logger.exception("A query on %s could not be answered.", query.key_expr)
                    query.reply_err(f"{type(error).__name__}: {error}")

        self._check_open()
        check_key(key, wildcards=True)
        return self._keep(lambda session: session.declare_queryable(key, reply))

    def ask(
        self,
        key_expression: str,
        parameters: Mapping[str, str] | None = None,
        *,
        timeout_s: float = 2.0,
        max_bytes: int = MOST_ANSWER_BYTES,
    ) -> Answers:
        """Return all answers within `timeout_s`; at once if no process can answer."""
        self._check_open()
        selector = zenoh.Selector(
            check_key(key_expression, wildcards=True), _as_parameters(parameters or {})
        )
        errors: list[str] = []

        def samples() -> Iterator[Sample]:
            for reply in self._session.get(
                selector,
                timeout=timeout_s,
                accept_replies=zenoh.ReplyKeyExpr.ANY,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
            ):
                if reply.ok is not None:
                    yield _as_sample(reply.ok)
                elif reply.err is not None and len(errors) < MOST_ERRORS:
                    errors.append(reply.err.payload.to_bytes().decode(errors="replace")[:1000])

        answers = Answers.first_of(samples(), max_bytes)
        return Answers(answers, (*errors, *answers.errors))

    def announce(self, key: str) -> _Declared:
        """Be alive under `key` until the handle is closed or the process ends, in any way."""
        self._check_open()
        check_key(key, wildcards=False)
        return self._keep(lambda session: session.liveliness().declare_token(key))

    def watch(self, key_expression: str, callback: Callable[[str, bool], None]) -> _Declared:
        """Call `callback(key, alive)` for those alive now and for each change."""

        def change(sample: zenoh.Sample) -> None:
            key, alive = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
            try:
                callback(key, alive)
            except Exception:
                self._failed(key)

        self._check_open()
        check_key(key_expression, wildcards=True)
        return self._keep(
            lambda session: session.liveliness().declare_subscriber(
                key_expression, change, history=True
            )
        )

    def link_ports(self) -> set[tuple[int, int]]:
        """Return local and remote port of each link over TCP that Zenoh lists."""
        links = [ports_of(link.src, link.dst) for link in self._session.info.links()]
        return {ports for ports in links if ports is not None}

    def reconnect(self) -> None:
        """Open a new session and declare all in it again; the old one is closed.

        Raises
        ------
        BusUnreachableError
            Where a client finds no router; the old session stays.
        """
        self._check_open()
        try:
            session = zenoh.open(self._config)
        except zenoh.ZError as error:
            why = _why(self.mode, self.connect, self.listen, error)
            raise BusUnreachableError(why) from error
        with self._lock:
            before = list(self._declared)
        # Not under the lock: Zenoh may call back at once, and a callback may use the bus.
        entities = {declared: declared.declare(session) for declared in before}
        with self._lock:
            later = self._declared - entities.keys()
            for declared in self._declared & entities.keys():
                declared.entity = entities[declared]
            unused = session
            if not self._closed:
                unused, self._session = self._session, session
        for declared in later if unused is not session else ():
            declared.entity = declared.declare(session)
        unused.close()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Withdraw everything and leave; without it a process with callbacks never ends."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._declared.clear()
        self._ending.set()
        self._session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        """Return the bus."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def _check_open(self) -> None:
        if self._closed:
            raise BusClosedError

    def _keep(self, declare: Callable[[zenoh.Session], Any]) -> _Declared:
        declared = _Declared(self, declare)
        while True:
            session = self._session
            try:
                declared.entity = declare(session)
            except zenoh.ZError:
                if self._session is session:
                    raise
                continue  # `reconnect` has closed it since
            with self._lock:
                if self._session is session:
                    self._declared.add(declared)
                    return declared

    def _withdraw(self, declared: _Declared) -> None:
        with self._lock:
            if self._closed or declared not in self._declared:
                return
            self._declared.remove(declared)
        declared.entity.undeclare()

    def _failed(self, key: str) -> None:
        """Count and log the current exception; the stream continues."""
        self._callback_errors += 1
        logger.exception("A callback failed on %s; the stream continues.", key)


MOST_MESSAGE_BYTES = max(stream.max_bytes for stream in STREAMS) + 2**16
"""Largest message that is put together out of its fragments [bytes]: the largest payload of a
stream, with what is beside it. A larger one is left out, and the connection stays."""

_WAITING = 2048
_USUAL = zenoh.Priority.DATA
_BULK = zenoh.Priority.DATA_LOW


def _configure(
    mode: Mode,
    connect: Sequence[str],
    listen: Sequence[str],
    open_timeout_s: float | None,
    shared_memory: bool,
) -> zenoh.Config:
    waits_for_ever = mode != "client" or open_timeout_s is None
    retry = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5}
    settings: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "connect/endpoints": list(connect),
        "connect/retry": retry,
        "connect/timeout_ms": -1 if waits_for_ever else round(1000 * (open_timeout_s or 0.0)),
        "transport/link/rx/max_message_size": MOST_MESSAGE_BYTES,
        "transport/shared_memory/enabled": shared_memory,
    }
    if mode != "client":
        settings["listen/endpoints"] = list(listen)
    config = zenoh.Config()
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def _why(mode: Mode, connect: Sequence[str], listen: Sequence[str], error: Exception) -> str:
    # Zenoh ends its sentences with where in its own source they were written.
    said = re.sub(r"\s+at /\S+\.rs:\d+\.?", "", str(error))
    if mode == "client":
        return (
            f"No router answers at {', '.join(connect) or '(no endpoint given)'}. Start one "
            "with `slowtime router`, or give the right endpoint, such as tcp/127.0.0.1:7447. "
            f"({said})"
        )
    return (
        f"Cannot open as {mode} listening on {', '.join(listen) or '(nothing)'}: another "
        "process may have the port, or an endpoint is misspelt; they look like "
        f"tcp/0.0.0.0:7447. ({said})"
    )


def _as_sample(sample: zenoh.Sample) -> Sample:
    attachment = sample.attachment
    sent_ns, replayed = unpack_attachment(attachment.to_bytes() if attachment else None)
    return Sample(str(sample.key_expr), sample.payload.to_bytes(), sent_ns, replayed)


def _as_parameters(parameters: Mapping[str, str]) -> str:
    """`a=1;b=2`, with the characters that have a meaning there escaped."""
    return ";".join(f"{quote(k, safe='')}={quote(v, safe='')}" for k, v in parameters.items())


def _as_query(query: zenoh.Query) -> Query:
    """Leave out the parameters that are Zenoh's own, which begin with `_`."""
    pairs = (part.partition("=") for part in str(query.parameters).split(";") if part)
    given = {unquote(k): unquote(v) for k, _, v in pairs if not k.startswith("_")}
    return Query(str(query.key_expr), given)


def _reconnect_dead(
    reference: "weakref.ref[ZenohBus]", ending: threading.Event, interval_s: float
) -> None:
    """Reconnect a bus whose new link has no socket.

    Zenoh (seen in 1.10.2) keeps a link for ever where the other side closes within about a
    millisecond of its opening: it is shown as connected, nothing passes, and no other
    connection is tried. Links are compared with the kernel's table until they were in it for
    some time, or twice not; what happens to them later, Zenoh notices by itself.
    """
    alive: dict[tuple[int, int], int] = {}
    dead: set[tuple[int, int]] = set()
    while not ending.wait(interval_s):
        if (bus := reference()) is None:
            return
        try:
            links = bus.link_ports()
            fresh = {link for link in links if alive.get(link, 0) < SOUND_CHECKS}
            there = established_ports() if fresh else None
            if there is not None and (fresh - there) & dead:
                logger.warning(
                    "The connection to %s is dead, though Zenoh lists it; reconnecting.",
                    ", ".join(bus.connect),
                )
                bus.reconnect()
                alive, dead = {}, set()
            elif there is not None:
                dead = fresh - there
                alive = {one: alive.get(one, 0) + 1 for one in links & (there | alive.keys())}
        except BusClosedError:
            return
        except Exception as error:
            # A router that is away is tried again; the old session is no worse than before.
            logger.warning("The connection could not be renewed: %s", error)
        del bus


def _close_at_exit(bus: ZenohBus) -> None:
    """Close a forgotten bus, since its threads would keep the interpreter from ending.

    Those threads are joined before `atexit` runs; the hook that runs earlier is private to
    `threading`, and the process of `tests/services/bus` shows whether it still does its work.
    """
    reference = weakref.ref(bus)

    def close() -> None:
        if (alive := reference()) is not None:
            alive.close()

    getattr(threading, "_register_atexit", atexit.register)(close)
