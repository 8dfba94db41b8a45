"""Starts the processes of all shards, and starts one again after it has ended."""

import contextlib
import logging
import multiprocessing
import multiprocessing.forkserver
import threading
import time
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any, Protocol

from slowtime_services.logs import Format

from .process import serve_shard, settings_of

if TYPE_CHECKING:
    from twin_server.settings import TwinSettings

logger = logging.getLogger(__name__)

LOOK_S = 0.05
"""How often processes are looked at [s]; far below the time that a shard takes to start."""

SOUND_S = 30.0
"""Time after which a shard that runs is taken as sound, and its back-off begins anew [s].

Several times what a start with a large history takes to fail.
"""


LOADED = "twin_server.shards.loaded"
"""Module that the process has loaded from which shards are forked."""


def loaded_context() -> Any:
    """Return a context that forks shards from a process that has loaded all their code.

    Loading it takes three to four seconds of processor time, which a shard that is started
    again on busy cores would otherwise wait for. That process has no threads, so it can fork.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():  # pragma: no cover
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([LOADED])
    return context


def load_ahead() -> None:
    """Begin to load the code of the shards, while this process goes on to load its own."""
    if loaded_context().get_start_method() == "forkserver":
        multiprocessing.forkserver.ensure_running()


class Shards(Protocol):
    """Where the shards answer, whoever runs them."""

    @property
    def count(self) -> int:
        """Number of shards."""
        ...

    def url(self, index: int) -> str | None:
        """Where a shard answers; None while it does not."""
        ...


class _ShardProcess:
    """One process, and when it may be started again."""

    def __init__(self, index: int) -> None:
        self.index = index
        self.process: BaseProcess | None = None
        self.pipe: Connection | None = None
        self.url: str | None = None
        self.failures = 0
        self.began_s = self.next_s = 0.0


class Supervisor:
    """Processes of this machine, one for each shard.

    Parameters
    ----------
    settings
        Of the whole fleet.
    stop
        Set where the fleet ends, so that no shard is started again.
    level, form
        Least level of the shards' log, and how it is written.
    """

    def __init__(
        self,
        settings: "TwinSettings",
        stop: threading.Event,
        *,
        level: int = logging.INFO,
        form: Format = "text",
    ) -> None:
        self._settings, self._log = settings, (level, form)
        self._context = loaded_context()
        self._shards = [_ShardProcess(index) for index in range(settings.shards.count)]
        self._stop = stop
        self._thread = threading.Thread(target=self._watch, name="shards", daemon=True)
        self.restarts = 0

    @property
    def count(self) -> int:
        """Number of shards."""
        return len(self._shards)

    def url(self, index: int) -> str | None:
        """Where a shard answers; None while it does not."""
        return self._shards[index].url

    def pid(self, index: int) -> int | None:
        """Process of a shard; None while there is none."""
        process = self._shards[index].process
        return None if process is None else process.pid

    def prepare(self) -> None:
        """Begin what takes long and needs no shard, so that it is done while others load."""
        load_ahead()

    def start(self) -> None:
        """Start all shards, and keep them running."""
        self._thread.start()

    def stop(self) -> None:
        """End all shards: those that do not end in good time are killed."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        for shard in self._shards:
            self._close(shard)
        until = time.monotonic() + self._settings.shutdown_s + 10.0
        for shard in self._shards:
            if shard.process is not None:
                shard.process.join(max(0.0, until - time.monotonic()))
                if shard.process.is_alive():
                    shard.process.kill()
                    shard.process.join()

    def _watch(self) -> None:
        while not self._stop.wait(LOOK_S):
            for shard in self._shards:
                if shard.process is None:
                    if time.monotonic() >= shard.next_s:
                        self._begin(shard)
                elif not shard.process.is_alive() and not self._stop.is_set():
                    self._ended(shard, shard.process)
                elif shard.url is None and shard.pipe is not None and shard.pipe.poll():
                    with contextlib.suppress(EOFError, OSError):
                        shard.url = shard.pipe.recv()

    def _begin(self, shard: _ShardProcess) -> None:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=serve_shard,
            args=(settings_of(self._settings, shard.index), theirs, *self._log),
            name=f"shard {shard.index} of {self.count}",
        )
        process.start()
        theirs.close()
        shard.process, shard.pipe, shard.began_s = process, ours, time.monotonic()

    def _ended(self, shard: _ShardProcess, process: BaseProcess) -> None:
        self._close(shard)
        shard.process = None
        shards = self._settings.shards
        if time.monotonic() - shard.began_s > SOUND_S:
            shard.failures = 0
        wait_s = min(shards.backoff_s * 2.0**shard.failures, shards.max_backoff_s)
        shard.failures += 1
        shard.next_s = time.monotonic() + wait_s
        self.restarts += 1
        logger.error(
            "Shard %d of %d has ended with code %s. It is started again in %.3g s; edges keep "
            "what it misses. The lines before this one say why it ended.",
            shard.index, self.count, process.exitcode, wait_s,
        )  # fmt: skip

    @staticmethod
    def _close(shard: _ShardProcess) -> None:
        shard.url = None
        if shard.pipe is not None:
            shard.pipe.close()
            shard.pipe = None
