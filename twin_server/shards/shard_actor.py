"""One shard as an actor of Ray, and what it and its driver tell each other."""

import dataclasses
import importlib
import logging
import os
import pickle
import threading
import time
from typing import TYPE_CHECKING, NamedTuple

from slowtime_services.engines import import_ray
from slowtime_services.logs import Format, formatter

from .process import settings_of
from .supervisor import LOADED

if TYPE_CHECKING:
    from twin_server.settings import TwinSettings

logger = logging.getLogger(__name__)

PARENT_S = 1.0
"""How often an actor looks whether its node's raylet lives [s]; the next actor of its shard is
refused by the lock of the database for so long."""


@dataclasses.dataclass(frozen=True, slots=True)
class FleetSettings:
    """What a driver needs of the settings of a fleet; their class takes seconds to load.

    Parameters
    ----------
    engine, cores, backoff_s, max_backoff_s, shutdown_s
        As in the settings.
    count
        Of the shards.
    packed
        All settings, pickled, for the actors.
    """

    engine: str
    count: int
    cores: float
    backoff_s: float
    max_backoff_s: float
    shutdown_s: float
    packed: bytes

    @classmethod
    def of(cls, settings: "TwinSettings") -> "FleetSettings":
        """Return what a driver needs of settings."""
        shards = settings.shards
        return cls(
            shards.engine, shards.count, shards.cores, shards.backoff_s, shards.max_backoff_s,
            settings.shutdown_s, pickle.dumps(settings),
        )  # fmt: skip


class ShardAddress(NamedTuple):
    """Where a shard answers.

    Parameters
    ----------
    url
        Empty where the shard ended before it answered.
    pid
        Process of the actor, on its node.
    node
        Ray's name of the node.
    """

    url: str
    pid: int
    node: str


class ShardActor:
    """One shard: a twin server of its assets, in a thread of the process of an actor.

    Parameters
    ----------
    level, form
        Least level of the log, and how it is written.

    Notes
    -----
    It loads the code of the server when it is made, and serves when it is asked where.
    """

    def __init__(self, level: int, form: Format) -> None:
        handler = logging.StreamHandler()
        handler.setFormatter(formatter(form))
        logging.basicConfig(level=level, handlers=[handler], force=True)
        self._node = str(import_ray().get_runtime_context().get_node_id())
        self._stop, self._told = threading.Event(), threading.Event()
        self._url, self._code = "", 0
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()
        threading.Thread(
            target=self._until_orphaned, args=(os.getppid(),), name="raylet", daemon=True
        ).start()
        importlib.import_module(LOADED)

    def place(self, packed: bytes, index: int) -> tuple[str, int, str]:
        """Serve a shard of a fleet with these settings; wait until it answers, return where."""
        with self._lock:
            if self._thread is None:
                own = self._own(pickle.loads(packed), index)
                self._thread = threading.Thread(target=self._run, args=(own,), name="shard")
                self._thread.start()
        self._told.wait()
        return ShardAddress(self._url, os.getpid(), self._node)

    def ended(self, url: str) -> int | None:
        """Wait until the shard has ended, and return its code; None if it is not at `url`."""
        if url != self._url:
            return None  # started again since it was asked where it is
        assert self._thread is not None
        self._thread.join()
        return self._code

    def stop(self) -> None:
        """Let the shard end."""
        self._stop.set()

    def _own(self, settings: "TwinSettings", index: int) -> "TwinSettings":
        own = settings_of(settings, index)
        if settings.shards.engine == "ray":
            return own
        return _reachable(own, import_ray().util.get_node_ip_address())

    def _run(self, own: "TwinSettings") -> None:
        from twin_server.__main__ import run

        try:
            self._code = run(own, stop=self._stop, ready=self._answers, owned=True)
        except Exception:
            logger.exception("The shard has failed.")
            self._code = 1
        self._told.set()

    def _until_orphaned(self, parent: int) -> None:
        """End the shard once the raylet that started this process has ended.

        An actor whose cluster got a new head outlives its raylet, and would keep the lock of
        the database from the actor that the new head starts.
        """
        while os.getppid() == parent:
            time.sleep(PARENT_S)
        logger.error("The raylet of this shard has ended, and the shard ends.")
        self.stop()
        if self._thread is not None:
            self._thread.join()
        os._exit(1)

    def _answers(self, url: str) -> None:
        self._url = url
        self._told.set()


def _reachable(own: "TwinSettings", address: str) -> "TwinSettings":
    """Return settings of a shard that listens for a front on another node."""
    access = own.access.model_copy(update={"hosts": (*own.access.hosts, address)})
    return own.model_copy(update={"host": address, "access": access})
