"""Locks, file modes, priorities and pauses, also on systems without POSIX modules (Windows).

Tested on Linux. Systems without POSIX are imitated by a test that blocks their absent modules;
the branch for Windows is tested against a stand-in of `msvcrt`.
"""

import contextlib
import ctypes
import os
import signal
import stat
import time
from pathlib import Path

RETRY_S = 0.05
"""Pause between attempts to get a lock [s], where the system cannot wait for one; short beside
the time that a person waits for a command."""
_UNREADABLE_BY_OTHERS = 0o077


def lock_file(descriptor: int, *, wait: bool) -> None:
    """Lock an open file against other processes, until it is closed.

    Parameters
    ----------
    descriptor
        Descriptor of a file that is open for writing.
    wait
        Whether to wait while another process has the lock.

    Raises
    ------
    OSError
        If another process has it, and `wait` is False.
    """
    try:
        import fcntl
    except ModuleNotFoundError:
        _lock_byte(descriptor, wait=wait)
        return
    fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def _lock_byte(descriptor: int, *, wait: bool) -> None:
    """Lock the first byte of a file, as Windows does; no lock where there is neither."""
    try:
        import msvcrt
    except ModuleNotFoundError:
        return
    while True:
        os.lseek(descriptor, 0, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError:
            if not wait:
                raise
            time.sleep(RETRY_S)
        else:
            return


def access_of_others(path: Path) -> int:
    """Return the bits of a file's mode by which others than its owner may use it.

    Returns
    -------
    Bits of the mode; 0 on systems whose modes say nothing of other users.
    """
    if os.name != "posix":
        return 0
    return stat.S_IMODE(path.stat().st_mode) & _UNREADABLE_BY_OTHERS


def sync_folder(folder: Path) -> None:
    """Bring names of files to the disk: a new file without its name is lost.

    Parameters
    ----------
    folder
        Folder; systems that cannot open one keep names by themselves.
    """
    try:
        file = os.open(folder, os.O_RDONLY)
    except PermissionError:
        if os.name == "posix":
            raise
        return
    try:
        os.fsync(file)
    finally:
        os.close(file)


def lower_priority(steps: int) -> None:
    """Give way to other processes, where the system knows priorities of this kind.

    Parameters
    ----------
    steps
        Steps by which the priority is lowered [1], as the command `nice` counts them.
    """
    with contextlib.suppress(AttributeError):
        os.nice(steps)


def same_file(descriptor: int, path: Path) -> bool:
    """Whether a path leads to the file that is open: it may have been moved or replaced."""
    held = os.fstat(descriptor)
    try:
        found = os.stat(path)
    except OSError:
        return False
    return (found.st_dev, found.st_ino) == (held.st_dev, held.st_ino)


def pause_process(pid: int, *, group: bool = False) -> None:
    """Stop a process for a while; it goes on working where the system cannot do that.

    Parameters
    ----------
    pid
        Process of this user; one that has ended is left alone.
    group
        Whether all processes of its group are stopped, which it leads.
    """
    _send(pid, "SIGSTOP", group)


def resume_process(pid: int, *, group: bool = False) -> None:
    """Let a process go on that was paused.

    Parameters
    ----------
    pid
        Process of this user; one that has ended is left alone.
    group
        Whether all processes of its group go on, which it leads.
    """
    _send(pid, "SIGCONT", group)


def _send(pid: int, name: str, group: bool) -> None:
    number = getattr(signal, name, None)
    if number is None:  # not on every system
        return
    with contextlib.suppress(ProcessLookupError):
        (os.killpg if group else os.kill)(pid, number)


_PR_SET_PDEATHSIG = 1
"""Option of prctl(2): the signal that a process gets when its parent ends."""


def end_with_parent() -> None:
    """Have this process killed when its parent ends, even while it is paused.

    Only Linux can do that. Elsewhere a process that is not paused notices the end of a pipe.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
