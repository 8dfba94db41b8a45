"""Grids of masses that springs join to their neighbours and to a frame around, by SciPy alone.

Each mass moves across the plane of the grid, as the knots of a net: one coordinate each.
"""

from collections.abc import Callable, Iterator

import numpy as np

from slowtime.discrepancy.records import Campaign
from slowtime.dynamics.description import (
    BASE,
    Description,
    Input,
    Node,
    Sensor,
    Spring,
)

from .chains import TOLERANCE, Matrices, link, recorded

SIZE = 10
"""Masses in a row, and rows."""
LOWEST_HZ, BAND_HZ = 3.0, 6.0
"""[Hz] Lowest natural frequency, and highest frequency of the forces."""
MASS_KG = 2.0


def name(row: int, column: int) -> str:
    """Name of a node."""
    return f"r{row}c{column}"


def springs(size: int) -> Iterator[tuple[str, str, int | None, int]]:
    """Give the ends of the springs of a grid, by name and by number; None for the frame."""
    for row in range(size):
        for column in range(size):
            here, number = name(row, column), row * size + column
            if row == 0 or row == size - 1:
                yield BASE, here, None, number
            if column == 0 or column == size - 1:
                yield BASE, here, None, number
            if column + 1 < size:
                yield here, name(row, column + 1), number, number + 1
            if row + 1 < size:
                yield here, name(row + 1, column), number, number + size


def campaign(
    change: Callable[[Matrices], None],
    *,
    size: int = SIZE,
    seconds: float = 40.0,
    seed: int = 1,
) -> Campaign:
    """Two records of twelve accelerometers and two random forces, with 1 % of noise."""
    rng = np.random.default_rng(seed)
    count, parts = size**2, list(springs(size))
    unit = 2 * np.sin(np.pi / 2 / (size + 1)) * np.sqrt(2)
    k = MASS_KG * (2 * np.pi * LOWEST_HZ / unit) ** 2
    c = k * 2 * 0.008 / (2 * np.pi * LOWEST_HZ)
    true = Matrices(
        MASS_KG * np.eye(count), np.zeros((count,) * 2), np.zeros((count,) * 2), k, c
    )
    for _, _, first, second in parts:
        shape = link(count, first, second)
        true.stiffness += k * (1 + TOLERANCE.stiffness * rng.standard_normal()) * shape
        true.damping += c * (1 + TOLERANCE.damping * rng.standard_normal()) * shape
    change(true)
    sensors = [int(at) for at in np.linspace(2, count - 3, 12)]
    pushed = [int(0.23 * count), int(0.66 * count)]
    names = [name(i // size, i % size) for i in range(count)]
    model = Description(
        name="grid",
        nodes=tuple(Node(id=one, mass_kg=MASS_KG) for one in names),
        elements=tuple(
            Spring(
                id=f"k{i + 1}", between=(one, other), stiffness_n_per_m=k, damping_n_s_per_m=c
            )
            for i, (one, other, _, _) in enumerate(parts)
        ),
        inputs=tuple(
            Input(channel=f"f{i}", kind="force", unit="N", node=names[i]) for i in pushed
        ),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=names[i], unit="m/s^2")
            for i in sensors
        ),
        tolerance=TOLERANCE,
    )  # fmt: skip
    trials = tuple(
        recorded(true, sensors, pushed, rng, seconds=seconds, band_hz=BAND_HZ) for _ in range(2)
    )
    return Campaign(description=model, trials=trials)
