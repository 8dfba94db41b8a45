"""Diagnoses, one of each site at a time, each in a process that may be ended at any moment.

Which site's is next, and whose goes on where there are more than processors, is decided by who
has used least lately (`twin_server.fairness`). A process hears that it is to stop, and that the
server has died, by the end of its standard input; it tells how far it has come by lines of JSON
on its standard output.
"""

import contextlib
import dataclasses
import json
import logging
import shutil
import subprocess
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Literal, NamedTuple

from slowtime_services.operating_system import pause_process, resume_process
from twin_server.fairness import (
    Holder,
    Processors,
    Quota,
    QuotaHolding,
    Turn,
    current_holder,
)
from twin_server.identity.principals import site_of
from twin_server.settings import DiagnoseSettings

from .task import TaskOutcome, read_outcome

logger = logging.getLogger(__name__)

GRACE_S = 2.0
"""For a process that was told to stop, until it is killed."""

_LONGEST = 2_000
"""Characters of an error that are kept."""

_EVERY_S = 0.05
"""Interval at which a running process is looked at [s]."""


class DiagnosisProgress(NamedTuple):
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
    outcome: TaskOutcome | None = None


class JobId(NamedTuple):
    """Which diagnosis it is: its twin, and its number among those of the twin."""

    twin: str
    number: int

    @property
    def site(self) -> str:
        """Site of the twin."""
        return site_of(self.twin)


@dataclasses.dataclass(eq=False, slots=True)
class _Job:
    """A diagnosis that waits or runs."""

    id: JobId
    folder: Path
    holding: QuotaHolding
    cancelled: bool = False
    stage: str = "starting"
    share: float = 0.0
    turn: Turn | None = None

    @property
    def holder(self) -> Holder:
        return self.holding.holder


