"""The process of one diagnosis: reads the task in a folder, and writes the outcome beside it.

How far it has come goes to standard output, a line of JSON at a time; so does why there is
nothing to find, with exit status 1. The end of standard input means to stop.
"""

import contextlib
import faulthandler
import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from slowtime.discrepancy.progress import Cancelled
from slowtime_services.operating_system import end_with_parent, lower_priority
from slowtime_services.plugins.discovery import exception_text

from .history_diagnosis import diagnose_history
from .plugin_effects import diagnose_with_plugins
from .samples_diagnosis import diagnose_samples
from .task import TASK, Task

GRACE_S = 1.0
"""For a stage to end once it is told to stop."""

_TOLD_EVERY_S = 0.1
"""Interval at which progress is reported, at least [s]."""


class _ProgressReporter:
    """Reports progress, a few times a second at most."""

    def __init__(self) -> None:
        self._told_s = 0.0
        self._out = os.fdopen(os.dup(1), "w")
        # Output of a user's effect must not be read as progress.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)

    def progress(self, stage: str, share: float) -> None:
        if time.monotonic() - self._told_s >= _TOLD_EVERY_S:
            self._told_s = time.monotonic()
            self.say({"stage": stage, "share": round(share, 4)})

    def say(self, content: dict[str, Any]) -> None:
        # Nobody may be listening any more.
        with contextlib.suppress(OSError):
            self._out.write(json.dumps(content) + "\n")
            self._out.flush()


def _watch_input(stop: threading.Event) -> None:
    """Wait for the end of standard input; then stop, gently and soon after for good."""
    while os.read(sys.stdin.fileno(), 4096):
        pass
    stop.set()
    time.sleep(GRACE_S)
    os._exit(3)


def _bound_memory(more: int) -> None:
    """Limit the memory of this process to `more` bytes beyond its present use."""
    try:
        import resource
    except ModuleNotFoundError:  # not on every system
        return
    limit = more
    with contextlib.suppress(OSError, StopIteration, ValueError):
        status = Path("/proc/self/status").read_text()
        line = next(row for row in status.splitlines() if row.startswith("VmData"))
        limit += int(line.split()[1]) * 1024
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))


def main(folder: Path) -> int:
    """Run the diagnosis; exit status 0 if done, 1 if something is missing, 3 if stopped."""
    task, reporter = Task.model_validate_json((folder / TASK).read_bytes()), _ProgressReporter()
    end_with_parent()
    stop = threading.Event()
    threading.Thread(target=_watch_input, args=(stop,), daemon=True).start()
    if task.is_attempt:
        # By a thread that needs no interpreter lock, which a law that hangs would keep.
        faulthandler.dump_traceback_later(task.max_own_s, exit=True)
    else:
        lower_priority(10)
        if task.effects and task.order.clock == "fast":
            tried = diagnose_with_plugins(task, folder, reporter.say, stop)
            if tried.done:
                return 0
            if tried.error:
                reporter.say({"error": tried.error})
                return 1
            task = tried.task
    _bound_memory(task.max_memory_bytes)
    work: Callable[..., None] = (
        diagnose_history if task.order.clock == "slow" else diagnose_samples
    )
    try:
        work(task, folder, reporter.progress, stop)
    except Cancelled:
        return 3
    except MemoryError:
        reporter.say(
            {
                "error": f"{task.max_memory_bytes:,} bytes of memory did not suffice. Give "
                "fewer samples, or raise diagnose.max_memory_bytes."
            }
        )
        return 1
    except (ValueError, OSError) as error:
        reporter.say({"error": str(error)})
        return 1
    except Exception as error:
        if not task.is_attempt:
            raise
        # Whatever an effect of one's own raises is its own fault, until the other one raises.
        traceback.print_exc()
        reporter.say({"error": f"{exception_text(error)}."})
        return 1
    return 0


if __name__ == "__main__":
    status = main(Path(sys.argv[1]))
    sys.stdout.flush()
    # The thread that reads standard input would be waited for.
    os._exit(status)
