"""MATLAB files, read in a process of their own: their readers are compiled and trust the file.

A damaged file of version 5 can crash SciPy's reader, and what crashes there must not take a
server or a diagnosis with it. The process may take as much memory as it needs for `max_bytes`,
and two minutes.
"""

import json
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from .arrays import Arrays
from .record import RecordError

PATIENCE_S = 120.0

REFUSED = 3
"""Exit status of the process where it has said why the file is refused."""


def read_matlab(path: Path, max_bytes: int) -> Arrays:
    """All numeric variables; those of a struct as ``struct.field``."""
    with tempfile.TemporaryDirectory() as room:
        out = Path(room) / "found.npz"
        try:
            done = _run(path, max_bytes, out)
        except subprocess.TimeoutExpired as error:
            raise RecordError(
                f"{path.name} has kept its reader busy for {PATIENCE_S:g} s. Save less of it "
                "to a file, or save it as NumPy or text."
            ) from error
        if done.returncode == REFUSED:
            raise RecordError(done.stderr.decode(errors="replace").strip())
        if done.returncode != 0:
            raise RecordError(
                f"{path.name} broke the reader of MATLAB files ({_end(done.returncode)}): it "
                "is damaged, or was made to. Save it anew, or as NumPy or text."
            )
        with np.load(out, allow_pickle=False) as archive:
            names = json.loads(str(archive["names"]))
            return {name: archive[f"array_{i}"] for i, name in enumerate(names)}


def _run(path: Path, max_bytes: int, out: Path) -> "subprocess.CompletedProcess[bytes]":
    module = f"{__package__}.matlab"
    command = [sys.executable, "-P", "-m", module, str(path), str(max_bytes), str(out)]
    return subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)


def _end(status: int) -> str:
    return signal.Signals(-status).name if status < 0 else f"exit status {status}"
