"""Cost of a command: processor time and peak memory of its whole tree of processes.

Run as a program it is a small process between the tests and the command, because the peak
memory that Linux reports of a child begins at that of the process that started it.
"""

import dataclasses
import json
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

PATIENCE_S = 200.0
"""After which a command is ended and called too long [s]."""


@dataclasses.dataclass(frozen=True)
class Cost:
    """What a command said and took.

    Parameters
    ----------
    processor_s
        Of all its processes [s].
    peak_mib
        Largest of its processes' peak resident memories [MiB].
    """

    status: int
    said: str
    processor_s: float
    peak_mib: float


def cost_of(command: Sequence[str], folder: Path) -> Cost:
    """Run a command of slowtime in a folder."""
    meter = [sys.executable, str(Path(__file__)), *command]
    done = subprocess.run(
        meter, cwd=folder, capture_output=True, text=True, errors="replace", check=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    return Cost(**json.loads(done.stdout))


def _metered(command: Sequence[str]) -> dict[str, object]:
    with subprocess.Popen(
        [sys.executable, "-m", "slowtime_cli", *command],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    ) as process:  # fmt: skip
        end = threading.Timer(PATIENCE_S, process.kill)
        end.start()
        assert process.stdout is not None
        said = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        end.cancel()
    return {
        "status": process.returncode,
        "said": said.decode(errors="replace"),
        "processor_s": usage.ru_utime + usage.ru_stime,
        "peak_mib": usage.ru_maxrss / 1024,
    }


if __name__ == "__main__":
    print(json.dumps(_metered(sys.argv[1:])))
