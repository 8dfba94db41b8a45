r"""The two nonlinear structures of Chapter 9, after the authors' published code.

Two masses with a Duffing spring (arXiv 2103.15636), and seven of which the fourth spring is a
Duffing–van der Pol oscillator: a negative stiffness, so that its middle is a hill between two
valleys, and a white force that grows with the displacement of its mass.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Description

from .paths import WhiteForce, means, simulate
from .springs import Springs

RATE_PER_DAY = 5e-5
"""Of the exponential loss of stiffness and damping."""

FORCE_N, FORCE_RAD_PER_S = 10.0, 10.0
"""Of the sine on every mass."""


SECONDS, RATE_HZ = 5.0, 1000.0
"""Of the record of one epoch."""

READING_SNR, FORCE_SNR = 50.0, 20.0
"""Variance of the signal over that of the noise."""

KEPT = ("stiffness", "k4")
"""Of the seven masses, the one spring that does not age."""


@dataclasses.dataclass(frozen=True, slots=True)
class Records:
    """What was measured at several epochs.

    Parameters
    ----------
    readings, reading_sd
        Mean accelerations over each interval [m/s^2], and the sd of their noise by node.
    forces, force_sd
        Mean measured forces over the same intervals [N], and the sd of their error.
    step_s
        Length of an interval [s].
    """

    readings: Float[np.ndarray, "interval epoch node"]
    reading_sd: Float[np.ndarray, " node"]
    forces: Float[np.ndarray, "interval epoch node"]
    force_sd: float
    step_s: float


def two_masses(cubic_n_per_m3: float = 100.0) -> Description:
    """Two masses, the first on a Duffing spring.

    References
    ----------
    .. [1] arXiv 2103.15636.
    """
    plain = chain([20.0, 10.0], [1000.0, 500.0], dampings_n_s_per_m=[10.0, 5.0])
    return _with_cubic(plain, "k1", cubic_n_per_m3)


def seven_masses(cubic_n_per_m3: float = 100.0) -> Description:
    """Seven masses in a row; the fourth spring has two stable positions."""
    plain = chain(
        [20.0, 20.0, 10.0, 10.0, 10.0, 10.0, 5.0],
        [2000.0, 2000.0, 1000.0, -1000.0, 1000.0, 1000.0, 500.0],
        dampings_n_s_per_m=[20.0] * 7,
    )
    return _with_cubic(plain, "k4", cubic_n_per_m3)


TWO_MASSES_WHITE = WhiteForce(added=np.array([0.1, 0.1]))
SEVEN_MASSES_WHITE = WhiteForce(
    added=np.array([0.15, 0.125, 0.125, 0.0, 0.125, 0.1, 0.075]),
    multiplied=np.array([0.0, 0.0, 0.0, 0.125, 0.0, 0.0, 0.0]),
)


def _with_cubic(plain: Description, element: str, cubic_n_per_m3: float) -> Description:
    effect = {"effect": "cubic_hardening", "element": element, "k3_n_per_m3": cubic_n_per_m3}
    return dataclasses.replace(plain, effects=(effect,))


def aged(
    springs: Springs, days: Float[np.ndarray, " epoch"]
) -> Float[np.ndarray, "epoch parameter"]:
    """Values of all constants at some ages: stiffness and damping decay, except `KEPT`."""
    values = np.repeat(springs.values[None], len(days), axis=0)
    seven = len(springs.nodes) == 7
    for i, name in enumerate(springs.names):
        if name[0] in ("stiffness", "damping") and not (seven and name == KEPT):
            values[:, i] *= np.exp(-RATE_PER_DAY * days)
    return values


def record(
    springs: Springs,
    values: Float[np.ndarray, "epoch parameter"],
    white: WhiteForce,
    rng: np.random.Generator,
    *,
    every: int = 10,
) -> Records:
    """Simulate the measurement of the structure at each epoch, from rest, as the authors do.

    Unlike theirs, the accelerations hold all forces, and their mean is taken over `every`
    samples, which is what white forces allow to be read (see `estimation.epochs`).
    """
    nodes, epochs = len(springs.nodes), len(values)
    samples = round(SECONDS * RATE_HZ)
    sine = FORCE_N * np.sin(FORCE_RAD_PER_S * np.arange(samples + 1) / RATE_HZ)
    forces = np.broadcast_to(sine[:, None, None], (samples + 1, 1, nodes))
    start = np.zeros((epochs, 2 * nodes))
    path = simulate(springs, forces, RATE_HZ, white, rng, values=values, start=start)
    acceleration = np.diff(path[:, :, nodes:], axis=0) * RATE_HZ
    noise = np.sqrt(acceleration.var(axis=0).mean(axis=0) / READING_SNR)
    readings = acceleration + noise * rng.standard_normal(acceleration.shape)
    force_noise = float(np.sqrt(sine.var() / FORCE_SNR))
    told = forces + force_noise * rng.standard_normal((samples + 1, epochs, nodes))
    whole = samples // every * every
    return Records(
        readings=readings[:whole].reshape(-1, every, epochs, nodes).mean(axis=1),
        reading_sd=noise / np.sqrt(every),
        forces=means(told, every),
        force_sd=force_noise / np.sqrt(every),
        step_s=every / RATE_HZ,
    )
