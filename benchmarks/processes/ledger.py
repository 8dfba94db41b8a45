"""What the ledger costs: `python -m benchmarks.processes.ledger [--readings 200000]`.

Writing, as a ratio to the same cuts without a ledger, in turn, each to a file of its own; the
disk is waited for in both. Verifying, as a ratio to reading and hashing the same rows once.
"""

import argparse
import contextlib
import hashlib
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np

from twin_server.history.states import blank
from twin_server.persist import FeatureRow, RunRow, SqliteStore, TwinRow, WriteBatch, audit_file
from twin_server.persist.chains import Journal
from twin_server.persist.sqlite import open_reader
from twin_server.persist.tables.ledger import ChainEnds

MOST_OF_WRITING = 1.10
MOST_OF_READING = 7.0
"""Messages, states and buckets are read, and the buckets computed again; measured 5 to 6."""
_A_CUT = 100
_MESSAGE = b"m" * 900
"""As long as the features of one mode are."""


def fill(path: Path, readings: int) -> float:
    """Write a history; give the processor and disk time that took [s]."""
    states = blank(readings)
    states["sequence"] = np.arange(readings)
    states["t_ns"] = np.arange(readings) * 10**9
    states["slow_time"] = np.arange(readings)
    with contextlib.closing(SqliteStore(path, verify=False)) as store:
        store.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", "{}")]))
        began = time.perf_counter()
        for first in range(0, readings, _A_CUT):
            part = states[first : first + _A_CUT]
            last = first + len(part) - 1
            run = RunRow(
                1, "lab", "beam", "b1", "d", last + 1, last, last * 10**9, last, False, "[]"
            )
            rows = [
                FeatureRow(1, n, n * 10**9, float(n), b"%d " % n + _MESSAGE, state.tobytes())
                for n, state in zip(range(first, last + 1), part, strict=True)
            ]
            store.write(WriteBatch(runs=[run], features=rows))
        return time.perf_counter() - began


def without(readings: int, path: Path) -> float:
    """Write the same without a ledger."""
    with contextlib.ExitStack() as patches:
        patches.enter_context(mock.patch.object(ChainEnds, "append", return_value=None))
        for name in ("add", "put", "put_states", "remove"):
            patches.enter_context(mock.patch.object(Journal, name, return_value=None))
        return fill(path, readings)


def timed(work: Callable[[], object]) -> float:
    """Seconds that something takes."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def hashed(path: Path) -> str:
    """Read all features, and hash what they say."""
    found = hashlib.sha256()
    with contextlib.closing(open_reader(path)) as reader:
        for row in reader.execute("select id, message, state from features order by id"):
            found.update(row[1] + row[2])
    return found.hexdigest()


def main(arguments: list[str] | None = None) -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--readings", type=int, default=50_000)
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args(arguments)
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(asked.rounds):
            plain = without(asked.readings, Path(folder) / f"plain-{turn}.sqlite")
            ratios.append(fill(Path(folder) / f"chained-{turn}.sqlite", asked.readings) / plain)
        path = Path(folder) / "chained-0.sqlite"
        verifying = [
            timed(lambda: audit_file(path)) / timed(lambda: hashed(path))
            for _ in range(asked.rounds)
        ]
    writing, reading = statistics.median(ratios), statistics.median(verifying)
    print(f"{asked.readings:,} readings, median of {asked.rounds} rounds")
    print(
        f"writing over the same without a ledger    {writing:.3f}   at most {MOST_OF_WRITING}"
    )
    print(
        f"verifying over reading and hashing once   {reading:.2f}    at most {MOST_OF_READING}"
    )


if __name__ == "__main__":
    main()
