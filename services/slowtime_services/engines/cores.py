"""How many cores this process may use."""

import os


def usable_cores() -> int:
    """Count the cores that this process may run on, at least 1.

    A container, a batch system or `taskset` may allow fewer than the machine has.
    """
    if hasattr(os, "sched_getaffinity"):  # Linux
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
