"""Locks and modes, on this system and on one that is imitated: without POSIX modules."""

import os
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import pytest

from slowtime_services import operating_system
from slowtime_services.operating_system import (
    access_of_others,
    lock_file,
    lower_priority,
    pause_process,
    resume_process,
    sync_folder,
)

HOLD = """
import os, sys
from slowtime_services.operating_system import lock_file
file = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT)
lock_file(file, wait=False)
print("held", flush=True)
sys.stdin.read()
"""


class Msvcrt(types.ModuleType):
    """As far as it is used here: one lock a file, refused while another holds it."""

    LK_NBLCK = 2

    def __init__(self) -> None:
        super().__init__("msvcrt")
        self.held: set[int] = set()
        self.tried = 0

    def locking(self, descriptor: int, mode: int, count: int) -> None:
        assert (mode, count, os.lseek(descriptor, 0, os.SEEK_CUR)) == (self.LK_NBLCK, 1, 0)
        self.tried += 1
        file = os.fstat(descriptor).st_ino
        if file in self.held:
            raise PermissionError(13, "Permission denied")
        self.held.add(file)


@pytest.fixture
def file(tmp_path):
    descriptor = os.open(tmp_path / "lock", os.O_RDWR | os.O_CREAT)
    yield descriptor
    os.close(descriptor)


def test_a_lock_of_another_process_is_respected(tmp_path, file):
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, tmp_path / "lock"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(OSError, match="unavailable"):
        lock_file(file, wait=False)
    threading.Timer(0.3, lambda: holder.communicate("")).start()
    began = time.monotonic()
    lock_file(file, wait=True)
    assert time.monotonic() - began > 0.2
    holder.wait(10)


def test_windows_locks_the_first_byte(monkeypatch, file):
    msvcrt = Msvcrt()
    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", msvcrt)
    lock_file(file, wait=False)
    with pytest.raises(PermissionError):
        lock_file(file, wait=False)
    monkeypatch.setattr(operating_system, "RETRY_S", 0.01)
    threading.Timer(0.1, msvcrt.held.clear).start()
    lock_file(file, wait=True)
    assert msvcrt.tried > 3


def test_a_system_without_either_locks_nothing(monkeypatch, file):
    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", None)
    lock_file(file, wait=False)
    lock_file(file, wait=True)


@pytest.mark.parametrize(("mode", "others"), [(0o600, 0), (0o640, 0o040), (0o606, 0o006)])
def test_modes_tell_who_else_may_use_a_file(tmp_path, monkeypatch, mode, others):
    path = tmp_path / "key"
    path.touch()
    path.chmod(mode)
    assert access_of_others(path) == others
    monkeypatch.setattr(os, "name", "nt")
    assert access_of_others(path) == 0


def test_a_folder_is_brought_to_the_disk_where_that_is_possible(tmp_path, monkeypatch):
    sync_folder(tmp_path)

    def refused(*_args):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refused)
    with pytest.raises(PermissionError):
        sync_folder(tmp_path)
    monkeypatch.setattr(os, "name", "nt")
    sync_folder(tmp_path)


def test_priority_is_lowered_where_there_is_one(monkeypatch):
    lowered: list[int] = []
    monkeypatch.setattr(os, "nice", lowered.append)
    lower_priority(5)
    assert lowered == [5]
    monkeypatch.delattr(os, "nice")
    lower_priority(5)


CHILD = (
    "import sys, time\n"
    "from slowtime_services.operating_system import end_with_parent\n"
    "end_with_parent()\n"
    "print('begun', flush=True)\n"
    "time.sleep(600)\n"
)
PARENT = (
    "import subprocess, sys, time\n"
    "child = subprocess.Popen([sys.executable, '-c', sys.argv[1]], stdout=subprocess.PIPE)\n"
    "child.stdout.readline()\n"
    "print(child.pid, flush=True)\n"
    "time.sleep(600)\n"
)


def state_of(pid):
    """Letter by which Linux tells the state of a process; empty where there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return ""


def until(holds):
    """Wait until it holds: a signal is sent at once and takes effect later."""
    until_s = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < until_s
        time.sleep(0.01)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_a_process_that_is_paused_goes_on_or_ends_with_its_parent():
    command = [sys.executable, "-c", PARENT, CHILD]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        try:
            assert parent.stdout is not None
            pid = int(parent.stdout.readline())
            pause_process(pid)
            until(lambda: state_of(pid) == "T")
            resume_process(pid)
            until(lambda: state_of(pid) != "T")
            pause_process(pid)
        finally:
            parent.kill()
    until(lambda: state_of(pid) in ("", "Z"))
    pause_process(pid)  # one that has ended is left alone
