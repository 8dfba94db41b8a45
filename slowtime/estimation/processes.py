r"""Members of the algebra of processes: Matérn, level, trend, wave, repeating function."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import ive

from . import kernels
from .algebra import Leaf, Process, Product, Sum

__all__ = [
    "Constant",
    "Matern",
    "Periodic",
    "Process",
    "Product",
    "Sum",
    "Trend",
    "quasi_periodic",
]

Parameter = float | Float[np.ndarray, "*family"]

_LEFT_OUT = 1e-12
"""Share of the variance of a periodic process in the harmonics that are left out."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Matern(Leaf):
    """Matérn process of `smoothness` 0.5, 1.5 or 2.5, length scale and standard deviation."""

    smoothness: float = 1.5
    length: Parameter
    sd: Parameter

    def __post_init__(self) -> None:
        if self.smoothness not in kernels.SMOOTHNESSES:
            raise ValueError(
                f"smoothness={self.smoothness} is none of 0.5, 1.5, 2.5. Give 1.5 when unsure."
            )
        Leaf.__post_init__(self)

    @property
    def _names(self) -> tuple[str, ...]:
        return ("length", "sd")

    @property
    def observation(self) -> np.ndarray:
        """See `Process`."""
        return np.asarray(np.eye(round(self.smoothness + 0.5))[0])

    def initial_covariance(self) -> np.ndarray:
        """See `Process`."""
        return np.asarray(
            kernels.per_member(self.sd) ** 2 * kernels.stationary(self.smoothness)
        )

    def transitions(self, step: np.ndarray) -> np.ndarray:
        """See `Process`."""
        apart = _with_family_axis(step, self.length, self.sd)
        scaled = apart * kernels.rate(self.smoothness, self.length)
        return kernels.matern_transition(self.smoothness, scaled)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Constant(Leaf):
    """A level that stays, known to a standard deviation."""

    sd: Parameter

    @property
    def _names(self) -> tuple[str, ...]:
        return ("sd",)

    @property
    def observation(self) -> np.ndarray:
        """See `Process`."""
        return np.ones(1)

    def initial_covariance(self) -> np.ndarray:
        """See `Process`."""
        return np.asarray(kernels.per_member(self.sd) ** 2)

    def transitions(self, step: np.ndarray) -> np.ndarray:
        """See `Process`."""
        return np.ones((*_with_family_axis(step, self.sd).shape, 1, 1))


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Trend(Leaf):
    """A level and a slope, both unknown at the first reading; the slope may wander.

    Parameters
    ----------
    level_sd, slope_sd
        At the first reading; not learnt.
    drift
        Standard deviation of the change of the slope over one unit of time; 0 for straight.
    """

    level_sd: Parameter
    slope_sd: Parameter
    drift: Parameter = 0.0

    stationary = False

    @property
    def _names(self) -> tuple[str, ...]:
        return ("drift",) if np.any(np.asarray(self.drift) != 0.0) else ()

    @property
    def observation(self) -> np.ndarray:
        """See `Process`."""
        return np.array([1.0, 0.0])

    def initial_covariance(self) -> np.ndarray:
        """See `Process`."""
        level, slope, drift = np.broadcast_arrays(self.level_sd, self.slope_sd, self.drift)
        own = np.zeros((*drift.shape, 2, 2))
        own[..., 0, 0], own[..., 1, 1] = level**2, slope**2
        return own

    def transitions(self, step: np.ndarray) -> np.ndarray:
        """See `Process`."""
        apart = _with_family_axis(step, self.drift)
        apart = np.broadcast_to(apart, (len(step), *np.shape(self.drift)))
        move = np.zeros((*apart.shape, 2, 2))
        move[..., 0, 0] = move[..., 1, 1] = 1.0
        move[..., 0, 1] = apart
        return move

    def noises(self, step: np.ndarray, move: np.ndarray) -> np.ndarray:
        """See `Process`."""
        return np.asarray(
            kernels.per_member(self.drift) ** 2 * kernels.trend_noise(move[..., 0, 1])
        )


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Periodic(Leaf):
    r"""A function that repeats itself, :math:`\sigma^2 \exp(-2 \sin^2(\pi \tau / p) / \ell^2)`.

    Its Fourier series has the weights :math:`2 I_j(\ell^{-2}) e^{-\ell^{-2}}`; as many
    harmonics are kept as hold all but 1e-12 of the variance, or as many as are asked for.

    One with edges has weights that fall as :math:`1 / (1 + j^2 \ell^2)` instead, as those of
    what jumps or bends do: its coefficients are those of an Ornstein–Uhlenbeck process.

    Parameters
    ----------
    length
        How rough within a period [1]: below 0.5 many harmonics, above 2 hardly one.
    harmonics
        How many; None for as many as it takes.
    edges
        Whether it may jump and bend; `harmonics` must be given then.
    """

    period: Parameter
    length: Parameter
    sd: Parameter
    harmonics: int | None = None
    edges: bool = False

    @property
    def _names(self) -> tuple[str, ...]:
        return ("period", "length", "sd")

    @property
    def count(self) -> int:
        """How many harmonics there are."""
        if self.harmonics is not None:
            return self.harmonics
        if self.edges:
            raise ValueError(
                "A function with edges has infinitely many harmonics. State how many to "
                "use, for example harmonics=8."
            )
        sharpest = float(np.max(np.asarray(self.length) ** -2.0))
        order = np.arange(1, 2000)
        left = 1.0 - ive(0, sharpest) - 2.0 * np.cumsum(ive(order, sharpest))
        enough = np.flatnonzero(left < _LEFT_OUT)
        if not len(enough):
            raise ValueError(
                f"length={self.length} is so short that 2,000 harmonics do not hold the "
                "process. Give one above 0.001."
            )
        return int(order[enough[0]])

    @property
    def observation(self) -> np.ndarray:
        """See `Process`."""
        return np.concatenate([[1.0], np.tile([1.0, 0.0], self.count)])

    def initial_covariance(self) -> np.ndarray:
        """See `Process`."""
        places = np.concatenate([[0], np.repeat(np.arange(1, self.count + 1), 2)])
        variance = np.asarray(self.sd)[..., None] ** 2
        return np.asarray(
            (variance * self._shares()[..., places])[..., None] * np.eye(len(places))
        )

    def _shares(self) -> np.ndarray:
        """Share of variance of each harmonic [family, harmonic]."""
        order = np.arange(self.count + 1)
        twice = np.where(order > 0, 2.0, 1.0)
        length = np.asarray(self.length)[..., None]
        if not self.edges:
            return np.asarray(twice * ive(order, length**-2.0))
        share = twice / (1.0 + (order * length) ** 2)
        return np.asarray(share / share.sum(axis=-1, keepdims=True))

    def transitions(self, step: np.ndarray) -> np.ndarray:
        """See `Process`."""
        apart = _with_family_axis(step, self.period, self.length, self.sd)
        angle = 2.0 * np.pi * apart / self.period
        size = 1 + 2 * self.count
        move = np.zeros((*angle.shape, size, size))
        move[..., 0, 0] = 1.0
        for j in range(1, self.count + 1):
            move[..., 2 * j - 1 : 2 * j + 1, 2 * j - 1 : 2 * j + 1] = _turn(j * angle)
        return move


