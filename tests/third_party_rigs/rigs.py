"""Structures that SciPy integrates: nothing of slowtime is used, so that no error is shared.

Masses in a row, springs and dampers between them and the ground, and whatever the model of them
is to lack: forces between any two points, masses and coordinates more, channels that lie.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping

import numpy as np
from scipy.integrate import odeint
from scipy.interpolate import CubicSpline

GROUND, STILL = -1, -2
"""Ends that are no mass: the ground that moves with the base, and a neighbour that does not."""
FINE = 8
"""Points of an excitation for each sample, between which it is a cubic spline."""

Force = Callable[[float, float, float], float]
"""Of elongation, its rate and time [s]: what resists elongation [N]."""


@dataclasses.dataclass(frozen=True)
class Link:
    """A spring and a damper between two masses, by number; the ground is `GROUND`."""

    name: str
    between: tuple[int, int]
    stiffness: float
    damping: float


@dataclasses.dataclass(frozen=True)
class Hysteresis:
    """A Bouc-Wen spring: stiffness [N/m], yield elongation [m], sharpness."""

    between: tuple[int, int]
    stiffness: float
    yields_m: float
    sharpness: float = 2.0


@dataclasses.dataclass(frozen=True)
class Rider:
    """A mass [kg] that rides on another on a spring [N/m] and a damper [N s/m]."""

    on: int
    mass: float
    stiffness: float
    damping: float


@dataclasses.dataclass(frozen=True)
class Extra:
    """Mass, damping and stiffness beside those of masses and links, over all coordinates.

    Parameters
    ----------
    carried
        1 for each coordinate that the ground carries along, else 0.
    reading
        From the coordinates to the displacements of the masses [mass, coordinate].
    parts
        Stiffness of each part whose constants a model states.
    damping_s
        Damping of each part over its stiffness [s].
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    carried: np.ndarray
    reading: np.ndarray
    parts: tuple[np.ndarray, ...] = ()
    damping_s: float = 0.0


def plain(size: int, own: int) -> Extra:
    """Give nothing beside masses and links; the first coordinates are those of the masses."""
    none = np.zeros((size, size))
    along = np.arange(size) < own
    return Extra(none, none, none, along.astype(float), np.eye(own, size))


