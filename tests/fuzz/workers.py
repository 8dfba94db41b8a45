"""Readers in a worker that is used again, and replaced where it dies, hangs or grows old.

Starting an interpreter with the libraries takes seconds, which 10,000 files a format do not
have; `slowtime_services.files.binary.reader_process` starts one for each file, as
`test_formats` does too.
"""

import contextlib
import json
import os
import select
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from unittest import mock

from slowtime_services.files.binary import reader_process

Done = subprocess.CompletedProcess[bytes]
MOST_FILES = 500
"""Files that one worker reads, so that what a library keeps is not taken for a leak."""


class Worker:
    """One process that reads files, one after the other."""

    def __init__(self, patience_s: float) -> None:
        self.patience_s = patience_s
        self.started = self.died = self.late = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._files = 0

    def run(self, module: str, words: Sequence[str]) -> Done:
        """Read a file as `reader_process` would have it read."""
        process = self._fresh()
        assert process.stdin is not None
        assert process.stdout is not None
        said = Path(words[2]).with_name("said")
        said.touch()
        process.stdin.write(json.dumps([module, *words, str(said)]).encode() + b"\n")
        process.stdin.flush()
        if not select.select([process.stdout], [], [], self.patience_s)[0]:
            self.late += 1
            self.close()
            raise subprocess.TimeoutExpired(module, self.patience_s)
        line = process.stdout.readline()
        status = int(line) if line else process.wait()
        if not line:
            self.died += 1
            self.close()
        return Done(list(words), status, b"", said.read_bytes())

    def _fresh(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._files >= MOST_FILES:
            self.close()
        if self._process is None:
            self.started += 1
            self._files = 0
            command = [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"]
            paths = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
            surroundings = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=surroundings
            )
        self._files += 1
        return self._process

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


@contextlib.contextmanager
def worker(patience_s: float) -> Iterator[Worker]:
    """Let readers work in one process."""
    one = Worker(patience_s)
    try:
        with mock.patch.object(reader_process, "_run", one.run):
            yield one
    finally:
        one.close()


def serve() -> None:
    """Read what stdin names; print how it ended."""
    from slowtime_services.files.binary import matlab, workbook
    from slowtime_services.files.readers import reader_main

    mains = {each.__name__: each.main for each in (matlab, workbook, reader_main)}
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what a library prints is no answer
    for line in sys.stdin:
        module, *words, said = json.loads(line)
        with open(said, "w") as file, contextlib.redirect_stderr(file):
            try:
                status = mains[module](*words)
            except BaseException as error:
                file.write(f"{type(error).__name__}: {error}")
                status = 1
        answers.write(f"{status}\n")
