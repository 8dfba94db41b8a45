"""Integrity check of a foreign recording, in a process of its own.

It is read to its end in a process of its own, which may take only so much memory and time: a
file that was made to break its reader breaks that one.
"""

import signal
import subprocess
import sys
from pathlib import Path

from slowtime_schemas.streams import parse_key

from .recording_reader import RecordingError, contents, read_recording

TIMEOUT_S = 60.0
"""Time that the reading process is given [s]."""
ADDRESS_SPACE_BYTES = 2**30
"""Address space of the process [bytes]: its code, one unpacked chunk, and what is made of
it."""
MAX_UNPACKED_BYTES = 2**32
"""Size of all messages together [bytes]."""

REFUSED = 3
"""Exit status of the process where it has said why the file is refused."""


def check(path: Path) -> None:
    """Read a recording to its end, in a separate process.

    Raises
    ------
    RecordingError
        Where it is not sound; the text says why, and what to do.
    """
    command = [sys.executable, "-P", "-W", "ignore", "-m", __spec__.name, str(path)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise RecordingError(
            f"It has kept its reader busy for {TIMEOUT_S:g} s. Give a shorter recording."
        ) from error
    if done.returncode == REFUSED:
        raise RecordingError(done.stderr.decode(errors="replace").strip())
    if done.returncode != 0:
        how = (
            signal.Signals(-done.returncode).name
            if done.returncode < 0
            else f"exit status {done.returncode}"
        )
        raise RecordingError(
            f"It broke its reader ({how}): it is damaged, or was made to. Run `slowtime "
            "recover` on it, and give what that leaves."
        )


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
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))


def main(path: str) -> int:
    """Read the file through, or report why not."""
    _bound()
    try:
        read_through(Path(path))
    except RecordingError as error:
        sys.stderr.write(f"{error}\n")
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
