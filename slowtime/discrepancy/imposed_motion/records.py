"""Records in which inertia is negligible: the motion of an element, and the force in it."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.signal
from jaxtyping import Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import BASE, Description, Sensor, Spring
from slowtime.dynamics.effects import Motion

MAX_INERTIA_SHARE = 0.02
"""[share of the measured force] Root mean square of mass times acceleration below which the
record counts as one of imposed motion. Source: a decision: inertia is then within the errors
of force transducers."""
WINDOW_PERIODS = 0.06
"""[periods of the motion] Length of the polynomials that differentiate it. Source: third-degree
polynomials over so short an arc of a sine leave less than 1e-4 of its rate."""
MIN_WINDOW = 7
"""[samples] Least length of these polynomials. Source: the degree and four more."""
DEGREE = 3
"""[1] Of these polynomials. Source: Savitzky and Golay 1964; it gives an acceleration, too."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ForceRecord:
    """The motion of an element, and the force that it took.

    Parameters
    ----------
    motion
        Elongation [m], rate [m/s] and acceleration [m/s²] of the element.
    force
        Measured force (time,) [N], less the inertia of the node.
    """

    motion: Motion
    force: Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True)
class ImposedRig:
    """A model of one spring, with the channels of its motion and of its force.

    Parameters
    ----------
    spring
        Between the base and the node that is moved.
    mass_kg
        Of that node.
    sensor, velocity
        Columns of the outputs: displacement of the node and, where measured, its velocity.
    sign
        -1 where the spring is given from the node to the base.
    """

    spring: Spring
    mass_kg: float
    sensor: int
    velocity: int | None
    sign: float


def rig_of(description: Description) -> ImposedRig | None:
    """Return the rig of a model that may be one of imposed motion.

    Parameters
    ----------
    description
        Model of the campaign.

    Returns
    -------
    The rig; None where the model has more than one degree of freedom, no spring to the base, no
    displacement sensor, or inputs other than one force on the node.
    """
    if len(description.nodes) != 1 or len(description.elements) != 1:
        return None
    (node,), (element,), inputs = description.nodes, description.elements, description.inputs
    if not isinstance(element, Spring) or node.kind != "point" or BASE not in element.between:
        return None
    if len(inputs) != 1 or inputs[0].kind != "force" or inputs[0].node != node.id:
        return None
    place = _column(description.sensors, "displacement")
    if place is None:
        return None
    sign = 1.0 if element.between[0] == BASE else -1.0
    return ImposedRig(
        element, node.mass_kg, place, _column(description.sensors, "velocity"), sign
    )


def _column(sensors: Sequence[Sensor], quantity: str) -> int | None:
    return next((i for i, one in enumerate(sensors) if one.quantity == quantity), None)


def force_record(rig: ImposedRig, trial: Trial) -> ForceRecord:
    """Differentiate the measured motion, and take the inertia off the measured force.

    Parameters
    ----------
    rig
        The model's rig.
    trial
        Record with the force as its only input [N] and the displacement [m] among its outputs.
    """
    e = trial.outputs[:, rig.sensor].astype(float)
    kept = np.isfinite(e)
    numbers = np.arange(len(e))
    e = np.interp(numbers, numbers[kept], e[kept])
    window = _window(e)
    v = scipy.signal.savgol_filter(e, window, DEGREE, deriv=1, delta=1 / trial.rate_hz)
    a = scipy.signal.savgol_filter(e, window, DEGREE, deriv=2, delta=1 / trial.rate_hz)
    if rig.velocity is not None:
        told = trial.outputs[:, rig.velocity]
        v = np.where(np.isfinite(told), told, v)
    force = trial.inputs[:, 0] - rig.mass_kg * a
    motion = Motion(e=rig.sign * e, v=rig.sign * v, a=rig.sign * a, times=trial.times_s)
    return ForceRecord(motion, rig.sign * force)


def _window(e: Float[np.ndarray, " time"]) -> int:
    """Length of the differentiating polynomials [samples], odd."""
    spectrum = np.abs(np.fft.rfft((e - e.mean()) * np.hanning(len(e)))) ** 2
    lines = np.arange(len(spectrum))
    mean = float((lines * spectrum).sum() / max(spectrum.sum(), np.finfo(float).tiny))
    length = int(WINDOW_PERIODS * len(e) / max(mean, 1.0))
    return max(min(length, len(e) // 4), MIN_WINDOW) | 1


def is_imposed(description: Description, trials: Sequence[Trial]) -> bool:
    """Return whether the inertia of a model is negligible in all of its records.

    The motion is then imposed: a free run under the measured force would have no inertia to
    integrate, and the law follows from force and motion directly.
    """
    rig = rig_of(description)
    if rig is None or any(len(trial.outputs) < 2 * MIN_WINDOW for trial in trials):
        return False
    for trial in trials:
        if not np.isfinite(trial.outputs[:, rig.sensor]).any():
            return False
        record = force_record(rig, trial)
        inertia = float(np.std(rig.mass_kg * record.motion.a))
        if not inertia < MAX_INERTIA_SHARE * float(np.std(trial.inputs[:, 0])):
            return False
    return True
