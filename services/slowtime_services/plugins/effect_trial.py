"""Trial of new kinds of effect on a known motion.

What a kind does wrong with parameters that it names itself, it does here: raises, gives what is
no number, or does not come back. A trial runs in a process of its own, which may be ended.
"""

import faulthandler
from collections.abc import Mapping
from typing import Any

import numpy as np

from slowtime.dynamics.effects import (
    Friction,
    Hidden,
    InputChange,
    Kind,
    Law,
    Motion,
    Parameter,
    SensorChange,
    force_along,
)

from .effect_kinds import EffectFileError, kinds_in

GROUP = "slowtime.effects"
PATIENCE_S = 120.0
"""For the trial of a part on a busy machine: what takes longest is compiling its laws."""

MAX_GRID_POINTS = 8
"""Points of a kind's own grid that are tried [1]; they are spread over it."""
_MOST = 10_000
_AMPLITUDE_M = 1e-3
"""Amplitude of the trial motion [m]."""
_TIMES = np.arange(512) / 100.0
_ANGULAR = 2 * np.pi * np.array([[2.0], [7.3]])
_SHARES = _AMPLITUDE_M * np.array([0.8, 0.2])


def trial(name: str, part: object) -> list[str]:
    """Try every kind of a part, in a process that is there for nothing else; their names.

    Raises
    ------
    EffectFileError
        (a ValueError) for a kind that gives what is no number, or for a part without kinds.
        Whatever else a kind raises passes through.
    """
    # A compiled law that hangs keeps the interpreter lock, so no thread of Python could end
    # this process after its caller has ended.
    faulthandler.dump_traceback_later(PATIENCE_S, exit=True)
    kinds = kinds_in(name, part)
    for kind in kinds:
        try_kind(kind)
    return [kind.name for kind in kinds]


def try_kind(kind: Kind) -> None:
    """Try a kind at points of its own grid.

    Raises
    ------
    EffectFileError
        (a ValueError) where it gives what is no number. Whatever else it raises passes through.
    """
    motion = _motion()
    shapes = kind.shapes(motion)
    if not isinstance(shapes, list) or len(shapes) > _MOST:
        raise EffectFileError(
            f"{kind.name}: `shapes` gave {type(shapes).__name__} of {len(shapes):,}. Allowed: "
            f"a list of at most {_MOST:,}."
        )
    for place in np.linspace(0, len(shapes) - 1, min(MAX_GRID_POINTS, len(shapes))).astype(int):
        _try_at(kind, shapes[place], motion)


def _try_at(kind: Kind, shape: Mapping[str, float], motion: Motion) -> None:
    given = {one.name: _some(one) for one in kind.parameters if one.default is None}
    parameters = given | {str(name): float(value) for name, value in shape.items()}
    values = kind.values(parameters)
    values = np.where(np.isnan(values), motion.times[-1], values)
    match kind.action:
        case Law() | Friction() | Hidden():
            found: Any = force_along(kind, parameters, motion)
        case InputChange() | SensorChange():
            found = kind.action.act(motion.a, motion.times, values)
        case _:
            return
    series = np.asarray(found, dtype=float)
    if series.shape != motion.e.shape or not np.isfinite(series).all():
        told = ", ".join(f"{name} = {value:g}" for name, value in parameters.items())
        raise EffectFileError(
            f"{kind.name} with {told} gave values that are not finite numbers for "
            "each sample of a "
            f"motion of {1e3 * _AMPLITUDE_M:g} mm. Bound its law there."
        )


def _some(parameter: Parameter) -> float:
    """Choose a value that is allowed."""
    if parameter.choices:
        return parameter.choices[0]
    return float(np.clip(1.0, parameter.low, parameter.high))


def _motion() -> Motion:
    phases = _ANGULAR * _TIMES
    omega = _ANGULAR[:, 0]
    return Motion(
        e=_SHARES @ np.sin(phases),
        v=(_SHARES * omega) @ np.cos(phases),
        a=-(_SHARES * omega**2) @ np.sin(phases),
        times=_TIMES,
    )
