"""A process of its own for an installed part, which is ended where it hangs.

The process has the rights of its user, and no more is promised than this: what the part raises,
prints, returns or keeps to itself for ever ends neither the process that asked nor its threads.
Requests are pickled by us; answers are JSON, and streams are bytes: nothing that the part makes
is unpickled.
"""

import contextlib
import functools
import os
import pickle
import queue
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Iterator
from typing import Any, BinaryIO

from pydantic_core import from_json, to_json

from .discovery import Plugin, PluginError, exception_text, find

LONGEST_BYTES = 64 * 2**20
"""Of one answer or packet."""
POLL_S = 0.2
ENDING_S = 0.2
"""What a process is given to end by itself, once its pipes are closed."""
STARTING_S = 30.0
"""What a process may take to begin, beside what its first answer may take."""
_LENGTH = struct.Struct("<cI")
_READY, _ANSWER, _FAULT, _LAST = b"r", b"a", b"f", b"e"
END = b"\0end"
"""In the place of a packet: there are no more."""


class PluginProcess:
    """A part in a process that is started when it is first asked, and after it was killed."""

    def __init__(self, plugin: Plugin, starting_s: float = STARTING_S) -> None:
        self.plugin, self._starting_s = plugin, starting_s
        self._process: subprocess.Popen[bytes] | None = None
        self._taken = bytearray()
        self._lock = threading.Lock()

    def ask(self, *arguments: Any, timeout_s: float) -> Any:
        """Call the part with `arguments`.

        Returns
        -------
        What it returned, as JSON holds it.

        Raises
        ------
        PluginError
            Where it raised, ended its process, or did not answer in time and was killed.
        """
        with self._lock:
            self._start()
            until_s = time.monotonic() + timeout_s
            answer = self._frame(until_s) if self._send(arguments, until_s) else None
            if answer is None:
                self._end()
                raise PluginError(
                    f"{self.plugin} did not answer within {timeout_s:g} s, and was ended."
                )
            if not answer:
                raise PluginError(f"{self.plugin} ended its process{self._end()}.")
            return from_json(answer)

    def stream(
        self, *arguments: Any, stop: threading.Event
    ) -> Generator[bytes | None, None, None]:
        """Yield the packets of the plug-in; None at intervals without packets.

        Raises
        ------
        PluginError
            Where it raised, or ended its process otherwise than by its end.
        """
        with self._lock:
            try:
                self._start()
                self._send(arguments, time.monotonic() + self._starting_s)
                while not stop.is_set():
                    packet = self._frame(time.monotonic() + POLL_S)
                    if packet == END:
                        return
                    if packet == b"":
                        raise PluginError(f"{self.plugin} ended its process{self._end()}.")
                    yield packet
            finally:
                self._end()

    def close(self) -> None:
        """End the process, whoever is asking it."""
        self._end()

    def _start(self) -> None:
        if self._process is not None and self._process.poll() is None:
            return
        self._end()
        self._taken.clear()
        words = (self.plugin.group, self.plugin.name)
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert self._process.stdin is not None
        os.set_blocking(self._process.stdin.fileno(), False)
        try:
            begun = self._frame(time.monotonic() + self._starting_s, _READY)
        except PluginError:
            self._end()
            raise
        if begun is None:
            self._end()
            raise PluginError(
                f"{self.plugin} is not imported within {self._starting_s:g} s, and was ended."
            )

    def _send(self, arguments: Any, until_s: float) -> bool:
        """Write a request, however long; False where the part does not read it in time."""
        assert self._process is not None
        assert self._process.stdin is not None
        descriptor = self._process.stdin.fileno()
        left = memoryview(pickle.dumps(arguments))
        while left:
            wait_s = max(0.0, until_s - time.monotonic())
            if not select.select([], [descriptor], [], wait_s)[1]:
                return False
            try:
                left = left[os.write(descriptor, left) :]
            except BrokenPipeError:
                return True  # what it left behind is read next
        return True

    def _frame(self, until_s: float, wanted: bytes = _ANSWER) -> bytes | None:
        """One frame; None where it has not come in time, empty where the process has ended."""
        while True:
            if len(self._taken) >= _LENGTH.size:
                kind, length = _LENGTH.unpack_from(self._taken)
                if kind not in (_READY, _ANSWER, _FAULT, _LAST) or length > LONGEST_BYTES:
                    self._end()
                    raise PluginError(
                        f"{self.plugin} gave more than {LONGEST_BYTES} bytes at once, or wrote "
                        "where it must not, and was ended."
                    )
                end = _LENGTH.size + length
                if len(self._taken) >= end:
                    body = bytes(self._taken[_LENGTH.size : end])
                    del self._taken[:end]
                    if kind == _FAULT:
                        raise PluginError(body.decode(errors="replace"))
                    if kind == _LAST:
                        return END
                    if kind == wanted:
                        return body
                    continue
            process = self._process
            if process is None or process.stdout is None:
                return b""
            descriptor = process.stdout.fileno()
            if not select.select([descriptor], [], [], max(0.0, until_s - time.monotonic()))[0]:
                return None
            taken = os.read(descriptor, 2**20)
            if not taken:
                return b""
            self._taken += taken

    def _end(self) -> str:
        """End the process; return its exit status if it had ended by itself, for a message."""
        process, self._process = self._process, None
        if process is None:
            return ""
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                if pipe is not None:
                    pipe.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(ENDING_S if process.poll() is None else None)
        process.kill()
        process.wait()
        return f" with exit status {process.returncode}" if process.returncode else ""


def main(group: str, name: str) -> int:
    """Serve one plug-in: a call for each request of stdin, its answer or packets to stdout."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the part prints is no answer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends who asked, and that ends this
    requests: queue.SimpleQueue[Any] = queue.SimpleQueue()
    try:
        plugin = find(group, name)
        threading.Thread(target=_requests, args=(requests,), daemon=True).start()
        part = plugin.load()
        if group == "slowtime.effects":
            # Only here: a compiler of laws is what no other part needs.
            from .effect_trial import trial

            part = functools.partial(trial, str(plugin), part)
        _write(out, _READY, b"")
        while True:
            arguments = requests.get()
            for kind, body in _answers(plugin, part, arguments):
                _write(out, kind, body)
    except PluginError as error:
        _write(out, _FAULT, str(error).encode())
        return 1
    except BrokenPipeError:
        return 1


def _requests(into: "queue.SimpleQueue[Any]") -> None:
    """Take requests; end when the parent has ended, whatever the part is doing."""
    with contextlib.suppress(EOFError):
        while True:
            into.put(pickle.load(sys.stdin.buffer))
    os._exit(0)


def _answers(plugin: Plugin, part: Any, arguments: Any) -> Iterator[tuple[bytes, bytes]]:
    try:
        given = part(*arguments)
        if plugin.group != "slowtime.sources":
            yield _ANSWER, to_json(given)
            return
        for packet in given:
            yield _ANSWER, bytes(memoryview(packet))
        yield _LAST, b""
    except Exception as error:  # whatever the part raises is its own fault
        yield _FAULT, f"{plugin} failed: {exception_text(error)}.".encode()


def _write(out: BinaryIO, kind: bytes, body: bytes) -> None:
    out.write(_LENGTH.pack(kind, len(body)) + body)
    out.flush()


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
