"""Sensors: what they would say of a motion, what is wrong with them, and their noise."""

import dataclasses

import numpy as np
import scipy.signal as sps
from numpy.typing import NDArray

from .law import Placed
from .motion import Motion

Array = NDArray[np.float64]
LETTERS = {"displacement": "x", "velocity": "v", "acceleration": "a"}


@dataclasses.dataclass(frozen=True)
class Sensor:
    """One channel: accelerations in space, displacements and velocities against the base."""

    quantity: str
    node: int

    @property
    def channel(self) -> str:
        return f"{LETTERS[self.quantity]}{self.node + 1}"


@dataclasses.dataclass(frozen=True)
class Dropouts:
    """Spans of a record in which a sensor says nothing new."""

    spans: tuple[tuple[int, int], ...]
    """First sample, and the one after the last."""
    stuck: bool
    """Whether the last value is repeated; else zeros are written."""


@dataclasses.dataclass(frozen=True)
class Wander:
    """How a drifting sensor goes from 0 to 1, over records or over the campaign."""

    kind: str
    """``record``, ``campaign`` or ``walk``."""
    seed: int

    def path(self, times: Array, campaign_s: float) -> Array:
        if self.kind == "campaign":
            return np.asarray(times / campaign_s)
        if self.kind == "record":
            return np.asarray((times - times[0]) / (times[-1] - times[0]))
        # Of one walk for the campaign, smooth between its knots 2 s apart.
        steps = np.random.default_rng(self.seed).standard_normal(int(campaign_s / 2) + 3)
        walk = np.cumsum(steps) / np.sqrt(len(steps))
        return np.asarray(np.interp(times, 2.0 * np.arange(len(walk)), walk))


def measured(motion: Motion, sensors: tuple[Sensor, ...]) -> Array:
    """Outputs of faultless, noiseless sensors [time sensor]."""
    columns = []
    for sensor in sensors:
        if sensor.quantity == "acceleration":
            columns.append(motion.acceleration[:, sensor.node] + motion.base)
        else:
            columns.append(getattr(motion, sensor.quantity)[:, sensor.node])
    return np.column_stack(columns)


def before_noise(
    clean: Array, fault: Placed, column: int, times: Array, wander: Wander, campaign_s: float
) -> Array:
    """Let a sensor add, drift or amplify."""
    wrong, p = clean.copy(), fault.parameters
    if fault.law.name == "sensor_bias":
        wrong[:, column] += p["bias"]
    elif fault.law.name == "sensor_drift":
        wrong[:, column] += p["drift_total"] * wander.path(times, campaign_s)
    elif fault.law.name == "sensor_gain":
        wrong[:, column] *= p["gain"]
    return wrong


def after_noise(noisy: Array, fault: Placed, column: int, dropouts: Dropouts) -> Array:
    """Let a sensor clip, or fall silent."""
    wrong = noisy.copy()
    if fault.law.name == "sensor_saturation":
        wrong[:, column] = np.clip(
            wrong[:, column], -fault.parameters["clip"], fault.parameters["clip"]
        )
    elif fault.law.name == "sensor_dropout":
        for first, after in dropouts.spans:
            wrong[first:after, column] = (
                wrong[max(first - 1, 0), column] if dropouts.stuck else 0.0
            )
    return wrong


def draw_dropouts(
    samples: int, rate_hz: float, rng: np.random.Generator, stuck: bool
) -> Dropouts:
    """Draw 1 to 8 spans of 0.05 to 1.5 s."""
    spans = []
    for _ in range(int(rng.integers(1, 9))):
        length = int(rng.uniform(0.05, 1.5) * rate_hz)
        first = int(rng.integers(1, samples - length))
        spans.append((first, first + length))
    return Dropouts(tuple(spans), stuck)


def draw_noise(
    shape: tuple[int, int], colour: tuple[float, ...], rng: np.random.Generator
) -> Array:
    """Noise of unit variance: white, or what an all-pole filter of it leaves.

    Parameters
    ----------
    colour
        Coefficients of the filter after the leading 1; none for white noise.
    """
    settle = 400
    white = rng.standard_normal((shape[0] + settle, shape[1]))
    if not colour:
        return white[settle:]
    impulse = sps.lfilter([1.0], [1.0, *colour], np.eye(1, 4000)[0])
    coloured = sps.lfilter([1.0], [1.0, *colour], white, axis=0)[settle:]
    return np.asarray(coloured / np.sqrt(np.sum(impulse**2)))


def draw_colour(rng: np.random.Generator) -> tuple[float, ...]:
    """Draw a filter: slow noise, fast noise, or noise with a broad hump."""
    if rng.random() < 0.6:
        return (-rng.choice([0.6, 0.8, 0.9, 0.95, -0.5]),)
    radius, angle = rng.uniform(0.7, 0.93), rng.uniform(0.1, 2.5)
    return (-2 * radius * np.cos(angle), radius**2)
