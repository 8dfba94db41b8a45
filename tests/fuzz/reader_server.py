"""MATLAB files read apart as ever, each by a child of a process that has imported the reader.

To start an interpreter for each takes half a second of imports; a child takes milliseconds.
"""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from unittest import mock

from slowtime_services.files.binary import reader_process

Done = subprocess.CompletedProcess[bytes]


@contextlib.contextmanager
def children() -> Iterator[None]:
    """Let readers of MATLAB files be forked."""
    command = [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"]
    places = (str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH"))
    surroundings = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, places))}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=surroundings
    ) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        asked, told = server.stdin, server.stdout

        def run(module: str, words: Sequence[str]) -> Done:
            said = Path(words[2]).with_name("said")
            asked.write(json.dumps([module, *words, str(said)]).encode() + b"\n")
            asked.flush()
            return Done(list(words), int(told.readline()), b"", said.read_bytes())

        try:
            with mock.patch.object(reader_process, "_run", run):
                yield
        finally:
            asked.close()
            server.terminate()


def serve() -> None:
    """Read what stdin names, each in a child; print how the child ended."""
    from slowtime_services.files.binary import matlab
    from slowtime_services.files.readers import reader_main

    mains = {each.__name__: each.main for each in (matlab, reader_main)}
    for line in sys.stdin:
        module, *words, said = json.loads(line)
        child = os.fork()
        if child == 0:
            status = 1
            try:
                os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT), 2)
                status = mains[module](*words)
                sys.stderr.flush()
            finally:
                os._exit(status)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
