"""Limit the memory of a command that is given as arguments, after the limit in MiB."""

import os
import sys
from collections.abc import Sequence

MEBIBYTE = 1 << 20


def limit_memory(mebibytes: int) -> bool:
    """Limit what this process, and those that it becomes, may allocate.

    Parameters
    ----------
    mebibytes
        [MiB] Data, which on Linux are all private pages that can be written.

    Returns
    -------
    Whether the system has such a limit.
    """
    try:
        import resource
    except ModuleNotFoundError:
        return False
    limit = mebibytes * MEBIBYTE
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    return True


def main(arguments: Sequence[str]) -> None:
    """Limit the memory, and become the command."""
    mebibytes, *command = arguments
    limit_memory(int(mebibytes))
    os.execvp(command[0], command)


if __name__ == "__main__":
    main(sys.argv[1:])
