"""Stiffness that varies with time: jump, drift, parametric excitation."""

import math
from typing import Any

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Shape

from .parameter_grids import each, lines_hz, within


def jump(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force lost by a stiffness that jumps [N].

    `p`: stiffness lost [N/m]; campaign time of the jump [s].
    """
    return float(-p[0] * e) if t >= p[1] else 0.0


def drift(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force lost by a stiffness that falls linearly in time.

    `p`: stiffness lost in the end [N/m]; campaign time at which all of it is lost [s].
    """
    return float(-p[0] * e * t / p[1])


def parametric(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a stiffness that oscillates (parametric excitation).

    `p`: amplitude of the stiffness [N/m], frequency [Hz], phase at campaign time 0 [rad].
    """
    return float(p[0] * math.cos(2.0 * math.pi * p[1] * t + p[2]) * e)


def instants(motion: Motion) -> list[Shape]:
    """List instants all over the record."""
    return each("t_jump_s", within(motion, 24))


def spans(motion: Motion) -> list[Shape]:
    """List one drift, over the whole of the campaign so far."""
    return each("span_s", [float(motion.times[-1])] if motion.times[-1] > 0 else [])


def beats(motion: Motion) -> list[Shape]:
    """List twice the frequencies at which the place moves, and their sums and differences."""
    lines = lines_hz(motion.e, motion.times, 3)
    pairs = {a + b for a in lines for b in lines} | {abs(a - b) for a in lines for b in lines}
    return each("frequency_hz", sorted(pair for pair in pairs if pair > 0), phase_rad=0.0)


_LOSS = Parameter(name="dk_n_per_m", unit="N/m", meaning="stiffness lost in the end")

KINDS = (
    Kind(
        name="stiffness_jump",
        title="Jump of stiffness",
        family="time-varying",
        where="element",
        parameters=(
            _LOSS,
            Parameter(name="t_jump_s", unit="s", meaning="campaign time of the jump"),
        ),
        equation="−Δk e from t_jump on",
        source="",
        sentence="The element lost stiffness at one instant, and did not recover it.",
        action=Law(force=jump, switches=("t_jump_s",)),
        strength="dk_n_per_m",
        shapes=instants,
    ),
    Kind(
        name="stiffness_drift",
        title="Drift of stiffness",
        family="time-varying",
        where="element",
        parameters=(
            _LOSS,
            Parameter(
                name="span_s",
                unit="s",
                meaning="campaign time at which all of it is lost; the end of the record "
                "where not given",
                low=0.0,
                nonzero=True,
                default=math.nan,
                fitted=False,
            ),
        ),
        equation="−Δk e t / span",
        source="",
        sentence="The element loses stiffness steadily over the campaign.",
        action=Law(force=drift),
        strength="dk_n_per_m",
        shapes=spans,
    ),
    Kind(
        name="parametric",
        title="Pulsating stiffness",
        family="parametric",
        where="element",
        parameters=(
            Parameter(name="dk_n_per_m", unit="N/m", meaning="amplitude of the pulsation"),
            Parameter(
                name="frequency_hz", unit="Hz", meaning="its frequency", low=0.0, nonzero=True
            ),
            Parameter(name="phase_rad", unit="rad", meaning="its phase at campaign time 0"),
        ),
        equation="Δk cos(2π f t + φ) e",
        source="Mathieu 1868",
        sentence="The stiffness varies at a fixed frequency, whatever the motion.",
        action=Law(force=parametric),
        strength="dk_n_per_m",
        quadrature="phase_rad",
        shapes=beats,
    ),
)
