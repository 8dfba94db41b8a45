"""Runs Ray's driver in a process of its own, and starts another where the cluster is lost.

Ray ends the process of a driver whose cluster does not answer for a minute. In a process of its
own it takes no front with it, and the next one joins the cluster with nothing left of the last.
"""

import contextlib
import logging
import multiprocessing
import os
import threading
import time
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, NamedTuple

from slowtime_services.logs import Format, formatter
from slowtime_services.shutdown import ended_by_signals

from .ray_actors import EngineError, RayShards
from .shard_actor import FleetSettings, ShardAddress
from .supervisor import LOOK_S, SOUND_S

if TYPE_CHECKING:
    from twin_server.settings import TwinSettings

logger = logging.getLogger(__name__)


class News(NamedTuple):
    """What a driver tells of its actors.

    Parameters
    ----------
    places
        Where each shard answers; None while it does not.
    restarts
        How many shards were started again.
    """

    places: tuple[ShardAddress | None, ...]
    restarts: int


def drive(engine: str, count: int, pipe: Connection, level: int, form: Format) -> None:
    """Join the cluster, and run the shards of the settings that come, until `pipe` is closed.

    Parameters
    ----------
    engine, count
        As those of `RayShards`.
    pipe
        To the process of the front. It is told why the cluster cannot be joined or is lost, as
        text, and `News` whenever a shard answers or no longer does.
    level, form
        Least level of the log, and how it is written.
    """
    handler = logging.StreamHandler()
    handler.setFormatter(formatter(form))
    logging.basicConfig(level=level, handlers=[handler])
    stop = threading.Event()
    shards = RayShards(engine, count, stop, level=level, form=form)
    with contextlib.suppress(BrokenPipeError), ended_by_signals(stop):
        try:
            shards.join()
        except EngineError as error:
            pipe.send(str(error))
            return
        with ended_by_signals(stop):  # again: Ray has taken SIGTERM
            listening = threading.Thread(
                target=_hear_front, args=(pipe, shards, stop), daemon=True
            )
            listening.start()
            told = None
            while not stop.wait(LOOK_S):
                news = News(tuple(map(shards.place, range(shards.count))), shards.restarts)
                if news != told:
                    pipe.send(news)
                    told = news
            if shards.lost:
                pipe.send(shards.lost)
                logging.shutdown()
                os._exit(1)  # an end in peace would wait for the cluster
            shards.stop()


def _hear_front(pipe: Connection, shards: RayShards, stop: threading.Event) -> None:
    """Start the shards once the front says so; set `stop` once it has closed its end."""
    with contextlib.suppress(EOFError, OSError):
        shards.start(pipe.recv())
        pipe.recv()
    stop.set()


class Driver(NamedTuple):
    """A driver that was begun, and the pipe to it."""

    process: BaseProcess
    pipe: Connection


