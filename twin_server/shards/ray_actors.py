"""Runs each shard as an actor of a Ray cluster, which starts it again where a node is lost."""

import contextlib
import logging
import os
import threading
import time
from typing import TYPE_CHECKING, Any

from slowtime_services.engines import import_ray
from slowtime_services.logs import Format

from .shard_actor import FleetSettings, ShardActor, ShardAddress
from .supervisor import SOUND_S

if TYPE_CHECKING:
    from twin_server.settings import TwinSettings

logger = logging.getLogger(__name__)

LOOK_S = 0.2
"""How long is waited for news of the actors, until it is looked whether the fleet ends [s]."""

PLACED_S = 60.0
"""After which the log says that a shard is not up [s]; a start takes a few seconds, with a
worker process of Ray on a busy node up to some tens."""

CLUSTER_S = 5.0
"""How often the cluster is asked whether it still knows this driver's node [s]; an answer takes
some milliseconds, and a new head in place of a lost one is seen after so long."""

NICENESS = ("RAY_worker_niceness", "0")
"""Variable by which a raylet is told the niceness of its workers, and its value here. Ray's
default is 15, with which a shard gets 1/28 of a core beside one busy process of niceness 0
(weights 36 and 1024 of Linux's scheduler), and does not come up."""

CORES = 1.0
"""What a shard reserves until its settings are there: the default of `shards.cores`."""

THREADS = 4
"""Calls that an actor answers at once: where it answers, its end, and that it shall end."""


class EngineError(ValueError):
    """An engine that cannot run the shards; the text says what to do."""


def check_engine(settings: "TwinSettings") -> None:
    """Refuse an engine that is not installed, or a database that other nodes cannot open.

    Raises
    ------
    EngineError
        Which says what to do.
    """
    from twin_server.persist import is_url

    engine = settings.shards.engine
    if engine == "local":
        return
    try:
        import_ray()
    except ModuleNotFoundError as error:
        raise EngineError(f"--engine {engine} was given. {error}") from error
    if engine != "ray" and not is_url(settings.database):
        raise EngineError(
            f"--engine {engine} and --database {settings.database} were given. A file is of "
            "one node, and a shard that Ray starts on another node would find no history. "
            "Allowed: a PostgreSQL that all nodes reach (--database postgresql://...), or "
            "--engine ray, which uses this machine only."
        )


class _Shard:
    """One actor, what it was asked, and when it may be started again."""

    def __init__(self, index: int) -> None:
        self.index = index
        self.actor: Any = None
        self.placing: Any = None
        self.ending: Any = None
        self.place: ShardAddress | None = None
        self.failures = 0
        self.began_s = 0.0
        self.again_s: float | None = None
        self.told_late = False


