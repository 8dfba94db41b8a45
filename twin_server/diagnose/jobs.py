"""Diagnoses one at a time, each in a process of its own, which may be ended at any moment.

A process hears that it is to stop, and that the server has died, by the end of its standard
input; it tells how far it has come by lines of JSON on its standard output.
"""

import collections
import contextlib
import json
import logging
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Literal, NamedTuple

from twin_server.identity.principals import site_of
from twin_server.settings import DiagnoseSettings

from .task import Outcome, read_outcome

logger = logging.getLogger(__name__)

GRACE_S = 2.0
"""For a process that was told to stop, until it is killed."""

_LONGEST = 2_000
"""Characters of an error that are kept."""

_EVERY_S = 0.05
"""Interval at which a running process is looked at [s]."""


class QueueFullError(RuntimeError):
    """The queue of diagnoses is full; the text says what to do."""


class Progress(NamedTuple):
    """Progress of a diagnosis.

    Parameters
    ----------
    stage
        In words.
    share
        Of the work [1].
    seconds
        Since it began; 0 while it waits.
    """

    state: Literal["queued", "running"]
    stage: str
    share: float
    seconds: float


class Ended(NamedTuple):
    """End of a diagnosis: an outcome where it is done, else a sentence."""

    state: Literal["done", "failed", "cancelled"]
    error: str = ""
    outcome: Outcome | None = None


class JobId(NamedTuple):
    """Which diagnosis it is: its twin, and its number among those of the twin."""

    twin: str
    number: int

    @property
    def site(self) -> str:
        """Site of the twin."""
        return site_of(self.twin)


class _Waiting(NamedTuple):
    id: JobId
    folder: Path


