"""Records of an imposed motion: the motion of an element, and the force in it.

The rig is declared in one of two ways: the motion as an input (`imposed_displacement` of the
node) and the force as a sensor; or the force as an input and the displacement as a sensor,
where inertia is negligible.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import BASE, Description, Sensor, Spring
from slowtime.dynamics.effects import Motion
from slowtime.dynamics.units import unit_factor

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
    sensor, velocity
        Columns of the outputs: displacement of the node and, where measured, its velocity.
        With `driven`, the first is the column of the force.
    sign
        -1 where the spring is given from the node to the base.
    driven
        Quantity that the input imposes on the node; None where the input is the force.
    inertia
        Whether the force accelerates the node too, or is that of the spring alone.
    factors
        SI value of the unit of the input, of the sensor, and of the velocity.
    pushed
        1 where a positive force moves the node up; -1 for the reaction of the base.
    """

    spring: Spring
    mass_kg: float
    sensor: int
    velocity: int | None
    sign: float
    driven: str | None = None
    inertia: bool = True
    pushed: float = 1.0
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)


def rig_of(description: Description) -> ImposedRig | None:
    """Return the rig of a model that may be one of imposed motion.

    None where the model has more than one node, no spring to the base, or inputs other than one
    force on the node (with a displacement sensor) or one motion imposed on it (with a force
    sensor).
    """
    if len(description.nodes) != 1 or len(description.elements) != 1:
        return None
    (node,), (element,), inputs = description.nodes, description.elements, description.inputs
    if not isinstance(element, Spring) or node.kind != "point" or BASE not in element.between:
        return None
    if len(inputs) != 1 or inputs[0].node != node.id:
        return None
    sign, sensors = 1.0 if element.between[0] == BASE else -1.0, description.sensors
    velocity = _column(sensors, "velocity")
    place = _column(sensors, "displacement" if inputs[0].kind == "force" else "force")
    if place is None:
        return None
    read = (inputs[0], sensors[place], sensors[place if velocity is None else velocity])
    coordinate = description.unit_of_coordinate
    first, second, third = (unit_factor(one.unit, one.quantity, coordinate) for one in read)
    factors = (first, second, third)
    if inputs[0].kind == "force":
        return ImposedRig(element, node.mass_kg, place, velocity, sign, factors=factors)
    felt = sensors[place]
    if felt.element is not None:
        pushed = sign
    else:
        pushed = -1.0 if felt.node == BASE else 1.0
    return ImposedRig(
        spring=element,
        mass_kg=node.mass_kg,
        sensor=place,
        velocity=velocity,
        sign=sign,
        driven=inputs[0].quantity,
        inertia=felt.node == node.id,
        pushed=pushed,
        factors=factors,
    )


def _column(sensors: Sequence[Sensor], quantity: str) -> int | None:
    return next((i for i, one in enumerate(sensors) if one.quantity == quantity), None)


def force_record(rig: ImposedRig, trial: Trial) -> ForceRecord:
    """Differentiate the measured motion, and take the inertia off the measured force.

    Samples of an output that are not finite are interpolated; units are SI.
    """
    told = rig.factors[1] * trial.outputs[:, rig.sensor]
    numbers, kept = np.arange(len(told)), np.isfinite(told)
    told = np.interp(numbers, numbers[kept], told[kept])
    given = rig.factors[0] * trial.inputs[:, 0]
    e, force = (told, given) if rig.driven is None else (given, told)
    if rig.driven in ("velocity", "acceleration"):
        # A motion is integrated about its mean, which no record of it alone can tell.
        e = _integrated(e, trial.rate_hz, 2 if rig.driven == "acceleration" else 1)
    window = _window(e)
    v = scipy.signal.savgol_filter(e, window, DEGREE, deriv=1, delta=1 / trial.rate_hz)
    a = scipy.signal.savgol_filter(e, window, DEGREE, deriv=2, delta=1 / trial.rate_hz)
    if rig.driven == "velocity":
        v = given
    if rig.velocity is not None:
        told = rig.factors[2] * trial.outputs[:, rig.velocity]
        v = np.where(np.isfinite(told), told, v)
    force = rig.pushed * force - (rig.mass_kg * a if rig.inertia else 0.0)
    motion = Motion(e=rig.sign * e, v=rig.sign * v, a=rig.sign * a, times=trial.times_s)
    return ForceRecord(motion, rig.sign * force)


