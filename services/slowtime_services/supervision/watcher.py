"""Ends a process that gives no sign of life, or does not end in good time after a signal.

It runs as a process of its own, of the standard library alone, because a process whose
interpreter is held by one call can do nothing about itself: no thread of it runs, and no
handler of a signal. Arguments are the process, the limits and, after them, a file to mark.
Standard input is a pipe from the process: each byte is a sign of life, or the number of a
signal, which the interpreter writes at the moment of its arrival (`signal.set_wakeup_fd`)
and needs no lock for.
"""

import contextlib
import os
import select
import signal
import sys
import time

TICK_S = 1.0
"""How long is waited for a byte at a time [s]; signs of life come twice as often."""

DUMP_S = 3.0
"""How long the process may take to write its stacks after SIGABRT until SIGKILL [s]; a hundred
threads take some milliseconds."""

STARVED = 0.05
"""Share of a core below which a process that is ready to run counts as starved [1]: one that
holds its interpreter in a loop gets more, even beside ten others on that core."""

STARVED_WEIGHT = 0.1
"""Weight of a tick in which the process was starved, so that even this ends some time [1]."""

MARK = b"h"
"""Byte that is written over the first byte of the marked file: the process made no progress."""

LEAVING = ord("s")
"""Byte by which the process says that it has begun to end."""


class WatchedProcess:
    """A process, and what its threads have done since it was looked at.

    Parameters
    ----------
    pid
        Its number.
    """

    def __init__(self, pid: int) -> None:
        self.pid, self._used_s = pid, 0.0

    def weight(self) -> float:
        """Weigh a tick without a sign of life: 0 for a stopped process, 1 for one that runs."""
        try:
            states, used_s = _looked_at(self.pid)
        except OSError:
            return 1.0  # without /proc nothing is known
        used_s, self._used_s = used_s - self._used_s, used_s
        if states <= {"T", "t"}:
            return 0.0  # by SIGSTOP or a debugger
        if states & {"R", "D"} and used_s < STARVED * TICK_S:
            return STARVED_WEIGHT
        return 1.0


def _looked_at(pid: int) -> tuple[set[str], float]:
    """Return the states of all threads, and the processor time of the process [s]."""
    states: set[str] = set()
    for thread in os.listdir(f"/proc/{pid}/task"):
        with open(f"/proc/{pid}/task/{thread}/stat", "rb") as file:
            states.add(file.read().rpartition(b")")[2].split()[0].decode())
    with open(f"/proc/{pid}/stat", "rb") as file:
        fields = file.read().rpartition(b")")[2].split()
    return states, (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def watch(pid: int, silent_s: float, grace_s: float, marked: str) -> None:
    """Wait until the process has ended, or end it.

    Parameters
    ----------
    pid
        The process.
    silent_s
        How long it may give no sign of life [s].
    grace_s
        How long it may take to end after SIGINT, SIGTERM or its own notice [s].
    marked
        File whose first byte is written over where it gave no sign of life; empty for none.
    """
    watched, quiet_s = WatchedProcess(pid), 0.0
    left_s: float | None = None
    before_s = time.monotonic()
    while os.getppid() == pid:
        ready = select.select([0], [], [], TICK_S)[0]
        passed_s, before_s = time.monotonic() - before_s, time.monotonic()
        if ready:
            told = os.read(0, 4096)
            if not told:
                return
            quiet_s = 0.0
            if left_s is None and {signal.SIGINT, signal.SIGTERM, LEAVING} & set(told):
                left_s = grace_s
        else:
            quiet_s += TICK_S * watched.weight()
        if left_s is not None:
            # Not by the clock alone: the whole computer may have been asleep.
            left_s -= min(passed_s, 2 * TICK_S)
        if quiet_s >= silent_s:
            _mark(marked)
            _end(pid, f"gave no sign of life for {quiet_s:.0f} s")
            return
        if left_s is not None and left_s <= 0:
            _end(pid, f"has not ended {grace_s:g} s after it was told to")
            return


def _mark(path: str) -> None:
    if not path:
        return
    try:
        file = os.open(path, os.O_WRONLY)
        os.pwrite(file, MARK, 0)
        os.close(file)
    except OSError as error:
        _say(f"{path} cannot be marked: {error.strerror}.")


def _end(pid: int, why: str) -> None:
    _say(f"Process {pid} {why}. The stacks of its threads follow, and it is ended.")
    _signal(pid, signal.SIGABRT)
    until_s = time.monotonic() + DUMP_S
    while time.monotonic() < until_s and os.getppid() == pid:
        if select.select([0], [], [], 0.1)[0] and not os.read(0, 4096):
            break
    _signal(pid, signal.SIGKILL)


def _signal(pid: int, number: int) -> None:
    if os.getppid() == pid:  # else the number may be another's by now
        with contextlib.suppress(OSError):
            os.kill(pid, number)


def _say(sentence: str) -> None:
    with contextlib.suppress(OSError):
        os.write(2, f"slowtime watcher: {sentence}\n".encode())


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        # Sent to all of a terminal or a unit, to the process that is watched as well.
        signal.signal(number, signal.SIG_IGN)
    watch(int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]), sys.argv[4])
