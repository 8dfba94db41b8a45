"""A twin server whose estimation hangs at one message, in the way that is asked for.

    python -m tests.system.hanging HOW ASSET SEQUENCE ARGUMENTS OF THE COMMAND slowtime ...

HOW is `spin` (interruptible), `hold` (a call that never returns and holds the interpreter's
lock) or `wait` (one that never returns and does not hold it).
"""

import ctypes
import os
import sys
import threading
from collections.abc import Callable
from typing import Any

from slowtime_cli.__main__ import main
from twin_server import estimate as estimators
from twin_server.pipeline.progress import isolation


def spin() -> None:
    while True:
        pass


def hold() -> None:
    # A lock of the C library that is taken twice: no signal ends the second call.
    lock, library = ctypes.create_string_buffer(256), ctypes.PyDLL(None)
    library.pthread_mutex_lock(lock)
    library.pthread_mutex_lock(lock)


def wait() -> None:
    threading.Lock().acquire() and threading.Event().wait()


HOW: dict[str, Callable[[], None]] = {"spin": spin, "hold": hold, "wait": wait}


def install(how: str, asset: str, sequence: int) -> None:
    """Let the estimation of one message hang."""
    as_usual = estimators.estimate

    def estimate(twins: Any, features: Any, *rest: Any) -> Any:
        if any(f.asset == asset and f.sequence == sequence for f in features):
            os.write(2, f"HANGS among {len(features)}\n".encode())
            HOW[how]()
        return as_usual(twins, features, *rest)

    vars(isolation)["estimate"] = estimate


if __name__ == "__main__":
    install(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    main(sys.argv[4:])
