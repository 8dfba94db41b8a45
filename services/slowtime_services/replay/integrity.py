"""Integrity check of a foreign recording, in a process of its own.

It is read to its end in a process of its own, which may take only so much memory and time: a
file that was made to break its reader breaks that one.
"""

import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from slowtime_schemas.streams import parse_key
from slowtime_services.operating_system import end_with_parent

from .recording_reader import RecordingError, contents, read_recording

TIMEOUT_S = 60.0
"""Processor time that the reading process is given [s]: what others use is not counted."""
LONGEST_S = 600.0
"""Time that it is given by the clock, for what waits instead of computing [s]."""
ADDRESS_SPACE_BYTES = 2**30
"""Address space of the process [bytes]: its code, one unpacked chunk, and what is made of
it."""
MAX_UNPACKED_BYTES = 2**32
"""Size of all messages together [bytes]."""

REFUSED = 3
"""Exit status of the process where it has said why the file is refused."""

LOOK_S = 0.1
"""Interval at which it is looked whether the process has had its time [s]."""

Supervise = Callable[[int], contextlib.AbstractContextManager[Callable[[], float]]]
"""Surrounds a process, given its id; gives how long that has run without pauses [s], or raises
to end it."""


@contextlib.contextmanager
def unpaused(_: int) -> Iterator[Callable[[], float]]:
    """Let a process run without pauses."""
    began_s = time.monotonic()
    yield lambda: time.monotonic() - began_s


def check(path: Path, supervise: Supervise = unpaused) -> None:
    """Read a recording to its end, in a separate process.

    Parameters
    ----------
    supervise
        Pauses the process in favour of others; such pauses are not counted.

    Raises
    ------
    RecordingError
        Where it is not sound; the text says why, and what to do.
    """
    command = [sys.executable, "-P", "-W", "ignore", "-m", __spec__.name, str(path)]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as process, supervise(process.pid) as running_s:  # fmt: skip
        try:
            said = _end_of(process, running_s)
        except BaseException:
            process.kill()
            raise
    if process.returncode == REFUSED:
        raise RecordingError(said.decode(errors="replace").strip())
    if process.returncode == -getattr(signal, "SIGXCPU", 0) != 0:
        raise _too_long(TIMEOUT_S)
    if process.returncode != 0:
        how = (
            signal.Signals(-process.returncode).name
            if process.returncode < 0
            else f"exit status {process.returncode}"
        )
        raise RecordingError(
            f"It broke its reader ({how}): it is damaged, or was made to. Run `slowtime mcap "
            "recover` on it, and give what that leaves."
        )


def _too_long(seconds: float) -> RecordingError:
    return RecordingError(
        f"It has kept its reader busy for {seconds:g} s. Give a shorter recording."
    )


def _end_of(process: subprocess.Popen[bytes], running_s: Callable[[], float]) -> bytes:
    """Wait for the end of the process; return what it said."""
    while True:
        try:
            return process.communicate(timeout=LOOK_S)[1]
        except subprocess.TimeoutExpired as error:
            if running_s() > LONGEST_S:
                raise _too_long(LONGEST_S) from error


def read_through(path: Path) -> None:
    """Read every message of a recording, and count the unpacked bytes.

    Raises
    ------
    RecordingError
        Where it cannot be read, holds nothing of ours, or more than it may.
    """
    if not contents(path).messages:
        raise RecordingError("It holds no message of a structure. Record for longer.")
    unpacked = 0
    for message in read_recording(path):
        unpacked += len(message.payload)
        stream, _, _ = parse_key(message.key)
        if len(message.payload) > stream.max_bytes:
            raise RecordingError(
                f"A message of {len(message.payload):,} bytes is on {message.key}. Allowed "
                f"there: {stream.max_bytes:,}."
            )
        if unpacked > MAX_UNPACKED_BYTES:
            raise RecordingError(
                f"It unpacks to more than {MAX_UNPACKED_BYTES:,} bytes. Give it in parts."
            )


def _bound() -> None:
    try:
        import resource
    except ModuleNotFoundError:  # not on every system
        return
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE_BYTES, ADDRESS_SPACE_BYTES))
    seconds = int(TIMEOUT_S)
    # At the second of them it would be killed without a name for the reason.
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))


def main(path: str) -> int:
    """Read the file through, or report why not."""
    end_with_parent()
    _bound()
    try:
        read_through(Path(path))
    except RecordingError as error:
        sys.stderr.write(f"{error}\n")
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
