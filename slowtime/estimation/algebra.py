r"""Gaussian processes over time as small linear systems: an algebra of kernels, exact.

A stationary process of covariance :math:`k(\tau)` is seen through a state that moves by
:math:`A(\tau)` and keeps the covariance S, :math:`k(\tau) = h A(|\tau|) S h^T` (Hartikainen and
Särkkä, 2010). Sums of processes are states side by side, products are Kronecker products
(Solin and Särkkä, 2014). Every process also gives the slopes of A and S to the logarithms of
its parameters. Parameters may be arrays, one entry per member of a family.
"""

import abc
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .matern import Belief

Slopes = list[np.ndarray]
"""Of a matrix, to the logarithm of each free parameter."""


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
        """Row that maps the state to the process, at each time.

        Parameters
        ----------
        time
            Times, in the unit of time.

        Returns
        -------
        Rows [time, family, state]; the same at all times unless the process depends on the
        clock.
        """
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
    def initial_covariance(self) -> tuple[np.ndarray, Slopes]:
        """Covariance of the state before any reading, and its slopes."""

    def start(self, time: float) -> Belief:
        """Belief before any reading.

        Parameters
        ----------
        time
            Time of the belief, no later than the first reading.

        Returns
        -------
        Mean and covariance of the state.
        """
        own, _ = self.initial_covariance()
        return Belief(float(time), np.zeros(own.shape[:-1]), own)

    @abc.abstractmethod
    def moves(self, step: Float[np.ndarray, " time"]) -> tuple[np.ndarray, Slopes]:
        """Compute the transitions of the state over time steps, and their slopes.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.

        Returns
        -------
        Transitions [time, family, state, state], and their slopes to the logarithms of the free
        parameters.
        """

    def noises(
        self, step: Float[np.ndarray, " time"], move: np.ndarray, slopes: Slopes
    ) -> tuple[np.ndarray, Slopes]:
        """Compute the process noise over time steps, and its slopes.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.
        move
            Transitions over the steps [time, family, state, state].
        slopes
            Slopes of the transitions to the logarithms of the free parameters.

        Returns
        -------
        Covariances [time, family, state, state], and their slopes to the logarithms of the free
        parameters.
        """
        own, own_slopes = self.initial_covariance()
        turned = np.swapaxes(move, -1, -2)
        noise = own - move @ own @ turned
        found = []
        for of_own, of_move in zip(own_slopes, slopes, strict=True):
            half = of_move @ own @ turned
            found.append(of_own - move @ of_own @ turned - half - np.swapaxes(half, -1, -2))
        return noise, found

    def advance(self, step: Float[np.ndarray, " time"]) -> tuple[np.ndarray, np.ndarray]:
        """Compute transition and process noise over time steps.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.

        Returns
        -------
        Transitions and covariances [time, family, state, state].

        Raises
        ------
        ValueError
            Where a step is negative.
        """
        _check_ascending(step)
        move = self.transitions(step)
        return move, self._noise(step, move)

    def transitions(self, step: Float[np.ndarray, " time"]) -> np.ndarray:
        """Compute the transitions of the state over time steps, without their slopes.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.

        Returns
        -------
        Transitions [time, family, state, state].
        """
        return self.moves(step)[0]

    def transition_over(self, step: float) -> np.ndarray:
        """Compute the transition of the state over one time step.

        Parameters
        ----------
        step
            Time step, in the unit of time.

        Returns
        -------
        Transition [family, state, state].
        """
        return np.asarray(self.transitions(np.array([step]))[0])

    def _noise(self, step: Float[np.ndarray, " time"], move: np.ndarray) -> np.ndarray:
        """Process noise over the same steps, without its slopes."""
        own = self.initial_covariance()[0]
        return np.asarray(own - move @ own @ np.swapaxes(move, -1, -2))

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
        move = self.moves(np.abs(apart).ravel())[0]
        return np.asarray(
            (seen @ move @ self.initial_covariance()[0] @ seen).reshape(apart.shape)
        )

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
        """Make the same kind of process with other parameters.

        Parameters
        ----------
        logs
            Logarithms of the free parameters [family, parameter].

        Returns
        -------
        The process, or family of processes.
        """
        values = np.exp(np.moveaxis(logs, -1, 0))
        return dataclasses.replace(self, **dict(zip(self.free, values, strict=True)))

    def _chosen(self, slopes: dict[str, np.ndarray], like: np.ndarray) -> Slopes:
        return [slopes.get(name, np.zeros_like(like)) for name in self.free]


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
        """Row that maps the state to the process, at each time.

        Parameters
        ----------
        time
            Times, in the unit of time.

        Returns
        -------
        Rows [time, family, state]; the same at all times unless the process depends on the
        clock.
        """
        parts = [term.observation_row(time) for term in self.terms]
        most = max(part.ndim for part in parts)
        parts = [p.reshape(len(p), *(1,) * (most - p.ndim), *p.shape[1:]) for p in parts]
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
        """Make the same kind of process with other parameters.

        Parameters
        ----------
        logs
            Logarithms of the free parameters [family, parameter].

        Returns
        -------
        The process, or family of processes.
        """
        return dataclasses.replace(self, terms=_split(self.terms, logs))

    def part(self, number: int) -> Float[np.ndarray, " state"]:
        """Tell what of the state is the term of this number alone."""
        seen = [term.observation * (i == number) for i, term in enumerate(self.terms)]
        return np.concatenate(seen)

    def initial_covariance(self) -> tuple[np.ndarray, Slopes]:
        """See `Process`."""
        return _blocks([term.initial_covariance() for term in self.terms])

    def moves(self, step: np.ndarray) -> tuple[np.ndarray, Slopes]:
        """Compute the transitions of the state over time steps, and their slopes.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.

        Returns
        -------
        Transitions [time, family, state, state], and their slopes to the logarithms of the free
        parameters.
        """
        return _blocks(_aligned([term.moves(step) for term in self.terms]))

    def noises(
        self, step: np.ndarray, move: np.ndarray, slopes: Slopes
    ) -> tuple[np.ndarray, Slopes]:
        """Compute the process noise over time steps, and its slopes.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.
        move
            Transitions over the steps [time, family, state, state].
        slopes
            Slopes of the transitions to the logarithms of the free parameters.

        Returns
        -------
        Covariances [time, family, state, state], and their slopes to the logarithms of the free
        parameters.
        """
        parts = [term.noises(step, *term.moves(step)) for term in self.terms]
        return _blocks(_aligned(parts))

    def transitions(self, step: np.ndarray) -> np.ndarray:
        """Compute the transitions of the state over time steps, without their slopes.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.

        Returns
        -------
        Transitions [time, family, state, state].
        """
        return _blocks(_aligned([(term.transitions(step), []) for term in self.terms]))[0]

    def transition_over(self, step: float) -> np.ndarray:
        """Compute the transition of the state over one time step.

        Parameters
        ----------
        step
            Time step, in the unit of time.

        Returns
        -------
        Transition [family, state, state].
        """
        return _blocks([(term.transition_over(step), []) for term in self.terms])[0]

    def _noise(self, step: np.ndarray, move: np.ndarray) -> np.ndarray:
        parts = [term._noise(step, term.transitions(step)) for term in self.terms]
        return _blocks(_aligned([(part, []) for part in parts]))[0]


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
        """Make the same kind of process with other parameters.

        Parameters
        ----------
        logs
            Logarithms of the free parameters [family, parameter].

        Returns
        -------
        The process, or family of processes.
        """
        first, second = _split((self.first, self.second), logs)
        return dataclasses.replace(self, first=first, second=second)

    def initial_covariance(self) -> tuple[np.ndarray, Slopes]:
        """See `Process`."""
        return _kron(self.first.initial_covariance(), self.second.initial_covariance())

    def moves(self, step: np.ndarray) -> tuple[np.ndarray, Slopes]:
        """Compute the transitions of the state over time steps, and their slopes.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.

        Returns
        -------
        Transitions [time, family, state, state], and their slopes to the logarithms of the free
        parameters.
        """
        return _kron(*_aligned([self.first.moves(step), self.second.moves(step)]))

    def transitions(self, step: np.ndarray) -> np.ndarray:
        """Compute the transitions of the state over time steps, without their slopes.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.

        Returns
        -------
        Transitions [time, family, state, state].
        """
        parts: list[tuple[np.ndarray, Slopes]]
        parts = [(one.transitions(step), []) for one in (self.first, self.second)]
        return _kron(*_aligned(parts))[0]

    def transition_over(self, step: float) -> np.ndarray:
        """Compute the transition of the state over one time step.

        Parameters
        ----------
        step
            Time step, in the unit of time.

        Returns
        -------
        Transition [family, state, state].
        """
        return _times(self.first.transition_over(step), self.second.transition_over(step))


