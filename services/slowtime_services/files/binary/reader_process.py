"""A process of its own for readers that are compiled and trust the file.

A damaged file can crash such a reader, and what crashes there must not take a server or a
diagnosis with it. The process may take as much memory as it needs for what a file of that size
may hold, processor time in proportion, and two minutes.
"""

import json
import math
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slowtime_services.files.record import RecordError, Values

from .expansion import unpacked_bound
from .numpy_arrays import Arrays

PATIENCE_S = 120.0

REFUSED = 3
"""Exit status of the process where it has said why the file is refused."""

COPIES = 3
"""Of what the file holds: read, flattened and written, each once [1]."""

ROOM_BYTES = 2 * 2**30
"""Address space for the interpreter and its libraries, beside what the file may hold."""

WORK_BYTES = 48 * 2**20
"""Memory that a library writes to beside the samples, such as a workbook's tree [bytes]."""

LEAST_PROCESSOR_S, PROCESSOR_S_PER_MIB = 20.0, 2.0
"""Processor time that a file is given, and for each MiB that it may hold [s]: workbooks, the
slowest, take 0.3 s a MiB on a machine of 2020."""

TOLD = "told"
"""Name in the archive of what is said of the arrays, as JSON."""


def read_matlab(path: Path, max_bytes: int) -> Arrays:
    """All numeric variables; those of a struct as ``struct.field``."""
    names, arrays = run(f"{__package__}.matlab", path, max_bytes, "a MATLAB file")
    return dict(zip(names, arrays, strict=True))


def run(
    module: str, path: Path, max_bytes: int, kind: str, words: Sequence[str] = ()
) -> tuple[Any, list[Values]]:
    """Read a file by ``main(path, max_bytes, out, *words)`` of a module.

    Returns
    -------
    What it says of the arrays it found, and these.

    Raises
    ------
    RecordError
        In its words where it refuses the file; else where it crashed, or took too long.
    """
    with tempfile.TemporaryDirectory() as room:
        out = Path(room) / "found.npz"
        try:
            done = _run(module, [str(path), str(max_bytes), str(out), *words])
        except subprocess.TimeoutExpired as error:
            raise RecordError(
                f"{path.name} has kept its reader busy for {PATIENCE_S:g} s. Save less of it "
                "to a file, or save it as NumPy or text."
            ) from error
        if done.returncode == REFUSED:
            raise RecordError(done.stderr.decode(errors="replace").strip())
        if done.returncode != 0:
            raise RecordError(
                f"{path.name} is {kind} and broke its reader ({_end(done.returncode)}): it is "
                "damaged, or was made to. Save it again, or as NumPy or text."
            )
        with np.load(out, allow_pickle=False) as archive:
            told = json.loads(str(archive[TOLD]))
            return told, [archive[f"array_{i}"] for i in range(len(archive.files) - 1)]


def save(out: str, told: Any, arrays: Sequence[Values]) -> None:
    """Write the results for `run`; called in the reader's process."""
    named = {f"array_{i}": array for i, array in enumerate(arrays)}
    named[TOLD] = np.array(json.dumps(told))
    np.savez(out, allow_pickle=False, **named)


def save_arrays(
    read: Callable[[Path, int], Arrays], path: str, max_bytes: str, out: str
) -> int:
    """Read arrays by name and write them for `run`, or the reason why not; the exit status."""
    try:
        found = read(Path(path), int(max_bytes))
    except RecordError as error:
        sys.stderr.write(f"{error}\n")
        return REFUSED
    save(out, list(found), list(found.values()))
    return 0


def bound_resources(path: Path, max_bytes: int) -> None:
    """Limit memory and time of this process to what a file of that size may need.

    To be called once the library is imported: what it takes then is not counted.
    """
    try:
        import resource
    except ModuleNotFoundError:  # not on every system
        return
    most = unpacked_bound(path.stat().st_size, max_bytes)
    resource.setrlimit(resource.RLIMIT_AS, (ROOM_BYTES + COPIES * most,) * 2)
    if (own := _own_data_bytes()) is not None:
        resource.setrlimit(resource.RLIMIT_DATA, (own + WORK_BYTES + COPIES * most,) * 2)
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = LEAST_PROCESSOR_S + PROCESSOR_S_PER_MIB * (most / 2**20)
    seconds = min(seconds, PATIENCE_S) + used.ru_utime + used.ru_stime
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds),) * 2)


def _own_data_bytes() -> int | None:
    """Memory of this process that is its own and may be written, as Linux tells it [bytes]."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return None
    kib = next((line.split()[1] for line in lines if line.startswith("VmData:")), None)
    return None if kib is None else 1024 * int(kib)


def _run(module: str, words: Sequence[str]) -> "subprocess.CompletedProcess[bytes]":
    command = [sys.executable, "-P", "-W", "ignore", "-m", module, *words]
    return subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)


def _end(status: int) -> str:
    return signal.Signals(-status).name if status < 0 else f"exit status {status}"
