"""The process that checks a recording may be paused, has an end, and ends with who waits."""

import contextlib
import signal
import subprocess
import sys

import pytest

from slowtime_services.replay import RecordingError, check, integrity


def test_what_ends_the_wait_ends_the_process_and_is_told(tmp_path):
    pids = []

    class CancelledError(Exception):
        pass

    @contextlib.contextmanager
    def supervise(pid):
        pids.append(pid)

        def running_s():
            raise CancelledError

        yield running_s

    with pytest.raises(CancelledError):
        check(tmp_path / "none.mcap", supervise)
    assert len(pids) == 1


def test_one_that_waits_for_too_long_is_ended(tmp_path):
    @contextlib.contextmanager
    def supervise(_):
        yield lambda: integrity.LONGEST_S + 1.0

    with pytest.raises(RecordingError, match="busy for 600 s"):
        check(tmp_path / "none.mcap", supervise)


@pytest.mark.skipif(not hasattr(signal, "SIGXCPU"), reason="POSIX")
def test_the_limit_of_processor_time_is_told_by_its_signal(monkeypatch, tmp_path):
    busy = [sys.executable, "-c", "import os, signal; os.kill(os.getpid(), signal.SIGXCPU)"]
    real = subprocess.Popen
    monkeypatch.setattr("subprocess.Popen", lambda _, **more: real(busy, **more))
    with pytest.raises(RecordingError, match="busy for 60 s"):
        check(tmp_path / "a.mcap")
