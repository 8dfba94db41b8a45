"""Threads that change turns at each line of the code under test."""

import sys
import threading
import time
from collections.abc import Callable
from types import FrameType, ModuleType
from typing import Any


def run_interleaved(module: ModuleType, *works: Callable[[], None]) -> None:
    """Run each work in a thread; let others run between the lines of a module.

    Raises
    ------
    Exception
        The first that a work has raised.
    """
    raised: list[BaseException] = []

    def at_line(frame: FrameType, event: str, arg: Any) -> Any:
        if frame.f_code.co_filename != module.__file__:
            return None
        if event == "line":
            time.sleep(1e-5)
        return at_line

    def run(work: Callable[[], None]) -> None:
        sys.settrace(at_line)
        try:
            work()
        except BaseException as error:
            raised.append(error)
        finally:
            sys.settrace(None)

    threads = [threading.Thread(target=run, args=(work,)) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if raised:
        raise raised[0]
