"""A process of its own for readers that are compiled and trust the file.

A damaged file can crash such a reader, and what crashes there must not take a server or a
diagnosis with it. The process may take as much memory as it needs for `max_bytes`, and two
minutes.
"""

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slowtime_services.files.record import RecordError, Values

from .numpy_arrays import Arrays

PATIENCE_S = 120.0

REFUSED = 3
"""Exit status of the process where it has said why the file is refused."""

ROOM_BYTES = 2 * 2**30
"""Address space for the interpreter and its libraries, beside what the file may hold."""

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


def bound_memory(max_bytes: int) -> None:
    """Limit the memory of this process to the needs of a file of `max_bytes`."""
    try:
        import resource
    except ModuleNotFoundError:  # not on every system
        return
    # Read, flattened and written: each once.
    resource.setrlimit(resource.RLIMIT_AS, (ROOM_BYTES + 3 * max_bytes,) * 2)


def _run(module: str, words: Sequence[str]) -> "subprocess.CompletedProcess[bytes]":
    command = [sys.executable, "-P", "-m", module, *words]
    return subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)


def _end(status: int) -> str:
    return signal.Signals(-status).name if status < 0 else f"exit status {status}"