def begin_driver(engine: str, count: int, level: int, form: Format) -> Driver:
    """Let a driver join a cluster, before all settings are known.

    It ends once the pipe is closed.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(
        target=drive, args=(engine, count, theirs, level, form), name="Ray's driver"
    )
    process.start()
    theirs.close()
    return Driver(process, ours)


class RayFleet:
    """Shards as actors of a Ray cluster, which is joined again where it is lost.

    Shards of a lost cluster answer until their nodes end them. The front asks them there until
    the next driver tells where they answer instead.

    Parameters
    ----------
    settings
        Of the whole fleet; `shards.engine` names the cluster.
    stop
        Set where the fleet ends, so that the cluster is not joined again.
    begun
        A driver that joins the cluster already.
    level, form
        Least level of the log of driver and shards, and how it is written.
    """

    def __init__(
        self,
        settings: "TwinSettings",
        stop: threading.Event,
        *,
        begun: Driver | None = None,
        level: int = logging.INFO,
        form: Format = "text",
    ) -> None:
        self._settings, self._log, self._stop = FleetSettings.of(settings), (level, form), stop
        self._places: list[ShardAddress | None] = [None] * settings.shards.count
        self._news: News | None = None
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        if begun is not None:
            self._process, self._pipe = begun
        self._refusal = ""
        self._failures, self._began_s, self._restarts = 0, 0.0, 0
        self._first = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="driver", daemon=True)
        self.rejoined = 0

    @property
    def count(self) -> int:
        """Number of shards."""
        return len(self._places)

    @property
    def restarts(self) -> int:
        """How many shards were started again by a cluster that was there."""
        return self._restarts + (0 if self._news is None else self._news.restarts)

    @property
    def driver(self) -> int | None:
        """Process of Ray's driver; None while there is none."""
        return None if self._process is None else self._process.pid

    def url(self, index: int) -> str | None:
        """Where a shard answers, or last did in a cluster that is lost; else None."""
        place = self._places[index]
        return None if place is None else place.url

    def place(self, index: int) -> ShardAddress | None:
        """Where a shard answers, with its process and its node, as `url`."""
        return self._places[index]

    def prepare(self) -> None:
        """Join the cluster, so that it is there when the front has loaded its code."""
        if self._process is None:
            self._begin()

    def start(self) -> None:
        """Join the cluster, start all shards, and keep them running.

        Raises
        ------
        EngineError
            If the cluster cannot be joined.
        """
        self.prepare()
        self._release()
        self._thread.start()
        self._first.wait()
        if self._news is None and not self._stop.is_set():
            self._thread.join()
            raise EngineError(self._refusal)

    def stop(self) -> None:
        """End all shards: those that do not end in good time are killed."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._places = [None] * self.count
        self._close()
        if self._process is not None:
            # The driver waits as long for its shards, and then leaves the cluster.
            self._process.join(self._settings.shutdown_s + 20.0)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()

    def _watch(self) -> None:
        while not self._stop.is_set():
            self._hear()
            if self._process is not None and not self._process.is_alive():
                self._hear()  # what it told at its end
                if not self._first.is_set():
                    self._refusal = self._refusal or (
                        f"--engine {self._settings.engine} was given, and Ray's driver "
                        f"ended with code {self._process.exitcode} before it had joined the "
                        "cluster. The lines before this one say why."
                    )
                    break
                self._ended(self._process)
        self._first.set()

    def _hear(self) -> None:
        """Take what the driver tells, or wait a little."""
        try:
            if self._pipe is None or not self._pipe.poll(LOOK_S):
                return
            told = self._pipe.recv()
        except (EOFError, OSError):
            self._stop.wait(LOOK_S)
            return
        if isinstance(told, str):
            self._refusal = told
            return
        before = (() if self._news is None else self._news.places) + (None,) * self.count
        for index, place in enumerate(told.places):
            if place is not None or before[index] is not None:
                self._places[index] = place
        self._news = told
        self._first.set()

    def _begin(self) -> None:
        settings = self._settings
        self._process, self._pipe = begin_driver(settings.engine, settings.count, *self._log)
        self._began_s = time.monotonic()

    def _release(self) -> None:
        """Let the driver start the shards."""
        with contextlib.suppress(OSError):  # it has ended, and `_watch` says so
            assert self._pipe is not None
            self._pipe.send(self._settings)

    def _ended(self, process: BaseProcess) -> None:
        """Join the cluster again after a while."""
        self._close()
        self._restarts, self._news = self.restarts, None
        settings = self._settings
        if time.monotonic() - self._began_s > SOUND_S:
            self._failures = 0
        wait_s = min(settings.backoff_s * 2.0**self._failures, settings.max_backoff_s)
        self._failures += 1
        logger.error(
            "The Ray cluster of --engine %s is lost: %s It is joined again in %.3g s, and the "
            "shards are started there; they continue from their database, and edges keep what "
            "they miss.",
            settings.engine, self._refusal or f"its driver ended with code {process.exitcode}.",
            wait_s,
        )  # fmt: skip
        self._refusal = ""
        if not self._stop.wait(wait_s):
            self._begin()
            self._release()
            self.rejoined += 1

    def _close(self) -> None:
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None
