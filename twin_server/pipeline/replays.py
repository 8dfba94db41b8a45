"""One replay of a recording by the server: paused in favour of other sites, and bounded."""

import dataclasses
import logging
import math
import threading
import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

from slowtime_schemas.streams import Stream
from slowtime_services.bus import Bus
from slowtime_services.clock import SystemClock
from slowtime_services.replay import Contents, Played, ReplayProgress, replay
from twin_server.fairness import Processors, QuotaHolding, Turn
from twin_server.serve import ProblemError
from twin_server.settings import RecordingSettings

logger = logging.getLogger(__name__)

LOOK_S = 0.1
"""Interval at which a paused replay looks whether it is to stop [s]."""


def check_duration(inside: Contents, speed: float | None, settings: RecordingSettings) -> None:
    """Refuse a speed at which a replay would take too long."""
    if speed is None:
        return
    recorded_s = max(inside.end_ns - inside.start_ns, 0) / 1e9
    if recorded_s / speed > settings.max_replay_s:
        slowest = recorded_s / settings.max_replay_s
        raise ProblemError(
            422,
            "too-slow",
            f"At speed {speed:g}, {recorded_s:,.0f} s of recording take "
            f"{recorded_s / speed:,.0f} s. Allowed: {settings.max_replay_s:,.0f} s "
            f"(recordings.max_replay_s), which is speed {slowest:.3g} or more.",
        )


class _PacedClock(SystemClock):
    """The machine's clock, whose sleep costs nobody a processor, and has an end."""

    def __init__(self, turn: Turn, stop: threading.Event, longest_s: float) -> None:
        self._turn, self._stop = turn, stop
        self._until_s = time.monotonic() + longest_s
        self.late = False

    def sleep(self, seconds: float) -> None:
        """Wait, unless it is to stop."""
        if time.monotonic() > self._until_s:
            self.late = True
            self._stop.set()
        self._turn.idle = True
        self._stop.wait(seconds)
        self._turn.idle = False


@dataclasses.dataclass(slots=True)
class Replay:
    """A replay under way, or the outcome of one.

    Parameters
    ----------
    holding
        Its slot, which is given back at its end.
    """

    holding: QuotaHolding
    longest_s: float
    stop: threading.Event = dataclasses.field(default_factory=threading.Event)
    thread: threading.Thread | None = None
    state: str = "playing"
    done: int = 0
    total: int = 0
    sentence: str = "It begins."

    def document(self) -> dict[str, Any]:
        """Describe it as REST does."""
        return {key: getattr(self, key) for key in ("state", "done", "total", "sentence")}

    def run(
        self,
        path: Path,
        bus: Bus,
        speed: float | None,
        streams: Collection[Stream],
        processors: Processors,
    ) -> None:
        """Play the recording to its end."""
        try:
            played, late = self._play(path, bus, speed, streams, processors)
        except Exception as error:  # whatever it is, the server goes on, and says so
            logger.warning("%s could not be replayed: %s", path.name, error)
            self.state, self.sentence = "failed", str(error).replace(str(path), path.name)
        else:
            kept = f"{played.acknowledged:,} of {played.features:,} features are in the twins."
            why = "Stopped. " if played.stopped else ""
            if late:
                why = f"Stopped after {self.longest_s:,.0f} s (recordings.max_replay_s). "
            self.sentence = f"{why}{kept}"
            self.state = "stopped" if played.stopped else "done"
        finally:
            self.holding.release()

    def _play(
        self,
        path: Path,
        bus: Bus,
        speed: float | None,
        streams: Collection[Stream],
        processors: Processors,
    ) -> tuple[Played, bool]:
        goes_on = threading.Event()
        goes_on.set()

        def wait() -> None:
            while not goes_on.wait(LOOK_S) and not self.stop.is_set():
                pass

        def tell(progress: ReplayProgress) -> None:
            self.done, self.total = progress.done, progress.total
            self.sentence = f"{self.done:,} of {self.total:,} messages."
            wait()

        with processors.turn(
            self.holding.holder, goes_on.clear, goes_on.set, here=True
        ) as turn:
            wait()
            clock = _PacedClock(turn, self.stop, self.longest_s)
            played = replay(
                path, bus, speed=speed or math.inf, streams=streams, stop=self.stop,
                progress=tell, clock=clock,
            )  # fmt: skip
        return played, clock.late