class RayShards:
    """Actors of a Ray cluster, one for each shard.

    Ray starts an actor again whose process or node is lost; this watches where each answers,
    and starts those again that ended by themselves, with a back-off.

    Parameters
    ----------
    engine
        Names the cluster.
    count
        How many shards there will probably be.
    stop
        Set where the fleet ends; also from here, where the cluster is lost: `lost` says why.
    level, form
        Least level of the shards' log, and how it is written.
    """

    def __init__(
        self,
        engine: str,
        count: int,
        stop: threading.Event,
        *,
        level: int = logging.INFO,
        form: Format = "text",
    ) -> None:
        self._engine, self._count, self._log, self._stop = engine, count, (level, form), stop
        self._ahead: list[Any] = []
        self._settings: FleetSettings  # once they are wanted
        self._shards: list[_Shard] = []
        self._ray = import_ray()
        self._connected, self._wanted = threading.Event(), threading.Event()
        self._error = ""
        # All calls of Ray are made in this thread: in the main thread it takes the signals.
        self._thread = threading.Thread(target=self._run, name="shards", daemon=True)
        self.restarts, self.lost = 0, ""

    @property
    def count(self) -> int:
        """Number of shards."""
        return len(self._shards)

    def url(self, index: int) -> str | None:
        """Where a shard answers; None while it does not."""
        place = self._shards[index].place
        return None if place is None else place.url

    def place(self, index: int) -> ShardAddress | None:
        """Where a shard answers, with its process and its node; None while it does not."""
        return self._shards[index].place

    def join(self) -> None:
        """Join the cluster, and load the code of shards there until `start`.

        Raises
        ------
        EngineError
            If the cluster cannot be joined.
        """
        self._thread.start()
        self._connected.wait()
        if self._error:
            raise EngineError(self._error)

    def start(self, settings: FleetSettings) -> None:
        """Start all shards, and keep them running."""
        self._settings = settings
        self._wanted.set()

    def stop(self) -> None:
        """End all shards: those that do not end in good time are killed."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        try:
            self._join()
        except Exception as error:
            self._error = (
                f"--engine {self._engine} was given, and the Ray cluster "
                f"cannot be joined: {error}. Start it (ray start --head), or correct the "
                "address."
            )
            return
        finally:
            self._connected.set()
        try:
            if self._are_wanted():
                self._shards = [_Shard(index) for index in range(self._settings.count)]
                self._watch()
                self._end()
        except Exception as error:
            self.lost = f"{type(error).__name__}: {error}."
            self._stop.set()
            return  # without `shutdown`, which would wait for the cluster
        finally:
            for shard in self._shards:
                shard.place = None
        with contextlib.suppress(Exception):
            self._ray.shutdown()

    def _join(self) -> None:
        address = {"ray": "local", "ray:auto": "auto"}.get(self._engine, self._engine)
        if address == "local":
            os.environ.setdefault(*NICENESS)
        more = {"include_dashboard": False} if address == "local" else {}
        self._ray.init(address=address, logging_level="error", **more)

    def _are_wanted(self) -> bool:
        """Wait until shards are wanted; False where the fleet ends before.

        Actors of a cluster of this machine load their code meanwhile.
        """
        if self._engine == "ray":
            self._ahead = [self._actor(CORES) for _ in range(self._count)]
        while not self._wanted.wait(LOOK_S):
            if self._stop.is_set():
                return False
        if self._settings.cores != CORES:
            for actor in self._ahead:
                self._ray.kill(actor)
            self._ahead = []
        return True

    def _actor(self, cores: float) -> Any:
        made = self._ray.remote(
            num_cpus=cores,
            max_restarts=-1,
            max_concurrency=THREADS,
            scheduling_strategy="SPREAD",
        )(ShardActor)
        return made.remote(*self._log)

    def _begin(self, shard: _Shard) -> None:
        ahead = self._ahead
        shard.actor = ahead.pop(0) if ahead else self._actor(self._settings.cores)
        self._started(shard)

    def _started(self, shard: _Shard) -> None:
        shard.began_s, shard.told_late = time.monotonic(), False
        self._ask(shard)

    def _ask(self, shard: _Shard) -> None:
        """Ask where a shard is, once it is started."""
        asked = shard.actor.place.remote(self._settings.packed, shard.index)
        shard.placing, shard.ending = asked, None

    def _watch(self) -> None:
        for shard in self._shards:
            self._begin(shard)
        node = self._ray.get_runtime_context().get_node_id()
        next_s = time.monotonic()
        while not self._stop.is_set():
            if time.monotonic() >= next_s:
                self._check_known(node)
                next_s = time.monotonic() + CLUSTER_S
            asked = {
                one: shard
                for shard in self._shards
                for one in (shard.placing, shard.ending)
                if one is not None
            }
            if asked:
                heard, _ = self._ray.wait(list(asked), num_returns=1, timeout=LOOK_S)
                for one in heard:
                    self._hear(asked[one], one)
            else:
                self._stop.wait(LOOK_S)
            for shard in self._shards:
                self._look(shard)

    def _check_known(self, node: str) -> None:
        """Check that the cluster is the one that was joined; another head knows no such node.

        A cluster that does not answer may be reached again; `wait` fails where Ray gives up.

        Raises
        ------
        ConnectionError
            If it is another one. Ray 2.60 ends the process instead.
        """
        try:
            nodes = self._ray.nodes()
        except Exception:
            return
        if not any(one["NodeID"] == node and one["Alive"] for one in nodes):
            raise ConnectionError("the cluster does not know the node of this driver any more")

    def _hear(self, shard: _Shard, told: Any) -> None:
        """Take what an actor tells: where it answers, or that it has ended.

        `told` equals what was waited for, and is another object by a cluster's client port.
        """
        try:
            answer = self._ray.get(told)
        except self._ray.exceptions.RayError as error:
            if told == shard.ending:
                self._lost(shard, type(error).__name__)
            elif isinstance(error, self._ray.exceptions.ActorUnavailableError):
                self._ask(shard)  # while Ray starts it; it has waited some seconds
            else:
                self._ray.kill(shard.actor)
                shard.actor = None
                self._failed(shard, type(error).__name__)
            return
        if told == shard.placing:
            place = ShardAddress(*answer)
            shard.placing, shard.place = None, place if place.url else None
            shard.ending = shard.actor.ended.remote(place.url)
        elif answer is None:
            self._lost(shard, "restarted")
        else:
            self._failed(shard, answer)

    def _lost(self, shard: _Shard, reason: str) -> None:
        """Wait for the actor that Ray starts instead."""
        shard.place = None
        self.restarts += 1
        logger.error(
            "Shard %d of %d is lost with its process or its node (%s). Ray starts it again; "
            "edges keep what it misses.",
            shard.index, self.count, reason,
        )  # fmt: skip
        self._started(shard)

    def _failed(self, shard: _Shard, code: int | str) -> None:
        """Start a shard again that has ended by itself, after a while."""
        shard.place = shard.placing = shard.ending = None
        settings = self._settings
        if time.monotonic() - shard.began_s > SOUND_S:
            shard.failures = 0
        wait_s = min(settings.backoff_s * 2.0**shard.failures, settings.max_backoff_s)
        shard.failures += 1
        shard.again_s = time.monotonic() + wait_s
        self.restarts += 1
        logger.error(
            "Shard %d of %d has ended with code %s. It is started again in %.3g s; edges keep "
            "what it misses. The lines before this one say why it ended.",
            shard.index, self.count, code, wait_s,
        )  # fmt: skip

    def _look(self, shard: _Shard) -> None:
        """Start a shard again whose wait is over; say of one that it is not up yet."""
        now_s = time.monotonic()
        if shard.again_s is not None and now_s >= shard.again_s:
            shard.again_s = None
            if shard.actor is None:
                self._begin(shard)
            else:
                self._ray.kill(shard.actor, no_restart=False)
                self._started(shard)
        late = shard.placing is not None and now_s - shard.began_s > PLACED_S
        if late and not shard.told_late:
            shard.told_late = True
            logger.warning(
                "Shard %d of %d is not up after %.0f s. Each needs a node with %g free cores: "
                "add nodes, or lower shards.cores.",
                shard.index, self.count, PLACED_S, self._settings.cores,
            )  # fmt: skip

    def _end(self) -> None:
        """Let all shards end, and kill those that do not."""
        for shard in self._shards:
            shard.place = None
            if shard.ending is not None:
                shard.actor.stop.remote()
        ending = [shard.ending for shard in self._shards if shard.ending is not None]
        if ending:
            limit_s = self._settings.shutdown_s + 10.0
            self._ray.wait(ending, num_returns=len(ending), timeout=limit_s)
        for shard in self._shards:
            if shard.actor is not None:
                self._ray.kill(shard.actor)
