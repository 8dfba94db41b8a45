"""Recognition of files of frequency responses, and their reading."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slowtime.identification.frequency_response.response import Kind
from slowtime_services.documents.bounds import DATA
from slowtime_services.documents.json_documents import read_json
from slowtime_services.files.binary import workbook
from slowtime_services.files.binary.numpy_arrays import Arrays, read_npz
from slowtime_services.files.binary.reader_process import read_matlab, run
from slowtime_services.files.delimited.encoding import decode
from slowtime_services.files.record import RecordError

from . import universal
from .arrays import curves_of_arrays, holds_complex
from .measured import FrfCurve, MeasuredResponses, joined
from .tables import curves_of_table, looks_like_responses, read_table

MOST_BYTES = 256 << 20
"""[bytes] Of a file. Source: a thousand pairs of ten thousand lines as text."""
HEAD_BYTES = 1 << 16
"""[bytes] Of a text, of which it is told what it holds."""
UNIVERSAL = (".uff", ".unv", ".58", ".bunv")
HDF5 = (".h5", ".hdf5", ".hdf")
OTHERS = (".mcap", ".npy", ".wav", ".tdms", ".parquet", ".mseed", ".sac", ".gcf", ".lvm")
"""Endings of records in time that are not looked into."""
JSON_MARK = "slowtime_frequency_responses"


def read_responses(path: Path, kind: Kind | None = None) -> MeasuredResponses | None:
    """Read a file of measured frequency responses.

    Parameters
    ----------
    path
        Universal file (58, 58b), text or workbook of complex numbers or of their parts, NumPy
        archive, MATLAB or HDF5 file of complex arrays, or JSON that slowtime wrote.
    kind
        Quantity of the outputs per force, where a person states it: the file is then refused
        if it holds none.

    Returns
    -------
    The frequency responses; None where the file holds none and `kind` is None.

    Raises
    ------
    RecordError
        Where the file is damaged, or may be read in several ways.
    """
    ending = path.suffix.lower()
    if kind is None and ending in OTHERS:
        return None
    size = path.stat().st_size
    if size > MOST_BYTES:
        if kind is None:
            return None
        raise RecordError(
            f"{path.name} has {size >> 20} MiB; frequency responses of at most "
            f"{MOST_BYTES >> 20} MiB are read. Give fewer lines or pairs."
        )
    if ending in UNIVERSAL:
        curves, notes = universal.curves_of(path, path.read_bytes())
    elif ending in (".npz", ".mat", *HDF5):
        curves, notes = _of_arrays(path, kind), ()
    elif ending == ".json":
        curves, kind = _of_json(path, kind)
        notes = ()
    else:
        curves, notes = _of_text(path, kind)
    if curves:
        return joined(path.name, curves, kind, notes)
    if kind is None:
        return None
    raise RecordError(
        f"{path.name} holds no frequency responses. Give functions of type 4 in a universal "
        "file, or complex numbers over frequencies (docs/modal_testing.md)."
    )


def _of_arrays(path: Path, kind: Kind | None) -> list[FrfCurve]:
    ending = path.suffix.lower()
    arrays: Arrays
    if ending == ".npz":
        arrays = read_npz(path, MOST_BYTES)
    elif ending == ".mat":
        arrays = read_matlab(path, MOST_BYTES)
    else:
        names, found = run(f"{__package__}.arrays", path, MOST_BYTES, "an HDF5 file")
        arrays = dict(zip(names, found, strict=True))
    if kind is None and not holds_complex(arrays):
        return []
    return curves_of_arrays(path.name, arrays)


def _of_text(path: Path, kind: Kind | None) -> tuple[list[FrfCurve], tuple[str, ...]]:
    if path.suffix.lower() in workbook.SUFFIXES:
        lines, _ = workbook.lines_of(path, MOST_BYTES)
    else:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if b"\0" in head and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
            return [], ()
        if kind is None:
            begins = read_table(head.decode("latin-1").splitlines()[:-1] or [""])
            whole = len(head) < HEAD_BYTES
            if not whole and (begins is None or not looks_like_responses(begins)):
                return [], ()
        lines = decode(path).splitlines()
    table = read_table(lines)
    if table is None or (kind is None and not looks_like_responses(table)):
        return [], ()
    return curves_of_table(path.name, table)


def _of_json(path: Path, kind: Kind | None) -> tuple[list[FrfCurve], Kind | None]:
    try:
        body = read_json(path.read_bytes(), DATA)
    except ValueError:
        return [], kind
    if not isinstance(body, dict) or JSON_MARK not in body:
        return [], kind
    try:
        return _curves_of_body(body), kind or body["kind"]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise RecordError(
            f"{path.name} is a file of frequency responses that lacks or garbles a field "
            f"({error}). Write it again with --frf."
        ) from error


def _curves_of_body(body: Mapping[str, Any]) -> list[FrfCurve]:
    hz = np.array(body["frequency_hz"], dtype=float)
    values = np.array(body["response"]["re"]) + 1j * np.array(body["response"]["im"])
    sd = np.array(body["sd"], dtype=float)
    coherence = np.array(body["coherence"], dtype=float)
    shape = (len(hz), len(body["outputs"]), len(body["inputs"]))
    if values.shape != shape or sd.shape != shape or coherence.shape != shape[:2]:
        raise ValueError(f"shape {values.shape}, expected {shape}")
    return [
        FrfCurve(
            output=(out["channel"], out["unit"]),
            input=(driven["channel"], driven["unit"]),
            frequency_hz=hz,
            values=values[:, o, i],
            sd=sd[:, o, i],
            coherence=coherence[:, o],
            averages=int(body["averages"]),
            decay_rate=float(body["exponential_window_per_s"]),
        )
        for o, out in enumerate(body["outputs"])
        for i, driven in enumerate(body["inputs"])
    ]
