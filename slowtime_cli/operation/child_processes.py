"""Processes started by one command: separate logs, one end."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

TERMINATION_S = 8.0
"""Time that processes are given to end by themselves [s]."""


class Children:
    """Child processes that all end when this one does."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._running: list[tuple[str, subprocess.Popen[bytes]]] = []
        logs.mkdir(parents=True, exist_ok=True)

    def start(
        self,
        name: str,
        arguments: Sequence[str],
        settings: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Start ``slowtime ARGUMENTS``, with its output in a log file of its own.

        Parameters
        ----------
        name
            Of the log file.
        arguments
            Of the command line.
        settings
            Environment variables, where the user has not set them.
        """
        with (self._logs / f"{name}.log").open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "slowtime_cli", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**settings, **os.environ},
                # Ctrl-C belongs to the parent: it ends the children in their order.
                start_new_session=True,
            )
        self._running.append((name, process))

    def check(self, ending: Sequence[str] = ()) -> None:
        """Raise if a child has died, with the end of its output.

        Parameters
        ----------
        ending
            Children that may end by themselves.

        Raises
        ------
        RuntimeError
            Naming the child, its exit status and its log file.
        """
        for name, process in self._running:
            if process.poll() is not None and name not in ending:
                log = self._logs / f"{name}.log"
                last = log.read_text(errors="replace").strip().splitlines()[-3:]
                raise RuntimeError(
                    f"{name} ended with status {process.returncode}. It said: "
                    f"{' | '.join(last)} (all of it in {log})"
                )

    def status(self, name: str) -> int | None:
        """Return the exit status of a child; None while it runs."""
        return self._of(name).poll()

    def stop(self, name: str, patience_s: float = TERMINATION_S) -> int:
        """End one child, and return its exit status; another of that name may be started.

        Parameters
        ----------
        patience_s
            Time that it is given to end by itself [s].
        """
        process = self._of(name)
        _end([process], patience_s)
        self._running.remove((name, process))
        return int(process.returncode)

    def end(self) -> None:
        """Ask all to end, youngest first, and insist after some seconds."""
        _end([process for _, process in reversed(self._running)])
        self._running.clear()

    def _of(self, name: str) -> subprocess.Popen[bytes]:
        return next(process for known, process in self._running if known == name)


def _end(
    processes: Sequence[subprocess.Popen[bytes]], patience_s: float = TERMINATION_S
) -> None:
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
    deadline = time.monotonic() + patience_s
    for process in processes:
        try:
            process.wait(max(deadline - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def children(logs: Path) -> Iterator[Children]:
    """Children for the length of a with block."""
    family = Children(logs)
    try:
        yield family
    finally:
        family.end()