class Jobs:
    """A queue, and a thread that sees to one process after the other.

    Parameters
    ----------
    command
        Of the process; the folder is added.
    ended
        Told, by that thread, which diagnosis has ended, and how.
    """

    def __init__(
        self,
        command: Sequence[str],
        settings: DiagnoseSettings,
        ended: Callable[[JobId, Ended], None],
    ) -> None:
        self._command, self._settings, self._ended = tuple(command), settings, ended
        self._queue: collections.deque[_Waiting] = collections.deque()
        self._changed = threading.Condition()
        self._current: _Waiting | None = None
        self._cancelled: set[JobId] = set()
        self._stage, self._share, self._began_s = "", 0.0, 0.0
        self._stopping = False
        self._thread = threading.Thread(target=self._work, name="diagnose", daemon=True)

    def start(self) -> None:
        """Begin to work."""
        self._thread.start()

    def stop(self) -> None:
        """End the running jobs and drop the waiting ones; neither is reported as ended."""
        with self._changed:
            self._stopping = True
            left, self._queue = list(self._queue), collections.deque()
            self._changed.notify_all()
        for waiting in left:
            shutil.rmtree(waiting.folder, ignore_errors=True)
        if self._thread.is_alive():
            self._thread.join()

    def check_room(self) -> None:
        """Raise `QueueFullError` where one more may not wait."""
        with self._changed:
            waiting = len(self._queue)
        if waiting >= self._settings.max_queued:
            raise QueueFullError(
                f"Too many diagnoses wait already. Allowed: {self._settings.max_queued} "
                "(diagnose.max_queued). Wait for one to end, or cancel one."
            )

    def submit(self, job: JobId, folder: Path) -> None:
        """Enqueue the diagnosis of a folder, which is removed once that has ended."""
        with self._changed:
            self._queue.append(_Waiting(job, folder))
            self._changed.notify_all()

    def cancel(self, job: JobId) -> bool:
        """End a diagnosis, or take it out of the queue; False where it is in neither."""
        with self._changed:
            waiting = next((one for one in self._queue if one.id == job), None)
            if waiting is not None:
                self._queue.remove(waiting)
            elif self._current is not None and self._current.id == job:
                self._cancelled.add(job)
                return True
        if waiting is None:
            return False
        shutil.rmtree(waiting.folder, ignore_errors=True)
        self._ended(job, Ended("cancelled", "It was cancelled before it began."))
        return True

    def progress(self, job: JobId) -> Progress | None:
        """Return the progress of a diagnosis; None where it neither waits nor runs.

        Of those ahead of it, only those of its site are counted: who may see it need not know
        how much is asked at other sites.
        """
        with self._changed:
            if self._current is not None and self._current.id == job:
                return Progress(
                    "running", self._stage, self._share, time.monotonic() - self._began_s
                )
            before = [] if self._current is None else [self._current]
            for waiting in self._queue:
                if waiting.id == job:
                    ahead = sum(one.id.site == job.site for one in before)
                    stage = f"waiting, {ahead} of its site ahead of it"
                    return Progress("queued", stage, 0.0, 0.0)
                before.append(waiting)
        return None

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopping or self._queue)
                if self._stopping:
                    return
                self._current = waiting = self._queue.popleft()
                self._stage, self._share, self._began_s = "starting", 0.0, time.monotonic()
            try:
                ended = self._run(waiting)
            except Exception as error:  # the others in the queue have their turn
                logger.exception(
                    "Diagnosis %d of %s failed.", waiting.id.number, waiting.id.twin
                )
                text = (
                    f"It failed in the server ({type(error).__name__}), whose log says more. "
                    "Order it again."
                )
                ended = Ended("failed", text)
            shutil.rmtree(waiting.folder, ignore_errors=True)
            if ended is not None:
                try:
                    self._ended(waiting.id, ended)
                except Exception:
                    logger.exception(
                        "The outcome of diagnosis %d of %s could not be stored.",
                        *waiting.id[::-1],
                    )
            with self._changed:
                self._current = None
                self._cancelled.discard(waiting.id)

    def _run(self, waiting: _Waiting) -> Ended | None:
        """See one process through; None where the server ends before it."""
        log = waiting.folder / "log"
        try:
            with log.open("wb") as errors:
                process = subprocess.Popen(
                    [*self._command, str(waiting.folder)],
                    stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
                    start_new_session=True,
                )  # fmt: skip
        except OSError as error:
            return Ended("failed", f"It could not be started: {error.strerror}.")
        said: list[str] = []
        assert process.stdout is not None
        reader = threading.Thread(
            target=self._listen, args=(process.stdout, said), name="diagnose-out", daemon=True
        )
        reader.start()
        why = self._wait(process, waiting.id)
        reader.join(GRACE_S)
        process.stdout.close()
        if why == "stopping":
            return None
        if why == "cancelled":
            return Ended("cancelled", "It was cancelled.")
        if why == "late":
            return Ended(
                "failed",
                f"It took longer than {self._settings.max_s:g} s and was stopped. Give "
                "fewer or shorter samples, ask for a quick diagnosis, or raise "
                "diagnose.max_s.",
            )
        if process.returncode == 0:
            try:
                return Ended("done", outcome=read_outcome(waiting.folder))
            except (OSError, UnicodeDecodeError) as error:
                return Ended("failed", f"It ended without a report ({type(error).__name__}).")
        return Ended("failed", said[-1] if said else self._died(process.returncode, log))

    def _wait(self, process: subprocess.Popen[bytes], job: JobId) -> str:
        """Wait for the end of the process, or end it; return the reason."""
        while process.poll() is None:
            with self._changed:
                why = (
                    "stopping" if self._stopping
                    else "cancelled" if job in self._cancelled
                    else "late" if time.monotonic() - self._began_s > self._settings.max_s
                    else ""
                )  # fmt: skip
            if why:
                _end(process)
                return why
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_EVERY_S)
        assert process.stdin is not None
        process.stdin.close()
        return "ended"

    def _listen(self, lines: IO[bytes], said: list[str]) -> None:
        for line in lines:
            try:
                content = json.loads(line)
                if "error" in content:
                    said.append(str(content["error"])[:_LONGEST])
                else:
                    stage, share = str(content["stage"])[:200], float(content["share"])
                    with self._changed:
                        self._stage, self._share = stage, min(max(share, 0.0), 1.0)
            except (ValueError, KeyError, TypeError):
                logger.warning("A diagnosis process printed an invalid line: %r", line[:200])

    def _died(self, status: int, log: Path) -> str:
        with contextlib.suppress(OSError):
            text = log.read_text(encoding="utf-8", errors="replace")
            logger.error("A diagnosis ended with %d: %s", status, text[-_LONGEST:])
        return (
            f"Its process ended with status {status} and without a message, probably for "
            "lack of memory. Give fewer samples, or raise diagnose.max_memory_bytes. See "
            "the server's log for details."
        )


def _end(process: subprocess.Popen[bytes]) -> None:
    assert process.stdin is not None
    with contextlib.suppress(OSError):
        process.stdin.close()
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
