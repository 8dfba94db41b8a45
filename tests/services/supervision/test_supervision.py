"""Signs of life, the watcher that waits for them, and notices to systemd."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from slowtime_services.shutdown import ended_by_signals
from slowtime_services.supervision import Heartbeat, WatchReport, all_stacks, notify, watchdog_s

CHILD = """
import ctypes, signal, sys, threading, time
from pathlib import Path
from slowtime_services.supervision import Heartbeat, WatchReport

def hold():
    # A lock of the C library that is taken twice: no signal ends the second call.
    lock, library = ctypes.create_string_buffer(256), ctypes.PyDLL(None)
    library.pthread_mutex_lock(lock)
    library.pthread_mutex_lock(lock)

marked = Path(sys.argv[2]) if sys.argv[2] else None
signal.signal(signal.SIGTERM, lambda *_: None)
with Heartbeat(WatchReport(silent_s=float(sys.argv[3]), grace_s=2.0, marked=marked)):
    print("up", flush=True)
    if sys.argv[1] == "hold":
        hold()
    elif sys.argv[1] == "sleep":
        time.sleep(1.5)
    else:
        threading.Event().wait()
"""


def child(how, marked="", silent_s=3.0):
    process = subprocess.Popen(
        [sys.executable, "-c", CHILD, how, str(marked), str(silent_s)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    return process


def test_a_process_that_holds_the_interpreter_is_marked_and_ended_with_its_stack(tmp_path):
    marked = tmp_path / "note"
    marked.write_bytes(b"-SL1")
    process = child("hold", marked)
    _, said = process.communicate(timeout=120)
    assert process.returncode in (-signal.SIGABRT, -signal.SIGKILL)
    assert "gave no sign of life for" in said
    assert "Current thread" in said or "Thread 0x" in said  # of faulthandler
    assert marked.read_bytes() == b"hSL1"


def test_a_process_that_lives_is_left_alone_and_takes_its_watcher_with_it():
    process = child("sleep")
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0
    assert said == ""


def test_a_stopped_process_is_not_taken_for_one_that_hangs():
    process = child("wait", silent_s=2.0)
    process.send_signal(signal.SIGSTOP)
    time.sleep(5.0)
    process.send_signal(signal.SIGCONT)
    time.sleep(1.5)
    assert process.poll() is None
    process.kill()
    process.communicate()


def test_sigterm_is_heard_by_the_watcher_of_a_process_that_holds_its_interpreter():
    process = child("hold", silent_s=600.0)
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=120)
    assert process.returncode in (-signal.SIGABRT, -signal.SIGKILL)
    assert "has not ended 2 s after it was told to" in said


def test_what_outlasts_the_grace_time_after_a_signal_is_ended_with_its_stack():
    code = """
import ctypes, os, signal, time
from slowtime_services.shutdown import ended_by_signals
with ended_by_signals(grace_s=1.0) as stop:
    os.kill(os.getpid(), signal.SIGTERM)
    assert stop.is_set()
    ctypes.PyDLL(None).pause()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 1
    assert "Timeout" in done.stderr


def test_what_ends_in_good_time_is_not_ended(capfd):
    with ended_by_signals(grace_s=0.5) as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.wait(10)
    time.sleep(0.8)
    assert capfd.readouterr().err == ""


@pytest.fixture
def systemd(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.settimeout(30)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield listening


def test_systemd_hears_of_start_life_and_end(systemd, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "4000000")
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
    assert watchdog_s() == 4.0
    goes_on = [True]
    with Heartbeat(None, lambda: goes_on[0]) as heartbeat:
        assert systemd.recv(1000) == b"EXTEND_TIMEOUT_USEC=30000000"
        heartbeat.ready()
        while (told := systemd.recv(1000)).startswith(b"EXTEND"):
            pass
        assert told == b"READY=1\nSTATUS=Running."
        assert systemd.recv(1000) == b"WATCHDOG=1"
        goes_on[0] = False
        time.sleep(1.2)
        heartbeat.leaving()
        told = [systemd.recv(1000)]
        while not told[-1].startswith(b"STOPPING"):
            told.append(systemd.recv(1000))
        assert len(told) <= 3  # one sign of life may have been on its way


def test_without_systemd_nothing_is_sent(monkeypatch):
    for name in ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"):
        monkeypatch.delenv(name, raising=False)
    assert not notify("READY=1")
    assert watchdog_s() is None
    monkeypatch.setenv("WATCHDOG_USEC", "4000000")
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid() + 1))
    assert watchdog_s() is None


def test_stacks_name_the_threads():
    assert "Thread MainThread:" in all_stacks()
    assert "test_stacks_name_the_threads" in all_stacks()


def test_a_watch_without_a_file_marks_none():
    assert WatchReport(silent_s=3.0, grace_s=2.0).marked is None
