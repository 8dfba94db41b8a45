r"""Gaussian processes over time as small linear systems: an algebra of kernels, exact.

A stationary process of covariance :math:`k(\tau)` is seen through a state that moves by
:math:`A(\tau)` and keeps the covariance S, :math:`k(\tau) = h A(|\tau|) S h^T` (Hartikainen and
Särkkä, 2010). Sums of processes are states side by side, products are Kronecker products
(Solin and Särkkä, 2014). Parameters may be arrays, one entry per member of a family.
"""

import abc
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .state_space import Advanced, Belief


class Process(abc.ABC):
    """What all processes do. `p + q` and `p * q` are sum and product.

    Examples
    --------
    >>> from .processes import Matern, Periodic
    >>> wave = Periodic(period=7.0, length=0.8, sd=0.3, harmonics=3)
    >>> weather = Matern(length=20.0, sd=1.0) + wave * Matern(length=50.0, sd=1.0)
    >>> weather.size, weather.free
    (16, ('length', 'sd', 'period', 'length', 'sd', 'length', 'sd'))
    """

    stationary = True

    @property
    def size(self) -> int:
        """How many numbers the state has."""
        return len(self.observation)

    @property
    @abc.abstractmethod
    def observation(self) -> Float[np.ndarray, " state"]:
        """What of the state is the process."""

    def observation_row(
        self, time: Float[np.ndarray, " time"]
    ) -> Float[np.ndarray, "time *family state"]:
        """See `StateSpace.observation_row`."""
        return np.broadcast_to(self.observation, (len(time), self.size))

    @abc.abstractmethod
    def member(self, number: int) -> "Process":
        """Take one process out of a family."""

    @property
    @abc.abstractmethod
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that may be learnt, in order."""

    @property
    @abc.abstractmethod
    def logs(self) -> Float[np.ndarray, "*family parameter"]:
        """Their logarithms."""

    @abc.abstractmethod
    def at(self, logs: Float[np.ndarray, "*family parameter"]) -> "Process":
        """Make the same kind of process with other parameters.

        Parameters
        ----------
        logs
            Logarithms of the free parameters [family, parameter].

        Returns
        -------
        The process, or family of processes.
        """

    @abc.abstractmethod
    def initial_covariance(self) -> np.ndarray:
        """Covariance of the state before any reading [family, state, state]."""

    def start(self, time: float) -> Belief:
        """See `StateSpace.start`."""
        own = self.initial_covariance()
        return Belief(float(time), np.zeros(own.shape[:-1]), own)

    @abc.abstractmethod
    def transitions(self, step: Float[np.ndarray, " time"]) -> np.ndarray:
        """Compute the transitions of the state over time steps [time, family, state, state]."""

    def noises(self, step: Float[np.ndarray, " time"], move: np.ndarray) -> np.ndarray:
        """Compute the process noise over time steps, of which `move` are the transitions."""
        own = self.initial_covariance()
        return np.asarray(own - move @ own @ np.swapaxes(move, -1, -2))

    def advance(self, step: Float[np.ndarray, " time"]) -> Advanced:
        """See `StateSpace.advance`."""
        check_ascending(step)
        move = self.transitions(step)
        return move, self.noises(step, move)

    def covariance(self, apart: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Covariance of one stationary process between two times.

        Parameters
        ----------
        apart
            Distances in time, in the unit of time.

        Returns
        -------
        Covariances, in the squared unit of the readings.

        Raises
        ------
        ValueError
            Where the process is not stationary, such as a trend or a sawtooth.
        """
        if not self.stationary:
            raise ValueError(
                "A trend or a sawtooth has no covariance that hangs on the distance alone."
            )
        seen = self.observation
        move = self.transitions(np.abs(apart).ravel())
        return np.asarray((seen @ move @ self.initial_covariance() @ seen).reshape(apart.shape))

    def __add__(self, other: "Process") -> "Sum":
        return Sum((*_terms(self), *_terms(other)))

    def __mul__(self, other: "Process") -> "Product":
        return Product(self, other)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Leaf(Process):
    """A process with parameters of its own; those in `fixed` are not learnt."""

    fixed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self._names:
            value = np.asarray(getattr(self, name))
            if not (np.all(value > 0.0) and np.all(np.isfinite(value))):
                raise ValueError(
                    f"{type(self).__name__}: {name}={getattr(self, name)} is not positive. "
                    "Give a finite number above 0; leave the process out of the sum if it "
                    "plays no part."
                )

    @property
    @abc.abstractmethod
    def _names(self) -> tuple[str, ...]:
        """Names of its parameters, in the order of their slopes."""

    def member(self, number: int) -> "Process":
        """See `Process`."""
        values = [(each.name, getattr(self, each.name)) for each in dataclasses.fields(self)]
        chosen: dict[str, Any] = {
            name: float(value[number])
            for name, value in values
            if isinstance(value, np.ndarray)
        }
        return dataclasses.replace(self, **chosen)

    @property
    def free(self) -> tuple[str, ...]:
        """See `Process`."""
        return tuple(name for name in self._names if name not in self.fixed)

    @property
    def logs(self) -> np.ndarray:
        """See `Process`."""
        values = [np.log(np.asarray(getattr(self, name))) for name in self.free]
        return np.stack(np.broadcast_arrays(*values), -1) if values else np.zeros(0)

    def at(self, logs: np.ndarray) -> "Process":
        """See `Process`."""
        values = np.exp(np.moveaxis(logs, -1, 0))
        return dataclasses.replace(self, **dict(zip(self.free, values, strict=True)))


