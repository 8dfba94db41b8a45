"""A job: one command in a process of its own, with limits of time and memory."""

import dataclasses
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, Protocol

Status = Literal["done", "failed", "too_slow", "too_large", "killed", "cancelled"]
POLL_S = 0.1
"""[s] Between two looks at a process: short beside any job."""
LAST_CHARACTERS = 2000
"""[characters] Of the error output that are kept of a job that failed."""
NO_MEMORY = ("MemoryError", "Unable to allocate", "bad_alloc", "LLVM ERROR: out of memory")
"""What Python, NumPy, C++ and LLVM write when they get no memory."""
ONE_THREAD = {
    name: "1" for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
}
"""Environment of jobs that run beside each other, one for each core."""


@dataclasses.dataclass(frozen=True, slots=True)
class Job:
    """A command that reads and writes files.

    Parameters
    ----------
    name
        By which its outcome is reported; unique within a run.
    command
        Program and arguments.
    folder
        Working directory. Engines on several machines need it on all of them.
    """

    name: str
    command: tuple[str, ...]
    folder: Path


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class JobLimits:
    """Limits of each job.

    Parameters
    ----------
    seconds
        [s] On the clock, after which the process is stopped; none if 0.
    mebibytes
        [MiB] Data that the process may allocate; none if 0. Not enforced on Windows.
    retries
        How often a job is run again whose process was killed from outside.
    """

    seconds: float = 0.0
    mebibytes: int = 0
    retries: int = 1


@dataclasses.dataclass(frozen=True, slots=True)
class JobEnd:
    """How a job ended.

    Parameters
    ----------
    name
        Of the job.
    status
        `done` if its command returned 0; `failed` if not; `too_slow` and `too_large` if it
        exceeded a limit; `killed` if a signal ended it in every attempt; `cancelled` if the run
        was stopped.
    seconds
        [s] Of the last attempt.
    attempts
        How often it was started.
    message
        End of what it wrote to its error output.
    """

    name: str
    status: Status
    seconds: float
    attempts: int
    message: str = ""


class Engine(Protocol):
    """Runs jobs beside each other."""

    def run(
        self, jobs: Sequence[Job], limits: JobLimits, stop: threading.Event
    ) -> Iterator[JobEnd]:
        """Run jobs, and give the outcome of each as it ends.

        Parameters
        ----------
        jobs
            Each with a name of its own.
        limits
            Of each job.
        stop
            Once set, jobs that run are ended and others not begun; they are not reported.
        """
        ...


def run_job(job: Job, limits: JobLimits, stop: threading.Event | None = None) -> JobEnd:
    """Run a job in a process, again if it is killed from outside, and tell how it ended.

    Parameters
    ----------
    job
        Its command and folder.
    limits
        Of time, memory and attempts.
    stop
        Once set, the process is ended.
    """
    stop = stop or threading.Event()
    for attempt in range(1, limits.retries + 2):
        found = _attempt(job, limits, stop, attempt)
        if found.status != "killed":
            break
    return found


def _attempt(job: Job, limits: JobLimits, stop: threading.Event, attempt: int) -> JobEnd:
    begun = time.monotonic()
    with subprocess.Popen(
        _limited(job.command, limits),
        cwd=job.folder,
        env=_environment(os.environ),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C is for the caller, who ends its processes
    ) as process:
        heard = bytearray()
        listener = threading.Thread(target=_listen, args=(process, heard), daemon=True)
        listener.start()
        ended = _wait(process, limits, stop, begun)
        listener.join(timeout=1.0)
    message = heard.decode(errors="replace")[-LAST_CHARACTERS:].strip()
    return JobEnd(
        job.name,
        ended or _status(process.returncode, message, limits),
        time.monotonic() - begun,
        attempt,
        message,
    )


def _listen(process: "subprocess.Popen[bytes]", heard: bytearray) -> None:
    assert process.stderr is not None
    while block := process.stderr.read1(4096):  # type: ignore[attr-defined]  # buffered
        heard += block
        del heard[: -2 * LAST_CHARACTERS]


def _wait(
    process: "subprocess.Popen[bytes]", limits: JobLimits, stop: threading.Event, begun: float
) -> Status | None:
    """Wait for the end of a process; say why it was ended here, None if it was not."""
    while True:
        try:
            process.wait(POLL_S)
        except subprocess.TimeoutExpired:
            late = 0 < limits.seconds < time.monotonic() - begun
            if late or stop.is_set():
                process.kill()
                process.wait()
                return "too_slow" if late else "cancelled"
        else:
            return None


def _status(code: int, message: str, limits: JobLimits) -> Status:
    """Tell why a process ended by itself."""
    if code == 0:
        return "done"
    if limits.mebibytes and any(words in message for words in NO_MEMORY):
        return "too_large"
    return "killed" if code < 0 else "failed"


def _environment(given: Mapping[str, str]) -> dict[str, str]:
    return {**given, **ONE_THREAD}


def _limited(command: Sequence[str], limits: JobLimits) -> list[str]:
    """Give the command, begun by a program that limits its own memory where one is limited."""
    if not limits.mebibytes:
        return list(command)
    program = "slowtime_services.engines.memory_limit"
    return [sys.executable, "-m", program, str(limits.mebibytes), *command]