def quasi_periodic(
    *,
    period: Parameter,
    sd: Parameter,
    memory: Parameter,
    length: Parameter = 1.0,
    smoothness: float = 0.5,
    harmonics: int | None = None,
    edges: bool = False,
) -> Product:
    """Make a wave of any form that changes slowly: periodic times Matérn.

    Parameters
    ----------
    period
        Period, in the unit of time.
    sd
        Standard deviation, in the unit of the readings.
    memory
        Length scale over which the form changes, in the unit of time.
    length
        Roughness within a period, see `Periodic` [1].
    smoothness
        Smoothness of the change of form: 0.5, 1.5 or 2.5 [1].
    harmonics
        Number of harmonics; None for as many as it takes.
    edges
        Whether the wave may jump and bend; see `Periodic`.

    Returns
    -------
    The process.
    """
    wave = Periodic(period=period, length=length, sd=sd, harmonics=harmonics, edges=edges)
    fading = Matern(smoothness=smoothness, length=memory, sd=1.0, fixed=("sd",))
    return Product(wave, fading)


def _with_family_axis(step: np.ndarray, *parameters: Parameter) -> np.ndarray:
    """Time steps with an axis for the family behind, if there is one."""
    family = np.broadcast_shapes(*(np.shape(parameter) for parameter in parameters))
    return np.broadcast_to(step.reshape(-1, *([1] * len(family))), (len(step), *family))


def _turn(angle: np.ndarray) -> np.ndarray:
    """Rotation by each angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, s], -1), np.stack([-s, c], -1)], -2)
