"""Measured frequency responses: curves of pairs of output and input, joined to a matrix."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.frequency_response.response import FrequencyResponse, Kind
from slowtime_services.files.record import RecordError
from slowtime_services.files.units import unit_of

SAME_LINES = 1e-6
"""Relative difference of frequencies [1] up to which lines are the same. Source: single
precision, in which universal files state their interval."""
LEAST_LINES = 8
"""[lines] Of a frequency response. Source: fewer hold no pole and residues."""

Channel = tuple[str, str]
"""Name and unit."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrfCurve:
    """A frequency response of one output to one input.

    Parameters
    ----------
    output, input
        Name and unit of each.
    frequency_hz
        Lines [Hz].
    values
        Unit of the output per unit of the input.
    sd
        Standard deviation of their complex errors; None where it is not stated.
    coherence
        With the input, or with all inputs; None where it is not stated.
    kind
        What it is, as the file states it; None where it does not.
    averages
        Blocks that were averaged; 0 where that is not stated.
    decay_rate
        Of an exponential window [1/s].
    """

    output: Channel
    input: Channel
    frequency_hz: Float[np.ndarray, " line"]
    values: Complex[np.ndarray, " line"]
    sd: Float[np.ndarray, " line"] | None = None
    coherence: Float[np.ndarray, " line"] | None = None
    kind: Kind | None = None
    averages: int = 0
    decay_rate: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredResponses:
    """A matrix of frequency responses, with what was assumed of it.

    Parameters
    ----------
    response
        The frequency responses; in SI where the units of outputs are known.
    outputs, inputs
        Name and unit of each.
    notes
        Sentences on how the file was read.
    """

    response: FrequencyResponse
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    notes: tuple[str, ...] = ()


def joined(
    file: str, curves: Sequence[FrfCurve], kind: Kind | None, notes: Sequence[str] = ()
) -> MeasuredResponses:
    """Join curves to a matrix.

    Parameters
    ----------
    file
        Name of the file, for messages.
    curves
        At least one; a pair that stands several times is taken once.
    kind
        What a person says they are; None for what the file says.
    notes
        Of the reader.

    Raises
    ------
    RecordError
        Where lines differ or are no axis of frequencies, or values are not finite.
    """
    said = list(notes)
    of_pair = {(curve.output[0], curve.input[0]): curve for curve in curves}
    if len(of_pair) < len(curves):
        said.append(
            f"{len(curves) - len(of_pair)} of {len(curves)} frequency responses are of a pair "
            "that stands again; the last one of each is used."
        )
    outputs, inputs = _whole_matrix(list(of_pair), said)
    matrix = [[of_pair[o, i] for i in inputs] for o in outputs]
    first = matrix[0][0]
    kept = _lines(file, [curve for row in matrix for curve in row])
    values = np.array([[c.values[kept] for c in row] for row in matrix]).transpose(2, 0, 1)
    if not np.isfinite(values).all():
        raise RecordError(
            f"{file} holds frequency responses that are not finite. Leave these lines out."
        )
    found = _kind(matrix, kind, said)
    response = FrequencyResponse(
        frequency_hz=first.frequency_hz[kept],
        response=values,
        sd=_errors(matrix, kept, values),
        coherence=_coherence(matrix, kept),
        averages=first.averages,
        kind=found,
        decay_rate=first.decay_rate,
    )
    channels = tuple(row[0].output for row in matrix), tuple(c.input for c in matrix[0])
    scaled = _in_si(response, *channels)
    if len(inputs) > len(outputs) and found != "transmissibility":
        scaled = _transposed(scaled)
        said.append(
            f"{len(inputs)} inputs and {len(outputs)} output: by reciprocity, shapes are over "
            "the points of the inputs."
        )
    return dataclasses.replace(scaled, notes=tuple(said))


def _whole_matrix(
    pairs: Sequence[tuple[str, str]], said: list[str]
) -> tuple[list[str], list[str]]:
    """Return outputs and inputs of the largest part of which every pair was measured."""
    inputs = list(dict.fromkeys(i for _, i in pairs))
    outputs = list(dict.fromkeys(o for o, _ in pairs))
    of_input = {i: {o for o, one in pairs if one == i} for i in inputs}
    best: tuple[list[str], list[str]] = ([], [])
    for common in of_input.values():
        whole = [i for i in inputs if common <= of_input[i]]
        if len(whole) * len(common) > len(best[0]) * len(best[1]):
            best = [o for o in outputs if o in common], whole
    left = len(pairs) - len(best[0]) * len(best[1])
    if left:
        said.append(
            f"{left} of {len(pairs)} frequency responses left out: every pair of the outputs "
            f"{', '.join(best[0])} and the inputs {', '.join(best[1])} was measured, and not "
            "of the others."
        )
    return best


