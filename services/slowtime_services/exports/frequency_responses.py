"""Frequency responses as a universal file: a dataset 58 for each pair of output and input.

References
----------
.. [1] Structural Dynamics Research Laboratory, University of Cincinnati, "Universal File
   Datasets: number 58, function at nodal DOF".
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from slowtime.identification.frequency_response.response import FrequencyResponse
from slowtime_services.files import RecordError
from slowtime_services.files.formats.universal import MARK
from slowtime_services.files.units import unit_of
from slowtime_services.modal import Geometry, NodeAxis, places_of

_FREQUENCY_RESPONSE, _COHERENCE = 4, 6
_REAL_DOUBLE, _COMPLEX_DOUBLE = 4, 6
_EVEN, _UNEVEN = 1, 0
_FREQUENCY, _FORCE = 18, 13
"""Codes of functions, ordinates, spacing and axes [1]_."""
_ORDINATES = {"displacement": 8, "velocity": 11, "acceleration": 12}
_A_LINE, _WIDE = 4, 80
_STEADY = 1e-6
"""Relative difference of intervals up to which lines are evenly spaced [1]."""


def write_responses(
    path: Path,
    response: FrequencyResponse,
    outputs: Sequence[tuple[str, str]],
    inputs: Sequence[tuple[str, str]],
    geometry: Geometry | None = None,
) -> int:
    """Write frequency responses and multiple coherences; how many datasets.

    Parameters
    ----------
    path
        File to write.
    response
        Frequency responses.
    outputs, inputs
        Name and unit of each.
    geometry
        Where the channels are.

    Returns
    -------
    Datasets written.
    """
    names = [name for name, _ in (*outputs, *inputs)]
    places = _places(names, geometry)
    lines: list[str] = []
    count = 0
    steps = np.diff(response.frequency_hz)
    details = (
        f"averages={response.averages} window_per_s={float(response.decay_rate)!r}",
        f"from_hz={float(response.frequency_hz[0])!r} by_hz={float(steps.mean())!r}",
    )
    for o, output in enumerate(outputs):
        for i, driven in enumerate(inputs):
            pair = places[o], places[len(outputs) + i]
            values = response.response[:, o, i]
            lines += _dataset(
                _FREQUENCY_RESPONSE,
                response.frequency_hz,
                values,
                (output, driven),
                pair,
                details,
            )
            count += 1
        if np.isfinite(response.coherence[:, o]).all():
            pair = places[o], places[len(outputs)]
            values = response.coherence[:, o]
            lines += _dataset(
                _COHERENCE, response.frequency_hz, values, (output, inputs[0]), pair, details
            )
            count += 1
    path.write_text("".join(f"{line}\n" for line in lines), encoding="ascii", errors="replace")
    return count


def _places(names: Sequence[str], geometry: Geometry | None) -> Sequence[NodeAxis]:
    try:
        return places_of(tuple(names), geometry or Geometry())
    except RecordError:  # two names with one ending: a node each
        return [NodeAxis(number, 1) for number in range(1, len(names) + 1)]


def _dataset(
    function: int,
    frequency_hz: np.ndarray,
    values: np.ndarray,
    pair: tuple[tuple[str, str], tuple[str, str]],
    places: tuple[NodeAxis, NodeAxis],
    details: tuple[str, str],
) -> Iterator[str]:
    (output, unit), (driven, of_input) = pair
    steps = np.diff(frequency_hz)
    even = bool(np.ptp(steps) < _STEADY * steps.mean())
    whole = np.iscomplexobj(values)
    yield from (f"{-1:6d}", f"{58:6d}")
    yield f"{output} over {driven}"[:_WIDE]
    yield MARK
    yield from ("NONE", *details)
    yield (
        f"{function:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{places[0].node:10d}"
        f"{places[0].axis:4d} {'NONE':<10}{places[1].node:10d}{places[1].axis:4d}"
    )
    yield (
        f"{_COMPLEX_DOUBLE if whole else _REAL_DOUBLE:10d}{len(values):10d}"
        f"{_EVEN if even else _UNEVEN:10d}{frequency_hz[0]:13.5E}{steps.mean():13.5E}"
        f"{0.0:13.5E}"
    )
    yield _axis(_FREQUENCY, "Frequency", "Hz")
    known, forced = unit_of(unit, output), unit_of(of_input, driven)
    ratio = function == _COHERENCE
    yield _axis(0 if ratio or known is None else _ORDINATES[known.quantity], "Response", unit)
    yield _axis(
        0 if ratio else _FORCE if forced is None else _ORDINATES[forced.quantity],
        "Input",
        of_input,
    )
    yield _axis(0, "NONE", "NONE")
    yield from _numbers(frequency_hz, values, even)
    yield f"{-1:6d}"


def _numbers(frequency_hz: np.ndarray, values: np.ndarray, even: bool) -> Iterator[str]:
    parts = [values.real, values.imag] if np.iscomplexobj(values) else [values]
    if even:
        flat = np.stack(parts, axis=1).ravel()
        for at in range(0, len(flat), _A_LINE):
            yield "".join(f"{value:20.12E}" for value in flat[at : at + _A_LINE])
        return
    for at, row in enumerate(np.stack(parts, axis=1)):
        yield f"{frequency_hz[at]:13.5E}" + "".join(f"{value:20.12E}" for value in row)


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:<20.20} {unit or 'NONE':<20.20}"
