"""Frequency responses in universal files: datasets 58 and 58b, functions 2 to 6 and 9.

References
----------
.. [1] Structural Dynamics Research Laboratory, University of Cincinnati, "Universal File
   Datasets: number 58, function at nodal DOF", and 58b, its binary form.
"""

import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slowtime.identification.frequency_response.response import Kind
from slowtime_services.files.formats.universal import MARK
from slowtime_services.files.record import RecordError

from .measured import FrfCurve
from .spectra import PowerSpectrum, curves_of_spectra

GENERAL, TIME, RESPONSE, TRANSMISSIBILITY, COHERENCE = 0, 1, 4, 5, 6
"""Codes of functions [1]_."""
AUTO, CROSS, DENSITY = 2, 3, 9
"""The same of auto-spectra, cross-spectra and power spectral densities of either kind [1]_."""
FORCES = (9, 13)
"""Codes of what an axis tells: reaction and excitation force [1]_."""
MOTIONS: dict[int, Kind] = {8: "displacement", 11: "velocity", 12: "acceleration"}
"""Codes of what an axis tells [1]_."""
_LAYOUT: dict[int, tuple[str, int]] = {2: ("f4", 1), 4: ("f8", 1), 5: ("f4", 2), 6: ("f8", 2)}
"""Type and numbers of each value, by the code of the ordinates [1]_."""
_TEXT_WIDTH = {2: 13, 4: 20, 5: 13, 6: 20}
_HEAD_LINES = 11
_AXES = {1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}
_LINE_MARK = re.compile(rb"^ *-1 *\r?$", re.MULTILINE)
_END_MARK = re.compile(rb"\r?\n? *-1 *(?:\r?\n|$)")
DETAILS = re.compile(
    r"averages=(?P<averages>\d+) window_per_s=(?P<decay>\S+)\s+"
    r"from_hz=(?P<first>\S+) by_hz=(?P<step>\S+)"
)
"""What slowtime writes into the last lines of identification: figures in all digits."""


@dataclasses.dataclass(frozen=True, slots=True)
class _Function:
    """A dataset 58: lines of its heading, and its numbers."""

    head: list[str]
    numbers: np.ndarray
    at: int

    @property
    def code(self) -> int:
        return int(self.head[5][:5])


def curves_of(path: Path, content: bytes) -> tuple[list[FrfCurve], tuple[str, ...]]:
    """Read the frequency responses of a universal file, and notes on the rest.

    Parameters
    ----------
    path
        The file, for messages.
    content
        Its bytes.

    Returns
    -------
    Curves, none where the file holds no frequency response; notes.

    Raises
    ------
    RecordError
        Where a dataset is damaged.
    """
    curves: list[FrfCurve] = []
    coherence: dict[tuple[str, str], np.ndarray] = {}
    autos: list[PowerSpectrum] = []
    crosses: list[PowerSpectrum] = []
    others, timed = 0, False
    for function in _functions(path, content):
        code, form = function.code, int(function.head[6].split()[0])
        whole = form in (5, 6)
        if code in (RESPONSE, TRANSMISSIBILITY) or (code == GENERAL and whole):
            curves.append(_curve(path, function))
        elif code == COHERENCE and not whole:
            of = _curve(path, function)
            coherence[of.output[0], of.input[0]] = of.values.real
        elif code in (AUTO, CROSS, DENSITY):
            is_cross = code == CROSS or (code == DENSITY and whole)
            (crosses if is_cross else autos).append(_spectrum(path, function, is_cross))
        else:
            timed = timed or code == TIME
            others += 1
    if curves:
        others += len(autos) + len(crosses)
    elif not timed:
        return curves_of_spectra(path.name, autos, crosses)
    told = []
    for curve in curves:
        own = coherence.get((curve.output[0], curve.input[0]))
        if own is None:  # the multiple coherence of an output stands once, with one input
            own = next((v for (o, _), v in coherence.items() if o == curve.output[0]), None)
        fits = own is not None and len(own) == len(curve.values)
        told.append(dataclasses.replace(curve, coherence=own if fits else None))
    note = f"{others} datasets that are no frequency responses were left out."
    return told, (note,) * bool(others and curves)


def _functions(path: Path, content: bytes) -> Iterator[_Function]:
    at = 0
    while (mark := _LINE_MARK.search(content, at)) is not None:
        line, start = _line(content, mark.end() + 1)
        kind = line[:6].strip() or line.strip()
        if kind.startswith("58b") or line[:7].strip().startswith("58b"):
            function, at = _binary(path, content, line, start)
            yield function
            continue
        end = _LINE_MARK.search(content, start)
        if end is None:
            raise RecordError(
                f"{path.name} ends within a dataset {kind}: it is cut short. Export it again."
            )
        at = end.end()
        if kind == "58":
            lines = content[start : end.start()].decode("latin-1").splitlines()
            yield _text(path, lines, start)


def _line(content: bytes, at: int) -> tuple[str, int]:
    end = content.find(b"\n", at)
    end = len(content) if end < 0 else end
    return content[at:end].decode("latin-1").rstrip("\r"), end + 1