def _lines(file: str, curves: Sequence[FrfCurve]) -> np.ndarray:
    """Tell which lines are kept: all but 0, which is none of a motion."""
    hz = curves[0].frequency_hz
    for curve in curves:
        if len(curve.frequency_hz) != len(hz) or not np.allclose(
            curve.frequency_hz, hz, rtol=SAME_LINES, atol=SAME_LINES * abs(hz[-1])
        ):
            raise RecordError(
                f"{file}: {curve.output[0]} over {curve.input[0]} has "
                f"{len(curve.frequency_hz)} lines to {curve.frequency_hz[-1]:g} Hz, "
                f"{curves[0].output[0]} over {curves[0].input[0]} {len(hz)} to {hz[-1]:g} Hz. "
                "Give a file for each, or the same lines in all (of hammer tests: the same "
                "--setting block_s)."
            )
    kept = np.asarray(hz > 0)
    if kept.sum() < LEAST_LINES or not (np.diff(hz) > 0).all():
        raise RecordError(
            f"{file} has no axis of at least {LEAST_LINES} rising frequencies from 0 Hz on "
            f"({len(hz)} values from {hz[0]:g} to {hz[-1]:g}). Give one in Hz."
        )
    return kept


def _kind(matrix: Sequence[Sequence[FrfCurve]], given: Kind | None, said: list[str]) -> Kind:
    stated: set[Kind] = {c.kind for row in matrix for c in row if c.kind is not None}
    by_unit: set[Kind] = {
        unit.quantity
        for row in matrix
        for c in row
        if (unit := unit_of(c.output[1])) is not None
    }
    for kinds in (stated, by_unit):
        if given is None and len(kinds) > 1:
            several = ", ".join(map(str, kinds))
            raise RecordError(
                f"Frequency responses are of several quantities ({several}). Give a "
                "file for each, or state one with --setting frf_kind."
            )
        if given is None and kinds:
            return next(iter(kinds))
    if given is None:
        said.append(
            "frequency responses are treated as accelerations per force, because the file does "
            "not say. --setting frf_kind states another quantity."
        )
    return given or "acceleration"


def _errors(
    matrix: Sequence[Sequence[FrfCurve]], kept: np.ndarray, values: np.ndarray
) -> Float[np.ndarray, "line output input"]:
    r"""Return standard deviations as stated, else by coherence and averages of one input.

    With one input, :math:`\sigma^2 = |H|^2 (1 - \gamma^2) / (\gamma^2 (K - 1))`.
    """
    found = np.full(values.shape, np.nan)
    for o, row in enumerate(matrix):
        for i, curve in enumerate(row):
            if curve.sd is not None:
                found[:, o, i] = curve.sd[kept]
            elif curve.coherence is not None and curve.averages > 1 and len(row) == 1:
                share = np.clip(curve.coherence[kept], 1e-6, 1.0 - 1e-9)
                noise = (1 - share) / (share * (curve.averages - 1))
                found[:, o, i] = np.abs(values[:, o, i]) * np.sqrt(noise)
    return found


def _coherence(
    matrix: Sequence[Sequence[FrfCurve]], kept: np.ndarray
) -> Float[np.ndarray, "line output"]:
    """Coherence of each output; the least of its inputs, where each has its own."""
    missing = np.full(len(kept), np.nan)
    columns = [
        np.min([missing if c.coherence is None else c.coherence for c in row], axis=0)
        for row in matrix
    ]
    return np.asarray(np.column_stack(columns)[kept])


def _in_si(
    response: FrequencyResponse, outputs: tuple[Channel, ...], inputs: tuple[Channel, ...]
) -> MeasuredResponses:
    """Scale outputs, and inputs that are motions, to SI."""
    si = {"acceleration": "m/s^2", "velocity": "m/s", "displacement": "m"}
    known = [unit_of(unit, name) for name, unit in outputs]
    driven = [unit_of(unit, name) for name, unit in inputs]
    up = np.array([1.0 if unit is None else unit.factor for unit in known])
    down = np.array([1.0 if unit is None else unit.factor for unit in driven])
    scale = up[:, None] / down
    named = [
        tuple(
            (name, unit if one is None else si[one.quantity])
            for (name, unit), one in zip(channels, units, strict=True)
        )
        for channels, units in ((outputs, known), (inputs, driven))
    ]
    scaled = dataclasses.replace(
        response, response=response.response * scale, sd=response.sd * scale
    )
    return MeasuredResponses(response=scaled, outputs=named[0], inputs=named[1])


def _transposed(given: MeasuredResponses) -> MeasuredResponses:
    """Exchange outputs and inputs, which reciprocity allows of motion per force."""
    response = given.response
    lines, _, inputs = response.response.shape
    return MeasuredResponses(
        response=dataclasses.replace(
            response,
            response=response.response.transpose(0, 2, 1),
            sd=response.sd.transpose(0, 2, 1),
            coherence=np.full((lines, inputs), np.nan),
        ),
        outputs=given.inputs,
        inputs=given.outputs,
    )
