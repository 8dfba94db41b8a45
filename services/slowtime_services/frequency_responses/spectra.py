r"""Frequency responses from auto- and cross-spectra of universal files.

With one force x and responses y, :math:`H_1 = S_{yx} / S_{xx}` and
:math:`\gamma^2 = |S_{yx}|^2 / (S_{xx} S_{yy})`. Cross-spectra of some programs are conjugated:
then what they give answers before the force acts.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from slowtime_services.files.record import RecordError

from .measured import FrfCurve

FORCE_UNITS = ("n", "lbf", "kn", "kgf")
"""Units of forces, as programs write them."""

LEAST_AFTER = 2.0
"""[1] Energy of an impulse response after the force over that before, or the reverse, from
which its direction is told. Source: of noise, halves of a thousand lines differ by a tenth."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PowerSpectrum:
    """An auto- or cross-spectrum.

    Parameters
    ----------
    curve
        Places, lines and values; input and output are the same in an auto-spectrum.
    is_force
        Whether the axis tells a force, of a cross-spectrum at the output.
    """

    curve: FrfCurve
    is_force: bool


def curves_of_spectra(
    file: str, autos: Sequence[PowerSpectrum], crosses: Sequence[PowerSpectrum]
) -> tuple[list[FrfCurve], tuple[str, ...]]:
    """Make frequency responses of cross-spectra with a force and its auto-spectrum.

    Parameters
    ----------
    file
        Name of the file, for messages.
    autos, crosses
        Spectra of the file.

    Returns
    -------
    Curves, none where the file holds no spectra; notes.

    Raises
    ------
    RecordError
        Where spectra tell no frequency response; the text says why and what to give.
    """
    if not autos and not crosses:
        return [], ()
    if not crosses:
        raise RecordError(
            f"{file} holds auto-spectra alone. They have no phases, so they tell neither "
            "shapes nor frequency responses. Export time histories or frequency responses "
            "(functions 1 or 4), or cross-spectra with the force beside its auto-spectrum."
        )
    # Of a driving point, force and motion have one name.
    of_force, of_motion = (
        {one.curve.output[0]: one.curve for one in autos if _has_force(one) is force}
        for force in (True, False)
    )
    references = sorted({one.curve.input[0] for one in crosses})
    forces = [name for name in references if name in of_force]
    if not forces:
        raise RecordError(
            f"{file} holds cross-spectra, but no auto-spectrum of a force that they refer to "
            f"(references: {', '.join(references)}). Spectra of responses alone are averages, "
            "whose errors are not known: export the time histories (function 1); or, of a "
            "test with a measured force, its auto-spectrum too."
        )
    curves = [
        _response(one.curve, of_force[one.curve.input[0]], of_motion)
        for one in crosses
        if one.curve.input[0] in of_force and not _has_force(one)
    ]
    if len(forces) > 1:
        raise RecordError(
            f"{file} holds cross-spectra with several forces ({', '.join(forces)}), "
            "which act together: their responses cannot be told apart from these. Export "
            "frequency responses (function 4), or time histories (function 1)."
        )
    note = (
        f"{len(curves)} frequency responses were made of cross-spectra over the auto-spectrum "
        "of the force (H1)."
    )
    before = sum(_lead(curve) for curve in curves)
    if before:
        curves = [dataclasses.replace(curve, values=curve.values.conj()) for curve in curves]
        note += " Their sign of phase was turned: responses would come before the force."
    return curves, (note,)


def _has_force(one: PowerSpectrum) -> bool:
    unit = one.curve.output[1].lower().replace(" ", "")
    for power in ("^2", "**2", "²", "2/hz", "/hz"):
        unit = unit.replace(power, "")
    return one.is_force or unit in FORCE_UNITS


def _response(cross: FrfCurve, force: FrfCurve, of_motion: Mapping[str, FrfCurve]) -> FrfCurve:
    power = _of(force, cross)
    values = np.divide(cross.values, power, out=np.zeros_like(cross.values), where=power > 0)
    output = of_motion.get(cross.output[0])
    coherence = None
    if output is not None:
        both = power * _of(output, cross)
        square = np.abs(cross.values) ** 2
        coherence = np.divide(square, both, out=np.zeros_like(both), where=both > 0)
        # Of a single average it is 1 in all lines, and says nothing.
        coherence = None if np.all(coherence > 1 - 1e-6) else np.minimum(coherence, 1.0)
    return dataclasses.replace(cross, values=values, coherence=coherence)


def _of(auto: FrfCurve, cross: FrfCurve) -> Float[np.ndarray, " line"]:
    """Auto-spectrum at the lines of a cross-spectrum."""
    if len(auto.values) != len(cross.values):
        raise RecordError(
            f"The auto-spectrum of {auto.output[0]} has {len(auto.values)} lines, the "
            f"cross-spectrum of {cross.output[0]} {len(cross.values)}. Export both alike."
        )
    return np.asarray(auto.values.real)


def _lead(curve: FrfCurve) -> bool:
    """Whether the impulse response lies before the force."""
    values: Complex[np.ndarray, " line"] = curve.values - curve.values.mean()
    energy = np.abs(fft.ifft(values * np.hanning(len(values)))) ** 2
    half = len(energy) // 2
    after, before = float(energy[1:half].sum()), float(energy[half + 1 :].sum())
    return before > LEAST_AFTER * after