@dataclasses.dataclass(frozen=True)
class Structure:
    """What is really there.

    Parameters
    ----------
    masses
        [kg].
    more_mass
        From time [s] to what each mass is heavier by [kg].
    """

    masses: tuple[float, ...]
    links: tuple[Link, ...]
    forces: tuple[tuple[tuple[int, int], Force], ...] = ()
    hysteresis: tuple[Hysteresis, ...] = ()
    riders: tuple[Rider, ...] = ()
    more_mass: Callable[[float], np.ndarray] | None = None
    extra: Extra | None = None

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass, damping and stiffness, riders last."""
        size = len(self.masses) + len(self.riders)
        mass = np.diag([*self.masses, *(one.mass for one in self.riders)])
        damping, stiffness = np.zeros((size, size)), np.zeros((size, size))
        if self.extra is not None:
            size = len(self.extra.mass)
            mass = np.pad(mass, (0, size - len(mass))) + self.extra.mass
            damping, stiffness = self.extra.damping.copy(), self.extra.stiffness.copy()
        ends = [(one.between, one.stiffness, one.damping) for one in self.links]
        ends += [
            ((one.on, len(self.masses) + i), one.stiffness, one.damping)
            for i, one in enumerate(self.riders)
        ]
        for between, k, c in ends:
            along = direction(between, size)
            stiffness += k * np.outer(along, along)
            damping += c * np.outer(along, along)
        return mass, damping, stiffness

    def constants(self) -> Iterator[tuple[str, np.ndarray]]:
        """Give what each stiffness, and then each damping, that a model states adds."""
        size = len(self.matrices()[0])
        extra = self.extra or plain(size, len(self.masses))
        outer = [np.outer(*[direction(one.between, size)] * 2) for one in self.links]
        for one, along in zip(self.links, outer, strict=True):
            yield "stiffness", one.stiffness * along
        yield from (("stiffness", part) for part in extra.parts)
        for one, along in zip(self.links, outer, strict=True):
            yield "damping", one.damping * along
        yield from (("damping", extra.damping_s * part) for part in extra.parts)

    def frequencies_hz(self) -> np.ndarray:
        """Undamped natural frequencies."""
        mass, _, stiffness = self.matrices()
        return np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(mass, stiffness)))) / 2 / np.pi


def direction(between: tuple[int, int], size: int) -> np.ndarray:
    """Elongation as a row over the displacements: second minus first."""
    along = np.zeros(size)
    for end, sign in zip(between, (-1.0, 1.0), strict=True):
        if end not in (GROUND, STILL):
            along[end] += sign
    return along


@dataclasses.dataclass(frozen=True)
class Excitation:
    """What shakes it, at `FINE` points for each sample.

    Parameters
    ----------
    loads
        Force on each mass [point, mass] in N.
    ground
        Acceleration of the ground [point] in m/s^2.
    start
        Displacements [m] and velocities [m/s] at rest, or as they are let go.
    """

    rate_hz: float
    samples: int
    loads: np.ndarray
    ground: np.ndarray
    start: np.ndarray


def ground_motion(given: Excitation) -> CubicSpline:
    """Displacement of the ground over time [m], from rest."""
    fine = np.arange((given.samples - 1) * FINE + 1) / (given.rate_hz * FINE)
    return CubicSpline(fine, given.ground).antiderivative(2)


def run(structure: Structure, given: Excitation) -> Mapping[str, np.ndarray]:
    """Integrate; return displacement against the ground and acceleration of the masses.

    `x` and `dx` are displacement and velocity of all coordinates.
    """
    mass, damping, stiffness = structure.matrices()
    size, own = len(mass), len(structure.masses)
    extra = structure.extra or plain(size, own)
    carried = np.ones(size) if structure.extra is None else extra.carried
    fine = np.arange((given.samples - 1) * FINE + 1) / (given.rate_hz * FINE)
    load = CubicSpline(fine, given.loads @ extra.reading)
    ground = CubicSpline(fine, given.ground)
    moved = ground_motion(given)
    # Against a neighbour that stands still, a mass moves with the ground too.
    forces = [
        (direction(pair, size), law, float(STILL in pair)) for pair, law in structure.forces
    ]
    memory = [(direction(one.between, size), one) for one in structure.hysteresis]
    inverse = np.linalg.inv(mass)

    def rates(x: np.ndarray, t: float) -> np.ndarray:
        q, v, z = x[:size], x[size : 2 * size], x[2 * size :]
        force = load(t) - damping @ v - stiffness @ q
        slip = np.zeros(len(memory))
        for along, law, still in forces:
            e, w = float(along @ q), float(along @ v)
            if still:
                e, w = e + float(moved(t)), w + float(moved(t, 1))
            force = force - law(e, w, t) * along
        for i, (along, one) in enumerate(memory):
            speed = float(along @ v)
            force = force - one.stiffness * z[i] * along
            share = abs(z[i] / one.yields_m) ** one.sharpness
            slip[i] = speed * (1.0 - share * (1.0 + np.sign(speed * z[i])) / 2.0)
        if structure.more_mass is None:
            a = inverse @ force - carried * ground(t)
        else:
            heavy = mass + np.diag(np.pad(structure.more_mass(t), (0, size - own)))
            a = np.linalg.solve(heavy, force) - carried * ground(t)
        return np.concatenate([v, a, slip])

    start = np.zeros(2 * size + len(memory))
    start[:own], start[size : size + own] = given.start
    times = np.arange(given.samples) / given.rate_hz
    x = odeint(rates, start, times, rtol=1e-8, atol=1e-11, hmax=0.5 / given.rate_hz,
               mxstep=20_000)  # fmt: skip
    a = np.stack([rates(row, t)[size : 2 * size] for row, t in zip(x, times, strict=True)])
    return {
        "x": x[:, :size],
        "dx": x[:, size : 2 * size],
        "q": x[:, :size] @ extra.reading.T,
        "v": x[:, size : 2 * size] @ extra.reading.T,
        "a": a @ extra.reading.T + ground(times)[:, None],
    }