@dataclasses.dataclass(frozen=True, slots=True)
class Sum(Process):
    """Processes added up, independent of each other."""

    terms: tuple[Process, ...]

    @property
    def stationary(self) -> bool:  # type: ignore[override]
        """See `Process`."""
        return all(term.stationary for term in self.terms)

    @property
    def observation(self) -> np.ndarray:
        """See `Process`."""
        return np.concatenate([term.observation for term in self.terms])

    def observation_row(self, time: np.ndarray) -> np.ndarray:
        """See `StateSpace.observation_row`."""
        rows = [term.observation_row(time)[..., None, :] for term in self.terms]
        parts = [row[..., 0, :] for row in _aligned(rows)]
        batch = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
        return np.concatenate([np.broadcast_to(p, (*batch, p.shape[-1])) for p in parts], -1)

    def member(self, number: int) -> "Sum":
        """See `Process`."""
        return Sum(tuple(term.member(number) for term in self.terms))

    @property
    def free(self) -> tuple[str, ...]:
        """See `Process`."""
        return tuple(name for term in self.terms for name in term.free)

    @property
    def logs(self) -> np.ndarray:
        """See `Process`."""
        return _concatenate_logs([term.logs for term in self.terms])

    def at(self, logs: np.ndarray) -> "Process":
        """See `Process`."""
        return dataclasses.replace(self, terms=_split(self.terms, logs))

    def part(self, number: int) -> Float[np.ndarray, " state"]:
        """Tell what of the state is the term of this number alone."""
        seen = [term.observation * (i == number) for i, term in enumerate(self.terms)]
        return np.concatenate(seen)

    def initial_covariance(self) -> np.ndarray:
        """See `Process`."""
        return _blocks([term.initial_covariance() for term in self.terms])

    def transitions(self, step: np.ndarray) -> np.ndarray:
        """See `Process`."""
        return _blocks(_aligned([term.transitions(step) for term in self.terms]))

    def noises(self, step: np.ndarray, move: np.ndarray) -> np.ndarray:
        """See `Process`."""
        own = [term.noises(step, term.transitions(step)) for term in self.terms]
        return _blocks(_aligned(own))


@dataclasses.dataclass(frozen=True, slots=True)
class Product(Process):
    """Two stationary processes multiplied: a wave that forgets, a memory that sways.

    Of the two standard deviations only the product is seen: fix one of them to learn the other.
    """

    first: Process
    second: Process

    def __post_init__(self) -> None:
        if not (self.first.stationary and self.second.stationary):
            raise ValueError(
                "A product with a trend or a sawtooth is no process of this kind. Multiply "
                "stationary processes, and add the trend or the sawtooth."
            )

    @property
    def observation(self) -> np.ndarray:
        """See `Process`."""
        return np.kron(self.first.observation, self.second.observation)

    def member(self, number: int) -> "Product":
        """See `Process`."""
        return Product(self.first.member(number), self.second.member(number))

    @property
    def free(self) -> tuple[str, ...]:
        """See `Process`."""
        return (*self.first.free, *self.second.free)

    @property
    def logs(self) -> np.ndarray:
        """See `Process`."""
        return _concatenate_logs([self.first.logs, self.second.logs])

    def at(self, logs: np.ndarray) -> "Process":
        """See `Process`."""
        first, second = _split((self.first, self.second), logs)
        return dataclasses.replace(self, first=first, second=second)

    def initial_covariance(self) -> np.ndarray:
        """See `Process`."""
        return _kron(self.first.initial_covariance(), self.second.initial_covariance())

    def transitions(self, step: np.ndarray) -> np.ndarray:
        """See `Process`."""
        return _kron(*_aligned([self.first.transitions(step), self.second.transitions(step)]))


def _terms(process: Process) -> tuple[Process, ...]:
    return process.terms if isinstance(process, Sum) else (process,)


def check_ascending(step: np.ndarray) -> None:
    """Refuse time steps that go back."""
    if step.size and not step.min() >= 0.0:
        raise ValueError(
            f"The time goes back by {-step.min():g}. Give readings in ascending order of "
            "time; equal times are allowed."
        )


def _concatenate_logs(logs: Sequence[np.ndarray]) -> np.ndarray:
    family = np.broadcast_shapes(*(each.shape[:-1] for each in logs))
    return np.concatenate([np.broadcast_to(e, (*family, e.shape[-1])) for e in logs], -1)


def _split(terms: Sequence[Process], logs: np.ndarray) -> tuple[Process, ...]:
    ends = np.cumsum([len(term.free) for term in terms])
    parts = np.split(logs, ends[:-1], axis=-1)
    return tuple(
        term.at(part) if term.free else term for term, part in zip(terms, parts, strict=True)
    )


def _aligned(parts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Give all as many axes of a family, between the one of time and the matrices."""
    most = max(part.ndim for part in parts)
    return [p.reshape(len(p), *(1,) * (most - p.ndim), *p.shape[1:]) for p in parts]


def _blocks(parts: Sequence[np.ndarray]) -> np.ndarray:
    batch = np.broadcast_shapes(*(part.shape[:-2] for part in parts))
    size, at = sum(part.shape[-1] for part in parts), 0
    whole = np.zeros((*batch, size, size))
    for part in parts:
        end = at + part.shape[-1]
        whole[..., at:end, at:end] = part
        at = end
    return whole


def _kron(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Kronecker product of the last two axes."""
    both = a[..., :, None, :, None] * b[..., None, :, None, :]
    size = a.shape[-1] * b.shape[-1]
    return np.asarray(both.reshape(*both.shape[:-4], size, size))