def _text(path: Path, lines: list[str], at: int) -> _Function:
    head = lines[:_HEAD_LINES]
    form, count, even = _form(path, head, at)
    each = _LAYOUT[form][1] + (not even)
    text = [line for line in lines[_HEAD_LINES:] if line.strip()]
    try:
        words = " ".join(text).replace("D", "E").replace("d", "e").split()
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count * each and even:
        width = _TEXT_WIDTH[form]
        pieces = (
            line[i : i + width] for line in text for i in range(0, len(line.rstrip()), width)
        )
        try:
            values = [float(piece) for piece in pieces if piece.strip()]
        except ValueError:
            values = []
    if len(values) != count * each:
        raise _torn(path, at, count * each, len(values))
    return _Function(head, np.array(values).reshape(count, each), at)


def _binary(path: Path, content: bytes, line: str, start: int) -> tuple[_Function, int]:
    words = line.split()
    order = ">" if words[1:2] == ["2"] else "<"
    head, at = [], start
    for _ in range(_HEAD_LINES):
        text, at = _line(content, at)
        head.append(text)
    form, count, even = _form(path, head, start)
    kind, each = _LAYOUT[form]
    # Frequencies of uneven lines are in single precision [1]_, or as the ordinates are; the
    # number of bytes in the heading is wrong in files of some programs.
    value = f"{order}{kind}"
    layouts = [np.dtype((value, (each + (not even),)))]
    if not even:
        layouts.append(np.dtype([("x", f"{order}f4"), ("y", value, (each,))]))
    for layout in layouts:
        end = at + count * layout.itemsize
        mark = _END_MARK.match(content, end)
        if mark is not None and end <= len(content):
            rows = np.frombuffer(content[at:end], layout)
            if layout.names:
                rows = np.column_stack([rows["x"], rows["y"]])
            return _Function(head, rows.astype(float).reshape(count, -1), start), mark.end()
    raise _torn(path, start, count * each, (len(content) - at) // int(kind[1]))


def _form(path: Path, head: list[str], at: int) -> tuple[int, int, bool]:
    try:
        form, count, spacing = (int(word) for word in head[6].split()[:3])
        int(head[5][:5])
    except (IndexError, ValueError):
        raise _torn(path, at, 0, 0) from None
    if form not in _LAYOUT or not 0 < count < 1 << 28:
        raise _torn(path, at, count, 0)
    return form, count, spacing == 1


def _torn(path: Path, at: int, stated: int, found: int) -> RecordError:
    return RecordError(
        f"The dataset 58 at byte {at} of {path.name} states {stated} numbers and has {found}: "
        "it is cut short, or was changed. Export it again."
    )


def _curve(path: Path, function: _Function) -> FrfCurve:
    head, numbers = function.head, function.numbers
    form, count, even = _form(path, head, function.at)
    details = DETAILS.search(f"{head[3]} {head[4]}") if head[1].strip() == MARK else None
    if even:
        words = head[6].split()
        first, step = float(words[3]), float(words[4])
        if details is not None:
            first, step = float(details["first"]), float(details["step"])
        hz = first + step * np.arange(count)
    else:
        hz, numbers = numbers[:, 0], numbers[:, 1:]
    values = numbers[:, 0] + 1j * numbers[:, 1] if form in (5, 6) else numbers[:, 0] + 0j
    output, driven = _places(head, function.code)
    up, down = _axis(head[8]), _axis(head[9])
    kind = MOTIONS.get(up[0])
    if function.code == TRANSMISSIBILITY or (up[0] in MOTIONS and down[0] in MOTIONS):
        kind = "transmissibility"
    return FrfCurve(
        output=(output, up[1]),
        input=(driven, down[1]),
        frequency_hz=hz,
        values=values,
        kind=kind,
        averages=int(details["averages"]) if details else 0,
        decay_rate=float(details["decay"]) if details else 0.0,
    )


def _spectrum(path: Path, function: _Function, is_cross: bool) -> PowerSpectrum:
    """Return an auto-spectrum, whose reference may not be stated, or a cross-spectrum."""
    curve = _curve(path, function)
    if not is_cross:
        curve = dataclasses.replace(curve, input=curve.output)
    return PowerSpectrum(curve=curve, is_force=_axis(function.head[8])[0] in FORCES)


def _places(head: list[str], code: int) -> tuple[str, str]:
    """Names of output and input: as slowtime writes them, else nodes and directions."""
    first, _, second = head[0].strip().partition(" over ")
    if head[1].strip() == MARK and second:
        return first, second
    line = head[5]
    try:
        places = [int(line[a:b]) for a, b in ((41, 51), (51, 55), (66, 76), (76, 80))]
    except ValueError:
        words = line.split()
        try:
            places = [int(words[k]) for k in (5, 6, 8, 9)]
        except (IndexError, ValueError):
            return head[0].strip() or f"response of function {code}", "input"
    node, axis, driven, of_driven = places
    return (
        f"node {node} {_AXES.get(axis, axis)}",
        f"node {driven} {_AXES.get(of_driven, of_driven)}",
    )


def _axis(line: str) -> tuple[int, str]:
    """Code and unit of an axis [1]_."""
    code = line[:10].strip()
    unit = line[47:67].strip() or (line.split()[-1] if len(line.split()) >= 6 else "")
    return (
        int(code) if code.isdigit() else 0,
        "" if unit.upper() in ("NONE", "") else unit,
    )