def _terms(process: Process) -> tuple[Process, ...]:
    return process.terms if isinstance(process, Sum) else (process,)


def _check_ascending(step: np.ndarray) -> None:
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


def _aligned(parts: Sequence[tuple[np.ndarray, Slopes]]) -> list[tuple[np.ndarray, Slopes]]:
    """Give all as many axes of a family, between the one of time and the matrices."""
    most = max(matrix.ndim for matrix, _ in parts)

    def widened(matrix: np.ndarray) -> np.ndarray:
        missing = (1,) * (most - matrix.ndim)
        return matrix.reshape(matrix.shape[0], *missing, *matrix.shape[1:])

    return [(widened(matrix), [widened(each) for each in own]) for matrix, own in parts]


def _blocks(parts: Sequence[tuple[np.ndarray, Slopes]]) -> tuple[np.ndarray, Slopes]:
    batch = np.broadcast_shapes(*(matrix.shape[:-2] for matrix, _ in parts))
    size = sum(matrix.shape[-1] for matrix, _ in parts)
    whole, slopes, at = np.zeros((*batch, size, size)), [], 0
    for matrix, own in parts:
        place = np.s_[..., at : at + matrix.shape[-1], at : at + matrix.shape[-1]]
        whole[place] = matrix
        for each in own:
            slope = np.zeros_like(whole)
            slope[place] = each
            slopes.append(slope)
        at += matrix.shape[-1]
    return whole, slopes


def _kron(
    first: tuple[np.ndarray, Slopes], second: tuple[np.ndarray, Slopes]
) -> tuple[np.ndarray, Slopes]:
    slopes = [_times(each, second[0]) for each in first[1]]
    slopes += [_times(first[0], each) for each in second[1]]
    return _times(first[0], second[0]), slopes


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Kronecker product of the last two axes."""
    both = a[..., :, None, :, None] * b[..., None, :, None, :]
    size = a.shape[-1] * b.shape[-1]
    return np.asarray(both.reshape(*both.shape[:-4], size, size))
