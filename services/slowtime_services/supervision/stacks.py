"""The stacks of all threads of this process, as text."""

import sys
import threading
import traceback


def all_stacks() -> str:
    """Return where each thread is now, the innermost call last."""
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    parts = []
    for ident, frame in sys._current_frames().items():
        where = "".join(traceback.format_stack(frame)).rstrip()
        parts.append(f"Thread {names.get(ident, ident)}:\n{where}")
    return "\n".join(parts)
