"""Laws that a model may lack: their names, their size, and their force."""

import dataclasses
import math
from collections.abc import Callable, Mapping

from .rigs import Force

RECORD_S = 30.0
"""[s] Of each record."""


@dataclasses.dataclass(frozen=True)
class Law:
    """A force between two points.

    Parameters
    ----------
    kinds, parameter
        Names that are right for it, and its leading number.
    strength
        From force [N] and amplitudes of elongation [m] and rate [m/s] to the leading number.
    force
        From the leading number, those amplitudes and a shape [1] to the law.
    shapes
        Shapes of a rival, from which the best is refined; 1 is that of what is drawn.
    signed
        Whether the leading number may be negative.
    """

    kinds: tuple[str, ...]
    parameter: str
    strength: Callable[[float, float, float], float]
    force: Callable[[float, float, float, float], Force]
    shapes: tuple[float, ...] = (1.0,)
    signed: bool = False


SHAPES = (0.25, 0.5, 1.0, 1.5, 2.25)


def _sign(x: float) -> float:
    return 1.0 if x > 0 else -1.0


LAWS: Mapping[str, Law] = {
    "cubic": Law(
        ("cubic_hardening",), "k3_n_per_m3", lambda f, e, v: f / (3.9 * e**3),
        lambda k, e, v, s: lambda x, w, t: k * x**3,
    ),
    "drag": Law(
        ("quadratic_damping",), "c2_n_s2_per_m2", lambda f, e, v: f / (1.7 * v**2),
        lambda c, e, v, s: lambda x, w, t: c * abs(w) * w,
    ),
    "friction": Law(
        ("coulomb", "dahl", "stribeck", "friction_with_creep"), "friction_n",
        lambda f, e, v: f,
        lambda c, e, v, s: lambda x, w, t: c * math.tanh(w / (1e-3 * v)),
    ),
    "gap": Law(
        ("gap_symmetric",), "k_n_per_m", lambda f, e, v: 3.0 * f / e,
        lambda k, e, v, s: lambda x, w, t: k * max(abs(x) - 0.8 * s * e, 0.0) * _sign(x),
        SHAPES,
    ),
    "stop": Law(
        ("gap_one_sided",), "k_n_per_m", lambda f, e, v: 3.0 * f / e,
        lambda k, e, v, s: lambda x, w, t: k * max(x - 0.5 * s * e, 0.0),
        SHAPES,
    ),
}  # fmt: skip
OFF_ONLY: Mapping[str, Law] = {
    "spring": Law(
        ("missing_spring",), "k_n_per_m", lambda f, e, v: f / e,
        lambda k, e, v, s: lambda x, w, t: k * x, signed=True,
    ),
    "damper": Law(
        ("missing_damper",), "c_n_s_per_m", lambda f, e, v: f / v,
        lambda c, e, v, s: lambda x, w, t: c * w, signed=True,
    ),
}  # fmt: skip
ON_ONLY: Mapping[str, Law] = {
    "softening in time": Law(
        ("stiffness_drift",), "dk_n_per_m", lambda f, e, v: 2.0 * f / e,
        lambda k, e, v, s: lambda x, w, t: -k * x * t / RECORD_S, signed=True,
    ),
    "break": Law(
        ("stiffness_jump",), "dk_n_per_m", lambda f, e, v: 1.4 * f / e,
        lambda k, e, v, s: lambda x, w, t: -k * x * (t >= 0.4 * s * RECORD_S),
        (0.4, 0.8, 1.0, 1.25, 1.8), signed=True,
    ),
}  # fmt: skip
EVERY: Mapping[str, Law] = {**LAWS, **OFF_ONLY, **ON_ONLY}


@dataclasses.dataclass(frozen=True)
class Change:
    """What may be missing in a model, or wrong in a record.

    Parameters
    ----------
    what
        A law of `EVERY`, `bouc_wen`, `mass`, `lighter in time`, `lost mass`, `rider`,
        `gyroscopic`, `sensor gain`, `sensor delay`, `elsewhere`, `input gain`, `input delay`.
    at
        Masses, by number.
    size
        Times that of one unit, in which it is linear.
    shape
        Number in which it is not: of laws relative to that of what is drawn, of riders the
        frequency [Hz], of delays the time [s].
    """

    what: str
    at: tuple[int, ...]
    size: float = 1.0
    shape: float = 1.0
