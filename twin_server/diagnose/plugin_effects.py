"""Runs a diagnosis with plug-in effects in a process that can be ended.

Each installed part is tried in a process of its own, and left out where it fails. A diagnosis
with those that passed is made in another process, a part of the time long; where it ends
without a report, it is made again without them, and the report says so.
"""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from slowtime.dynamics.effects import catalogue
from slowtime_services.plugins.installed_effects import sound_parts

from .task import REPORT, Task, write_task

LOOK_S = 0.1
"""Interval at which the process is looked at [s]."""


class PluginRun(NamedTuple):
    """Result of a diagnosis with plug-in effects.

    Parameters
    ----------
    done
        Whether its files are there.
    task
        What is left to do without them, where it is not.
    error
        Why nothing is left to do.
    """

    done: bool
    task: Task
    error: str = ""


def diagnose_with_plugins(
    task: Task, folder: Path, say: Callable[[dict[str, Any]], None], stop: threading.Event
) -> PluginRun:
    """Make a diagnosis with its own effects, in a process that may be ended.

    Parameters
    ----------
    say
        Told how far that has come.
    """
    names, notes = sound_parts(task.effects)
    if names and not stop.is_set():
        tried = {"effects": names, "notes": notes, "is_attempt": True}
        write_task(folder, task.model_copy(update=tried))
        why = _why_not(task, folder, say, stop)
        if not why:
            return PluginRun(True, task)
        whose = f"No diagnosis was made with the plug-in effects of {', '.join(names)}"
        notes = (*notes, f"{whose}: {why} They were left out.")
    missing = _missing(task)
    error = f"{' '.join(notes)} The model itself has {missing}." if missing else ""
    return PluginRun(False, task.model_copy(update={"effects": (), "notes": notes}), error)


def _why_not(
    task: Task, folder: Path, say: Callable[[dict[str, Any]], None], stop: threading.Event
) -> str:
    """Run the process; why it has made no diagnosis, or nothing where it has."""
    began_s = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", __package__, str(folder)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    errors: list[str] = []
    reader = threading.Thread(target=_listen, args=(process, say, errors), daemon=True)
    reader.start()
    while process.poll() is None and not stop.wait(LOOK_S):
        pass
    process.kill()
    process.wait()
    reader.join()
    for pipe in (process.stdin, process.stdout):
        assert pipe is not None
        pipe.close()
    if stop.is_set():
        return "it was stopped."
    if process.returncode == 0 and (folder / REPORT).exists():
        return ""
    if errors:
        return errors[-1]
    if time.monotonic() - began_s >= task.max_own_s:
        return f"it took longer than {task.max_own_s:g} s, half of diagnose.max_s."
    return (
        f"its process ended with status {process.returncode}; see the server's log for details."
    )


def _listen(
    process: "subprocess.Popen[bytes]",
    say: Callable[[dict[str, Any]], None],
    errors: list[str],
) -> None:
    """Pass on how far it has come; keep why there is nothing."""
    assert process.stdout is not None
    for line in process.stdout:
        content = json.loads(line)
        if "error" in content:
            errors.append(str(content["error"]))
        else:
            say(content)


def _missing(task: Task) -> str:
    """Effects of the model that are not there without the parts."""
    used = () if task.model is None else task.model.effects
    return ", ".join(sorted({entry.effect for entry in used} - catalogue().keys()))
