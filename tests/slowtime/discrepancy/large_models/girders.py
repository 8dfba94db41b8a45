"""Parallel girders that springs join at every second node, by SciPy alone.

The matrices of an element are integrals of products of its cubic shape functions, by Gauss
quadrature. A node moves across the plane of the girders and turns along its girder.
"""

from collections.abc import Callable

import numpy as np

from slowtime.discrepancy.records import Campaign
from slowtime.dynamics.description import Beam, Description, Input, Node, Sensor, Spring
from slowtime.dynamics.elements import ROTATION

from .chains import TOLERANCE, Matrices, link, recorded

GIRDERS, ELEMENTS = 3, 20
"""Girders, and beams of each, between pinned ends."""
LENGTH_M, MASS_KG_PER_M = 1.5, 40.0
LOWEST_HZ, BAND_HZ = 0.8, 12.0
"""[Hz] Lowest natural frequency of a girder, and highest frequency of the forces."""
ZETA, AT_HZ = 0.01, 5.0
"""[1] Damping ratio, and the frequency [Hz] at which it is that."""


def name(girder: int, at: int) -> str:
    """Name of a node."""
    return f"g{girder + 1}n{at}"


def nodes() -> tuple[Node, ...]:
    """Give the nodes; those at the ends turn and do not move."""
    ends = (0, ELEMENTS)
    return tuple(
        Node(id=name(g, i), kind="beam", held=("translation",) if i in ends else ())
        for g in range(GIRDERS)
        for i in range(ELEMENTS + 1)
    )


def coordinates() -> list[str]:
    """Name the coordinates that are free."""
    return [one for node in nodes() for one in node.dofs]


def element_matrices(length: float) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness per bending stiffness, and mass per mass of a length, of one element."""
    at, weight = np.polynomial.legendre.leggauss(5)
    x, weight = (at + 1) / 2, weight / 2
    zero, one = np.zeros_like(x), np.ones_like(x)
    powers = np.stack([one, x, x**2, x**3])
    bent = np.stack([zero, zero, 2 * one, 6 * x]) / length**2
    # Values and slopes at both ends, of the four powers.
    ends = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 1, 1], [0, 1, 2, 3]], float)
    ends[[1, 3]] /= length
    mixture = np.linalg.inv(ends)
    shapes, curvatures = mixture.T @ powers, mixture.T @ bent
    return (
        length * (curvatures * weight) @ curvatures.T,
        length * (shapes * weight) @ shapes.T,
    )


def placed(part: np.ndarray, girder: int, first: int) -> np.ndarray:
    """Place the matrix of the element behind a node among all free coordinates."""
    free = coordinates()
    whole = np.zeros((len(free) + 1,) * 2)
    own = [name(girder, i) + turn for i in (first, first + 1) for turn in ("", ROTATION)]
    rows = [free.index(one) if one in free else len(free) for one in own]
    whole[np.ix_(rows, rows)] = part
    return whole[:-1, :-1]


def bending_stiffness() -> float:
    """Give that of a girder [N m^2], from its lowest natural frequency."""
    span = LENGTH_M * ELEMENTS
    return MASS_KG_PER_M * (2 * np.pi * LOWEST_HZ) ** 2 * (span / np.pi) ** 4


def joined() -> list[tuple[int, int]]:
    """Girder and node at which springs join a girder to the next."""
    return [(g, i) for g in range(GIRDERS - 1) for i in range(2, ELEMENTS, 2)]


def campaign(
    change: Callable[[Matrices], None], *, seconds: float = 40.0, seed: int = 1
) -> Campaign:
    """Two records of twelve accelerometers and two random forces, with 1 % of noise."""
    rng = np.random.default_rng(seed)
    free, bending = coordinates(), bending_stiffness()
    stiff, heavy = element_matrices(LENGTH_M)
    # A spring as stiff as the length of girder that it holds, moving in the first mode.
    k = 2 * LENGTH_M * MASS_KG_PER_M * (2 * np.pi * LOWEST_HZ) ** 2
    lag = 2 * ZETA / (2 * np.pi * AT_HZ)
    mass, damping, stiffness = np.zeros((3, len(free), len(free)))
    true = Matrices(mass, damping, stiffness, k, k * lag)
    for girder in range(GIRDERS):
        for first in range(ELEMENTS):
            shape = bending * placed(stiff, girder, first)
            shape *= 1 + TOLERANCE.stiffness * rng.standard_normal()
            true.stiffness += shape
            true.damping += lag * (1 + TOLERANCE.damping * rng.standard_normal()) * shape
            true.mass += MASS_KG_PER_M * placed(heavy, girder, first)
    for girder, i in joined():
        shape = link(len(free), *(free.index(name(g, i)) for g in (girder, girder + 1)))
        true.stiffness += k * (1 + TOLERANCE.stiffness * rng.standard_normal()) * shape
        true.damping += k * lag * (1 + TOLERANCE.damping * rng.standard_normal()) * shape
    change(true)
    seen = [name(g, i) for g in range(GIRDERS) for i in (3, 7, 12, 17)]
    pushed = [name(0, 5), name(2, 13)]
    trials = tuple(
        recorded(
            true, [free.index(one) for one in seen], [free.index(one) for one in pushed], rng,
            seconds=seconds, band_hz=BAND_HZ,
        )
        for _ in range(2)
    )  # fmt: skip
    return Campaign(description=model(seen, pushed), trials=trials)


def model(seen: list[str], pushed: list[str]) -> Description:
    """Give the model of the girders, of nominal constants."""
    lag = 2 * ZETA / (2 * np.pi * AT_HZ)
    k = 2 * LENGTH_M * MASS_KG_PER_M * (2 * np.pi * LOWEST_HZ) ** 2
    beams = tuple(
        Beam(
            id=f"b{g + 1}.{i + 1}", between=(name(g, i), name(g, i + 1)), length_m=LENGTH_M,
            bending_stiffness_n_m2=bending_stiffness(), mass_kg_per_m=MASS_KG_PER_M,
            damping_s=lag,
        )
        for g in range(GIRDERS)
        for i in range(ELEMENTS)
    )  # fmt: skip
    springs = tuple(
        Spring(
            id=f"k{g + 1}.{i}", between=(name(g, i), name(g + 1, i)), stiffness_n_per_m=k,
            damping_n_s_per_m=k * lag,
        )
        for g, i in joined()
    )  # fmt: skip
    return Description(
        name="girders",
        nodes=nodes(),
        elements=beams + springs,
        inputs=tuple(Input(channel=f"f {n}", kind="force", unit="N", node=n) for n in pushed),
        sensors=tuple(
            Sensor(channel=f"a {n}", quantity="acceleration", node=n, unit="m/s^2")
            for n in seen
        ),
        tolerance=TOLERANCE,
    )