class Jobs:
    """A queue, and a thread that sees to one process after the other, for each site.

    Parameters
    ----------
    command
        Of the process; the folder is added.
    ended
        Told, by such a thread, which diagnosis has ended, and how.
    processors
        Pause processes in favour of other sites.
    """

    def __init__(
        self,
        command: Sequence[str],
        settings: DiagnoseSettings,
        ended: Callable[[JobId, Ended], None],
        processors: Processors | None = None,
    ) -> None:
        self._command, self._settings, self._ended = tuple(command), settings, ended
        self._processors = processors or Processors()
        self.quota = Quota(
            "diagnoses",
            settings.max_queued_of_all + settings.max_running,
            of_site=settings.max_queued + 1,
            setting="diagnose.max_queued, beside one that runs",
        )
        self._queue: list[_Job] = []
        self._running: list[_Job] = []
        self._changed = threading.Condition()
        self._started = self._stopping = False

    def start(self) -> None:
        """Begin to work."""
        with self._changed:
            self._started = True
            self._begin_next()

    def stop(self) -> None:
        """End the running jobs and drop the waiting ones; neither is reported as ended."""
        with self._changed:
            self._stopping = True
            left, self._queue = self._queue, []
            self._changed.wait_for(lambda: not self._running)
        for job in left:
            self._forget(job)

    def reserve(self, what: str) -> QuotaHolding:
        """Take the place of a diagnosis that is being prepared.

        Raises
        ------
        OverQuotaError
            Where one more may not wait for the caller.
        """
        return self.quota.take(current_holder(), what)

    def submit(self, job: JobId, folder: Path, holding: QuotaHolding) -> None:
        """Enqueue the diagnosis of a folder, which is removed once that has ended."""
        holding.on_cancel = lambda: self.cancel(job)
        with self._changed:
            self._queue.append(_Job(job, folder, holding))
            self._begin_next()

    def cancel(self, job: JobId) -> bool:
        """End a diagnosis, or take it out of the queue; False where it is in neither."""
        with self._changed:
            waiting = next((one for one in self._queue if one.id == job), None)
            if waiting is not None:
                self._queue.remove(waiting)
            for one in self._running:
                if one.id == job:
                    one.cancelled = True
                    return True
        if waiting is None:
            return False
        self._forget(waiting)
        self._ended(job, Ended("cancelled", "It was cancelled before it began."))
        return True

    def progress(self, job: JobId) -> DiagnosisProgress | None:
        """Return the progress of a diagnosis; None where it neither waits nor runs.

        Of those ahead of it, only those of its site are counted: who may see it need not know
        how much is asked at other sites.
        """
        with self._changed:
            for one in self._running:
                if one.id == job:
                    seconds = one.turn.running_s() if one.turn is not None else 0.0
                    return DiagnosisProgress("running", one.stage, one.share, seconds)
            before = list(self._running)
            for one in self._queue:
                if one.id == job:
                    ahead = sum(other.id.site == job.site for other in before)
                    stage = f"waiting, {ahead} of its site ahead of it"
                    return DiagnosisProgress("queued", stage, 0.0, 0.0)
                before.append(one)
        return None

    def _begin_next(self) -> None:
        """Begin those whose turn it is: of each site one, who has used least first."""
        usage = self._processors.usage
        while self._started and not self._stopping:
            busy = {job.holder.site for job in self._running}
            ready = [job for job in self._queue if job.holder.site not in busy]
            if not ready or len(self._running) >= self._settings.max_running:
                return
            job = min(ready, key=lambda one: usage.rank(one.holder))
            self._queue.remove(job)
            self._running.append(job)
            threading.Thread(
                target=self._work, args=(job,), name="diagnose", daemon=True
            ).start()

    def _work(self, job: _Job) -> None:
        try:
            ended = self._run(job)
        except Exception as error:  # the others in the queue have their turn
            logger.exception("Diagnosis %d of %s failed.", job.id.number, job.id.twin)
            text = (
                f"It failed in the server ({type(error).__name__}), whose log says more. "
                "Order it again."
            )
            ended = Ended("failed", text)
        if ended is not None:
            try:
                self._ended(job.id, ended)
            except Exception:
                logger.exception(
                    "The outcome of diagnosis %d of %s could not be stored.", *job.id[::-1]
                )
        self._forget(job)
        with self._changed:
            self._running.remove(job)
            self._begin_next()
            self._changed.notify_all()

    def _forget(self, job: _Job) -> None:
        shutil.rmtree(job.folder, ignore_errors=True)
        job.holding.release()

    def _run(self, job: _Job) -> Ended | None:
        """See one process through; None where the server ends before it."""
        log = job.folder / "log"
        try:
            with log.open("wb") as errors:
                process = subprocess.Popen(
                    [*self._command, str(job.folder)],
                    stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
                    start_new_session=True,
                )  # fmt: skip
        except OSError as error:
            return Ended("failed", f"It could not be started: {error.strerror}.")
        said: list[str] = []
        assert process.stdout is not None
        reader = threading.Thread(
            target=self._listen,
            args=(job, process.stdout, said),
            name="diagnose-out",
            daemon=True,
        )
        reader.start()
        pid = process.pid
        with self._processors.turn(
            job.holder,
            lambda: pause_process(pid, group=True),
            lambda: resume_process(pid, group=True),
        ) as job.turn:
            why = self._wait(process, job)
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
                return Ended("done", outcome=read_outcome(job.folder))
            except (OSError, UnicodeDecodeError) as error:
                return Ended("failed", f"It ended without a report ({type(error).__name__}).")
        return Ended("failed", said[-1] if said else self._died(process.returncode, log))

    def _wait(self, process: subprocess.Popen[bytes], job: _Job) -> str:
        """Wait for the end of the process, or end it; return the reason."""
        while process.poll() is None:
            with self._changed:
                why = (
                    "stopping" if self._stopping
                    else "cancelled" if job.cancelled
                    else "late" if job.turn and job.turn.running_s() > self._settings.max_s
                    else ""
                )  # fmt: skip
            if why:
                resume_process(process.pid, group=True)  # so that it hears that it is to stop
                _end(process)
                return why
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_EVERY_S)
        assert process.stdin is not None
        process.stdin.close()
        return "ended"

    def _listen(self, job: _Job, lines: IO[bytes], said: list[str]) -> None:
        for line in lines:
            try:
                content = json.loads(line)
                if "error" in content:
                    said.append(str(content["error"])[:_LONGEST])
                else:
                    stage, share = str(content["stage"])[:200], float(content["share"])
                    with self._changed:
                        job.stage, job.share = stage, min(max(share, 0.0), 1.0)
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
