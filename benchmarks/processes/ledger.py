"""What the ledger costs: `python -m benchmarks.processes.ledger [--readings 200000]`.

Writing, as a ratio to the same cuts without a ledger, in turn, each to a file of its own.
Verifying, as a ratio to reading and hashing the same rows once. The least of several rounds is
compared, which other work of the machine disturbs least.
"""

import argparse
import contextlib
import hashlib
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Self
from unittest import mock

import numpy as np

from twin_server.history.states import blank
from twin_server.persist import FeatureRow, RunRow, SqliteStore, TwinRow, WriteBatch, audit_file
from twin_server.persist.chains import Journal
from twin_server.persist.sqlite import open_reader
from twin_server.persist.tables.ledger import ChainEnds

MOST_OF_WRITING = 1.25
"""Of processor time; measured 1.15 and 1.16. Half of it is SHA-256 of messages and states."""
MOST_OF_READING = 7.0
"""Of processor time; measured 5.9 and 6.6. Rows are read three times (messages, states, states
for the buckets), each is hashed by itself, and buckets are computed again."""


class Spent(NamedTuple):
    """Time of the clock and of the processor [s]."""

    clock: float
    processor: float

    @classmethod
    def so_far(cls) -> Self:
        """Return the time until now, from some moment on."""
        return cls(time.perf_counter(), time.process_time())

    def until_now(self) -> Self:
        """Return the time since this one."""
        now = self.so_far()
        return type(self)(*(end - begin for end, begin in zip(now, self, strict=True)))


_A_CUT = 100
_MESSAGE = b"m" * 900
"""As long as the features of one mode are."""


def fill(path: Path, readings: int) -> Spent:
    """Write a history; return what that took, the disk's part in the time of the clock."""
    states = blank(readings)
    states["sequence"] = np.arange(readings)
    states["t_ns"] = np.arange(readings) * 10**9
    states["slow_time"] = np.arange(readings)
    with contextlib.closing(SqliteStore(path, verify=False)) as store:
        store.write(WriteBatch(twins=[TwinRow("lab", "beam", "{}", "{}")]))
        began = Spent.so_far()
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
        return began.until_now()


def without(readings: int, path: Path) -> Spent:
    """Write the same without a ledger."""
    with contextlib.ExitStack() as patches:
        patches.enter_context(mock.patch.object(ChainEnds, "append", return_value=None))
        for name in ("add", "put", "put_states", "remove"):
            patches.enter_context(mock.patch.object(Journal, name, return_value=None))
        return fill(path, readings)


def timed(work: Callable[[], object]) -> Spent:
    """Do something, and return what that took."""
    began = Spent.so_far()
    work()
    return began.until_now()


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
    with tempfile.TemporaryDirectory() as folder:
        plain, chained = [], []
        for turn in range(asked.rounds):
            plain.append(without(asked.readings, Path(folder) / f"plain-{turn}.sqlite"))
            chained.append(fill(Path(folder) / f"chained-{turn}.sqlite", asked.readings))
        path = Path(folder) / "chained-0.sqlite"
        hashing = [timed(lambda: hashed(path)) for _ in range(asked.rounds)]
        auditing = [timed(lambda: audit_file(path)) for _ in range(asked.rounds)]
    print(f"{asked.readings:,} readings, least of {asked.rounds} rounds")
    for what, some, over, most in (
        ("writing over the same without a ledger", chained, plain, MOST_OF_WRITING),
        ("verifying over reading and hashing once", auditing, hashing, MOST_OF_READING),
    ):
        clock, processor = (
            min(one[k] for one in some) / min(one[k] for one in over) for k in (0, 1)
        )
        print(
            f"{what:40} processor time {processor:.2f}, at most {most}; "
            f"of the clock {clock:.2f}"
        )


if __name__ == "__main__":
    main()