def clock_errors(
    rig: ImposedRig, trial: Trial, clocks: Sequence[float]
) -> Float[np.ndarray, " clock"]:
    r"""Return what any spring and damper leave of a rig's force, with its inertia by a clock.

    .. math:: \min_{k, c} \| F + (m q^2 \omega^2 - k - i \omega c) X \| / \| F \|

    The spectra :math:`F` and :math:`X` are those of the record under a Hann window: no
    derivative is taken, so that motion up to half of the sampling rate counts.

    Parameters
    ----------
    clocks
        Factors q of that rate [1].
    """
    record, inertia = force_record(rig, trial), rig.mass_kg if rig.inertia else 0.0
    window = np.hanning(len(record.force))
    e = record.motion.e - record.motion.e.mean()
    motion = np.fft.rfft(window * e)
    given = rig.sign * rig.pushed * rig.factors[0] * trial.inputs[:, 0]
    force = np.fft.rfft(window * (given - given.mean()))
    turns = 2 * np.pi * np.fft.rfftfreq(len(e), 1 / trial.rate_hz)
    columns = np.stack([motion, 1j * turns * motion], axis=1)
    columns /= np.maximum(np.abs(columns).max(axis=0), np.finfo(float).tiny)
    beyond = np.stack([force + inertia * (q * turns) ** 2 * motion for q in clocks], axis=1)
    rows = np.concatenate([columns.real, columns.imag])
    sides = np.concatenate([beyond.real, beyond.imag])
    fitted, *_ = np.linalg.lstsq(rows, sides, rcond=None)
    left = np.linalg.norm(sides - rows @ fitted, axis=0)
    return np.asarray(left / max(float(np.linalg.norm(force)), np.finfo(float).tiny))


def _integrated(
    rate: Float[np.ndarray, " time"], rate_hz: float, times: int
) -> Float[np.ndarray, " time"]:
    """Integrate a motion by the trapezoidal rule, each time about its mean."""
    for _ in range(times):
        rate = rate - rate.mean()
        steps = (rate[1:] + rate[:-1]) / (2 * rate_hz)
        rate = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(rate - rate.mean())


def _window(e: Float[np.ndarray, " time"]) -> int:
    """Length of the differentiating polynomials [samples], odd."""
    spectrum = np.abs(np.fft.rfft((e - e.mean()) * np.hanning(len(e)))) ** 2
    lines = np.arange(len(spectrum))
    mean = float((lines * spectrum).sum() / max(spectrum.sum(), np.finfo(float).tiny))
    length = int(WINDOW_PERIODS * len(e) / max(mean, 1.0))
    return max(min(length, len(e) // 4), MIN_WINDOW) | 1


def is_imposed(description: Description, trials: Sequence[Trial]) -> bool:
    """Return whether the inertia of a model is negligible in all of its records."""
    # The motion is then imposed: a free run under the measured force would have no inertia to
    # integrate, and the law follows from force and motion directly. So it does where the motion
    # is the input.
    rig = rig_of(description)
    if rig is None or any(len(trial.outputs) < 2 * MIN_WINDOW for trial in trials):
        return False
    for trial in trials:
        if not np.isfinite(trial.outputs[:, rig.sensor]).any():
            return False
        if rig.driven is not None:
            continue
        record = force_record(rig, trial)
        inertia = float(np.std(rig.mass_kg * record.motion.a))
        size = rig.factors[0] * float(np.std(trial.inputs[:, 0]))
        if not inertia < MAX_INERTIA_SHARE * size:
            return False
    return True
