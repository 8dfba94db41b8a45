"""Chains of many masses, simulated by SciPy alone, and models with constants that are off."""

import dataclasses
from collections.abc import Callable

import numpy as np
import scipy.linalg

from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.description import (
    BASE,
    Description,
    Input,
    Node,
    Sensor,
    Spring,
    Tolerance,
)

LOWEST_HZ, BAND_HZ, RATE_HZ = 0.8, 12.0, 50.0
"""[Hz] Lowest natural frequency, highest frequency of the forces, and sampling rate."""
OVER, BEFORE_S = 16, 10.0
"""Steps of the simulation per sample, of which straight forces are right to 0.1 % of 12 Hz; and
motion before the record [s]."""
TOLERANCE = Tolerance(stiffness=0.01, damping=0.1)


@dataclasses.dataclass
class Matrices:
    """Of the simulated chain; nominal stiffness and damping of one of its springs."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    k: float
    c: float


def link(size: int, first: int | None, second: int) -> np.ndarray:
    """Stiffness matrix of a unit spring between two masses, or to the ground."""
    row = np.zeros(size)
    row[second] = 1.0
    if first is not None:
        row[first] = -1.0
    return np.outer(row, row)


def campaign(
    change: Callable[[Matrices], None],
    *,
    masses: int = 200,
    seconds: float = 40.0,
    seed: int = 1,
) -> Campaign:
    """Two records of ten accelerometers and two random forces, with 1 % of noise."""
    rng = np.random.default_rng(seed)
    unit = 2 * np.sin(np.pi / 2 / (masses + 1))
    k, m = 2.0 * (2 * np.pi * LOWEST_HZ / unit) ** 2, 2.0
    c = k * 2 * 0.008 / (2 * np.pi * 5.0)
    springs = k * (1 + TOLERANCE.stiffness * rng.standard_normal(masses + 1))
    dampers = c * (1 + TOLERANCE.damping * rng.standard_normal(masses + 1))
    true = Matrices(m * np.eye(masses), _chain(dampers), _chain(springs), k, c)
    change(true)
    sensors = [int(masses * (0.05 + 0.1 * i)) for i in range(10)]
    pushed = [int(0.185 * masses), int(0.715 * masses)]
    trials = [recorded(true, sensors, pushed, rng, seconds=seconds) for _ in range(2)]
    ends = [BASE, *(f"n{i + 1}" for i in range(masses)), BASE]
    model = Description(
        name="chain",
        nodes=tuple(Node(id=name, mass_kg=m) for name in ends[1:-1]),
        elements=tuple(
            Spring(
                id=f"k{i + 1}", between=(ends[i], ends[i + 1]), stiffness_n_per_m=k,
                damping_n_s_per_m=c,
            )
            for i in range(masses + 1)
        ),
        inputs=tuple(
            Input(channel=f"f{i + 1}", kind="force", unit="N", node=f"n{i + 1}") for i in pushed
        ),
        sensors=tuple(
            Sensor(channel=f"a{i + 1}", quantity="acceleration", node=f"n{i + 1}", unit="m/s^2")
            for i in sensors
        ),
        tolerance=TOLERANCE,
    )  # fmt: skip
    return Campaign(description=model, trials=tuple(trials))


def recorded(
    true: Matrices,
    sensors: list[int],
    pushed: list[int],
    rng: np.random.Generator,
    *,
    seconds: float,
    band_hz: float = BAND_HZ,
) -> Trial:
    """Accelerations under random forces, with 1 % of noise, from long after the start."""
    count = int((seconds + BEFORE_S) * RATE_HZ * OVER)
    forces = np.stack([_random_force(rng, count, band_hz) for _ in pushed], axis=1)
    made = _accelerations(true, forces, pushed)[:, sensors]
    first = int(BEFORE_S * RATE_HZ)
    seen, force = made[first:], forces[::OVER][first:]
    noise = 0.01 * seen.std(axis=0) * rng.standard_normal(seen.shape)
    return Trial(inputs=force, outputs=seen + noise, rate_hz=RATE_HZ)


def _chain(values: np.ndarray) -> np.ndarray:
    beside = values[1:-1]
    return np.diag(values[:-1] + values[1:]) - np.diag(beside, 1) - np.diag(beside, -1)


def _random_force(rng: np.random.Generator, count: int, band_hz: float) -> np.ndarray:
    frequency = np.fft.rfftfreq(count, 1 / (RATE_HZ * OVER))
    inside = (frequency > 0.3) & (frequency < band_hz)
    lines = np.zeros(len(frequency), dtype=complex)
    lines[inside] = rng.standard_normal((int(inside.sum()), 2)) @ [1.0, 1.0j]
    series = np.fft.irfft(lines, count)
    return np.asarray(300.0 * series / series.std())


def _accelerations(true: Matrices, forces: np.ndarray, pushed: list[int]) -> np.ndarray:
    """Exact steps under forces that are straight lines between steps (first-order hold)."""
    size, step = len(true.mass), 1 / (RATE_HZ * OVER)
    inverse, count = np.linalg.inv(true.mass), len(pushed)
    state = np.block(
        [
            [np.zeros((size, size)), np.eye(size)],
            [-inverse @ true.stiffness, -inverse @ true.damping],
        ]
    )
    load = np.zeros((2 * size, count))
    load[size:] = inverse[:, pushed]
    whole = np.zeros((2 * (size + count),) * 2)
    whole[: 2 * size, : 2 * size], whole[: 2 * size, 2 * size : 2 * size + count] = state, load
    whole[2 * size : 2 * size + count, 2 * size + count :] = np.eye(count) / step
    steps = scipy.linalg.expm(step * whole)[: 2 * size]
    kept, later = steps[:, : 2 * size], steps[:, 2 * size + count :]
    now = steps[:, 2 * size : 2 * size + count] - later
    x, found = np.zeros(2 * size), []
    for i in range(len(forces) - 1):
        if i % OVER == 0:
            found.append((state @ x + load @ forces[i])[size:])
        x = kept @ x + now @ forces[i] + later @ forces[i + 1]
    return np.array(found)
