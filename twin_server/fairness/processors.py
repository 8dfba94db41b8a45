"""Time of the processors, shared among the sites whose work would take all of it.

Work of one site alone is left to the operating system. As soon as several sites have work, and
more of it than there are processors, some of it is paused: each site has one piece of work
under way before any has two, and those that have used least lately go first. So whoever asks
now and then is served as if nobody else were there, and those that never stop take turns.
"""

import contextlib
import dataclasses
import logging
import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator

from .holders import Holder
from .usage import DecayedUsage

logger = logging.getLogger(__name__)

TICK_S = 0.05
"""Interval at which it is decided anew who works [s]: far below the seconds that work takes."""

QUANTUM_S = 0.5
"""How much less a site must have used to take the place of another one [s], so that equal ones
change places twice a second and not at each tick."""

HERE_AT_ONCE = 1
"""Work in this process at once where several sites have some: one thread computes at a time."""


@dataclasses.dataclass(eq=False, slots=True)
class Turn:
    """A piece of work under way.

    Parameters
    ----------
    pause, resume
        Stop the work for a while, and let it go on.
    here
        Whether it is a thread of this process.
    """

    holder: Holder
    pause: Callable[[], object]
    resume: Callable[[], object]
    here: bool = False
    idle: bool = False
    paused: bool = False
    began_s: float = dataclasses.field(default_factory=time.monotonic)
    _paused_s: float = 0.0
    _since_s: float = 0.0

    def running_s(self) -> float:
        """Return how long it has been under way without its pauses [s]."""
        now = time.monotonic()
        paused_s = self._paused_s + (now - self._since_s if self.paused else 0.0)
        return now - self.began_s - paused_s

    def switch(self, paused: bool) -> None:
        """Pause it, or let it go on."""
        if paused == self.paused:
            return
        now = time.monotonic()
        if paused:
            self._since_s = now
        else:
            self._paused_s += now - self._since_s
        self.paused = paused
        try:
            (self.pause if paused else self.resume)()
        except Exception:  # it ends by itself then, and so does its turn
            logger.exception("Work of a site could not be paused or resumed.")


class Processors:
    """Decides whose work goes on.

    Parameters
    ----------
    count
        Processors; by default those that this process may use.
    usage
        What each site has used.
    """

    def __init__(self, count: int | None = None, usage: DecayedUsage | None = None) -> None:
        self.count = count or usable_processors()
        self.usage = usage or DecayedUsage()
        self._changed = threading.Condition()
        self._turns: list[Turn] = []
        self._thread: threading.Thread | None = None
        self._told_s = time.monotonic()

    @contextlib.contextmanager
    def turn(
        self,
        holder: Holder,
        pause: Callable[[], object],
        resume: Callable[[], object],
        *,
        here: bool = False,
    ) -> Iterator[Turn]:
        """Have work under way; it is resumed for good at the end."""
        one = Turn(holder, pause, resume, here)
        with self._changed:
            self._turns.append(one)
            self._decide()
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="fair", daemon=True)
                self._thread.start()
            self._changed.notify_all()
        try:
            yield one
        finally:
            with self._changed:
                self._turns.remove(one)
                one.switch(False)
                self._decide()

    def paused(self) -> Counter[str]:
        """Return the number of paused pieces of work of each site."""
        with self._changed:
            return Counter(one.holder.site for one in self._turns if one.paused)

    def _work(self) -> None:
        while True:
            with self._changed:
                if not self._turns:
                    # None is left behind by a server that has ended.
                    self._thread = None
                    return
                self._charge()
                self._decide()
            time.sleep(TICK_S)

    def _charge(self) -> None:
        now = time.monotonic()
        # What lay in between without work, or a suspended machine, is nobody's.
        took, self._told_s = min(now - self._told_s, 2 * TICK_S), now
        for one in self._turns:
            if not (one.paused or one.idle):
                self.usage.add(one.holder, took)

    def _decide(self) -> None:
        chosen = chosen_of(self._turns, self.count, self.usage)
        for one in sorted(self._turns, key=lambda one: one in chosen):
            one.switch(one not in chosen)


def chosen_of(turns: list[Turn], count: int, usage: DecayedUsage) -> list[Turn]:
    """Choose the work that goes on.

    Parameters
    ----------
    turns
        All that is under way, in the order in which it began.
    count
        Processors.
    """
    busy = [one for one in turns if not one.idle]
    if len({one.holder.site for one in busy}) <= 1:
        return list(turns)

    def rank(one: Turn) -> tuple[float, float]:
        site, token = usage.rank(one.holder)
        stays = 0.0 if one.paused else QUANTUM_S
        return site - stays, token - stays

    number = Counter[str]()
    ordered: list[tuple[int, int, Turn]] = []
    for place, one in enumerate(sorted(busy, key=rank)):
        ordered.append((number[one.holder.site], place, one))
        number[one.holder.site] += 1
    chosen = [one for one in turns if one.idle]
    left, here = count, HERE_AT_ONCE
    for _, _, one in sorted(ordered, key=lambda each: each[:2]):
        if left and (here or not one.here):
            chosen.append(one)
            left -= 1
            here -= one.here
    return chosen


def usable_processors() -> int:
    """Return the number of processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1
