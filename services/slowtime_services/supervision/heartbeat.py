"""Signs of life of this process, to a watcher of its own and to systemd.

The watcher is a process (`watcher.py`), because nothing within a process can end it while one
call holds the interpreter's lock. The decision on progress and budgets of work says how it was
chosen.
"""

import contextlib
import dataclasses
import faulthandler
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from .systemd import notify, watchdog_s
from .watcher import LEAVING, TICK_S

logger = logging.getLogger(__name__)

BEAT_S = TICK_S / 2
"""Interval of the signs of life [s]; twice in the time that the watcher waits for one."""

EXTENDED_S = 30
"""What systemd is asked for, again and again, until the process is ready [s]."""

_ALIVE = b"."

_pipes: set[int] = set()
"""Pipes to watchers of this process."""


def _after_fork() -> None:
    """Keep a forked process from speaking for its parent, by signals that it receives."""
    if _pipes:
        signal.set_wakeup_fd(-1)
        while _pipes:
            os.close(_pipes.pop())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class WatchReport:
    """What the watcher of a process is told.

    Parameters
    ----------
    silent_s
        How long the process may give no sign of life [s].
    grace_s
        How long it may take to end after SIGINT or SIGTERM [s].
    marked
        File whose first byte is written over where it gave none; None for no file.
    """

    silent_s: float
    grace_s: float
    marked: Path | None = None


class Heartbeat:
    """Gives signs of life from a thread, which also looks after the work.

    Parameters
    ----------
    watch
        Limits of the watcher; None for a process that is not ours to end, such as one of tests.
    look
        Called with each sign of life; says whether the work goes on. Systemd gets none else.
    """

    def __init__(
        self, watch: WatchReport | None, look: Callable[[], bool] = lambda: True
    ) -> None:
        self.look = look
        self._watch = watch if os.name == "posix" else None
        self._watcher: subprocess.Popen[bytes] | None = None
        self._pipe = -1
        self._former_fd: int | None = None
        self._ended, self._ready = threading.Event(), False
        self._awaited = watchdog_s() is not None
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)

    def __enter__(self) -> Self:
        """Start the watcher, and the thread."""
        if self._watch is not None:
            # Its handler of SIGABRT, which the watcher sends, writes all stacks without a lock.
            with contextlib.suppress(OSError, ValueError, AttributeError):
                faulthandler.enable(sys.stderr, all_threads=True)
            self._begin(self._watch)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Let the watcher go."""
        self._ended.set()
        self._thread.join()
        self._close()

    @property
    def watches(self) -> bool:
        """Whether this process is ours to end."""
        return self._watch is not None

    def ready(self) -> None:
        """Tell systemd that the process has started."""
        self._ready = True
        notify("READY=1", "STATUS=Running.")

    def leaving(self) -> None:
        """Say that the process has begun to end, so that it ends in good time."""
        notify("STOPPING=1", "STATUS=Ending.")
        self._write(bytes([LEAVING]))

    def _begin(self, watch: WatchReport) -> None:
        theirs, self._pipe = os.pipe()
        os.set_blocking(self._pipe, False)
        _pipes.add(self._pipe)
        command = [
            sys.executable, "-I", "-S", str(Path(__file__).with_name("watcher.py")),
            str(os.getpid()), str(watch.silent_s), str(watch.grace_s),
            "" if watch.marked is None else str(watch.marked),
        ]  # fmt: skip
        try:
            self._watcher = subprocess.Popen(command, stdin=theirs, stdout=subprocess.DEVNULL)
        except OSError as error:
            logger.warning("No watcher could be started (%s): a call that never returns ends "
                           "nothing.", error)  # fmt: skip
        finally:
            os.close(theirs)
        if threading.current_thread() is threading.main_thread():
            former = signal.set_wakeup_fd(self._pipe, warn_on_full_buffer=False)
            self._former_fd = former if self._former_fd is None else self._former_fd

    def _close(self) -> None:
        if self._former_fd is not None:
            with contextlib.suppress(ValueError):  # the main thread has gone elsewhere
                signal.set_wakeup_fd(self._former_fd)
            self._former_fd = None
        self._close_pipe()
        if self._watcher is not None:
            self._watcher.wait()
            self._watcher = None

    def _beat(self) -> None:
        while not self._ended.wait(BEAT_S):
            try:
                goes_on = self.look()
            except Exception:
                logger.exception("The work could not be looked after.")
                goes_on = True
            self._write(_ALIVE)
            if not self._ready:
                notify(f"EXTEND_TIMEOUT_USEC={EXTENDED_S * 1_000_000}")
            elif self._awaited and goes_on:
                notify("WATCHDOG=1")

    def _write(self, sign: bytes) -> None:
        if self._pipe < 0:
            return
        with contextlib.suppress(BlockingIOError):
            try:
                os.write(self._pipe, sign)
            except BrokenPipeError:
                self._lost()

    def _lost(self) -> None:
        """Say once that the watcher has ended; the process goes on without one."""
        logger.warning(
            "The watcher of this process has ended: a call that never returns ends nothing."
        )
        self._close_pipe()

    def _close_pipe(self) -> None:
        if self._pipe >= 0:
            _pipes.discard(self._pipe)
            os.close(self._pipe)
            self._pipe = -1
