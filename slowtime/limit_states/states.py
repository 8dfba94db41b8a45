r"""Limit states of a twin: how probable failure is, given what has changed.

Each gives the probability of failure at one moment or load event for given changes, loads and
capacities averaged out (aleatory). A capacity that is unknown but fixed in time keeps an axis
of its own, for whoever survives one event survives the next more probably.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from slowtime.design import AddedStructure, HarmonicLoad, NoiseLoad, RecordedLoad, Response
from slowtime.design.responses import Responses
from slowtime.reliability import Marginal

Changes = Mapping[str, np.ndarray]
"""Quantity → its relative change, all of one shape [...]."""

NODES = 24
"""Gauss-Hermite points of a random load or capacity, in its normal score."""

FAR = 12.0
"""Score beyond which no probability is told from 0."""


@runtime_checkable
class LimitState(Protocol):
    """What fails, and how."""

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the changes that it hangs on."""

    @property
    def events(self) -> float | None:
        """Load events over one unit of slow time; None where the state itself fails."""

    def given(self, changes: Changes) -> tuple[np.ndarray, Float[np.ndarray, " capacity"]]:
        """Probability of failure for each capacity, given the changes.

        Parameters
        ----------
        changes
            Quantity → its relative change, in arrays of one shape [1].

        Returns
        -------
        Probabilities, first axis by capacity, and the weights of the capacities [1].
        """


@dataclasses.dataclass(frozen=True, slots=True)
class Threshold:
    """A change that must not pass a value.

    Parameters
    ----------
    quantity
        Name of the change.
    at
        Value that must not be passed.
    toward
        Side on which it has failed.
    """

    quantity: str
    at: float
    toward: Literal["below", "above"]

    @property
    def quantities(self) -> tuple[str, ...]:
        """The one quantity."""
        return (self.quantity,)

    @property
    def events(self) -> None:
        """No load: the state itself fails."""
        return

    def given(self, changes: Changes) -> tuple[np.ndarray, Float[np.ndarray, " capacity"]]:
        """Tell where the quantity has passed the threshold.

        Parameters
        ----------
        changes
            Quantity → its relative change, in arrays of one shape [1].

        Returns
        -------
        1 where it has and 0 elsewhere, with a first axis of one, and its weight.
        """
        x = changes[self.quantity]
        failed = np.asarray(x <= self.at if self.toward == "below" else x >= self.at)
        return failed[None].astype(float), np.ones(1)


@dataclasses.dataclass(frozen=True, slots=True)
class Resonance:
    r"""A natural frequency that comes near that of an excitation.

    .. math:: f = f_0 \sqrt{(1 + \Delta_k) / (1 + \Delta_m)}

    Parameters
    ----------
    nominal_hz
        Frequency without changes.
    excitation
        Distribution of the frequency of excitation [Hz].
    margin
        Relative distance from it that counts as resonance [1]: 0.1 for 10 %.
    stiffness, mass
        Names of the changes; None for one that does not change.
    """

    nominal_hz: float
    excitation: Marginal
    margin: float
    stiffness: str | None = "stiffness_change"
    mass: str | None = None

    @property
    def quantities(self) -> tuple[str, ...]:
        """Those that change the frequency."""
        return tuple(name for name in (self.stiffness, self.mass) if name is not None)

    @property
    def events(self) -> None:
        """No event: the frequency itself is in the band."""
        return

    def given(self, changes: Changes) -> tuple[np.ndarray, Float[np.ndarray, " capacity"]]:
        """Probability that the excitation lies within the margin of the frequency.

        Parameters
        ----------
        changes
            Quantity → its relative change, in arrays of one shape [1].

        Returns
        -------
        Probabilities, with a first axis of one, and its weight [1].
        """
        factor = np.ones_like(changes[self.quantities[0]])
        if self.stiffness is not None:
            factor = factor * np.maximum(1.0 + changes[self.stiffness], 0.0)
        if self.mass is not None:
            factor = factor / np.maximum(1.0 + changes[self.mass], 1e-9)
        hz = self.nominal_hz * np.sqrt(factor)
        law = self.excitation.law
        inside = law.cdf(hz * (1.0 + self.margin)) - law.cdf(hz * (1.0 - self.margin))
        return np.asarray(inside)[None], np.ones(1)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ResponseLimit:
    r"""A response to a load event that must not exceed a capacity.

    Under noise of a duration T, peaks follow Poisson crossings of either side, so that an
    event fails with

    .. math:: 1 - \exp\left(-\nu T e^{-R^2 / (2 I^2 \sigma^2)}\right)

    at an intensity I and a capacity R; under a steady or recorded load it fails where
    :math:`I\,|r| \ge R`.

    Parameters
    ----------
    structure
        Whose `factors` are stiffness parts, in the order of `names`.
    names
        Of the changes that multiply these parts.
    load, response
        One event, and the number that counts; a `peak` has a duration under noise.
    capacity
        Distribution of what the response must stay below, in its unit; a number is certain.
    rate
        Events over one unit of slow time.
    intensity
        Random factor of the load, drawn anew at each event; None for 1.
    """

    structure: AddedStructure
    names: tuple[str, ...]
    load: NoiseLoad | HarmonicLoad | RecordedLoad
    response: Response
    capacity: Marginal | float
    rate: float
    intensity: Marginal | None = None

    @property
    def quantities(self) -> tuple[str, ...]:
        """The stiffnesses that change."""
        return self.names

    @property
    def events(self) -> float:
        """Load events over one unit of slow time."""
        return self.rate

    def given(self, changes: Changes) -> tuple[np.ndarray, Float[np.ndarray, " capacity"]]:
        """Probability that one event exceeds each capacity.

        Parameters
        ----------
        changes
            Quantity → its relative change, in arrays of one shape [1].

        Returns
        -------
        Probabilities, first axis by capacity, and the weights of the capacities [1].
        """
        shape = changes[self.names[0]].shape
        factors = np.stack([1.0 + changes[name].ravel() for name in self.names], axis=1)
        # A stiffness of nothing has no stationary response: such a part has failed.
        gone: np.ndarray = np.any(factors <= 1e-6, axis=1)
        size, crossings = self._sizes(np.where(gone[:, None], 1.0, factors))
        capacities, weights = _nodes(self.capacity)
        intensities, shares = _nodes(self.intensity if self.intensity is not None else 1.0)
        found = np.zeros((len(capacities), len(size)))
        for row, capacity in enumerate(capacities):
            for one, share in zip(intensities, shares, strict=True):
                found[row] += share * _exceeds(abs(one) * size, crossings, capacity)
        found[:, gone] = 1.0
        return found.reshape(len(capacities), *shape), weights

    def _sizes(self, factors: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Compute sd and crossings of an event; or the size alone, of a sure load."""
        rows = len(factors)
        d, one, none = np.zeros((rows, 0)), np.ones(rows), np.zeros((rows, 0))
        if not isinstance(self.load, NoiseLoad):
            size = Responses(self.structure, self.load, [self.response])(d, factors, one, none)
            return size[:, 0], None
        rms = dataclasses.replace(self.response, statistic="rms")
        sd, rate = Responses(self.structure, self.load, [rms]).stationary(d, factors)
        duration = self.response.duration_s
        assert duration is not None
        return sd[:, 0], rate[:, 0] / (math.pi * sd[:, 0]) * duration


def _exceeds(
    size: np.ndarray, crossings: np.ndarray | None, capacity: float
) -> Float[np.ndarray, " row"]:
    if crossings is None:
        return np.asarray((size >= capacity).astype(float))
    with np.errstate(divide="ignore", over="ignore"):
        ratio = np.where(size > 0.0, capacity / np.where(size > 0.0, size, 1.0), np.inf)
    passed = crossings * np.exp(-0.5 * np.maximum(ratio, 0.0) ** 2)
    return np.asarray(-np.expm1(-passed) if capacity > 0.0 else np.ones_like(size))


def _nodes(law: Marginal | float) -> tuple[Float[np.ndarray, " node"], np.ndarray]:
    """Values and weights that stand for a distribution."""
    if not isinstance(law, Marginal):
        return np.array([float(law)]), np.ones(1)
    z, weights = np.polynomial.hermite_e.hermegauss(NODES)
    return np.asarray(law.of_score(z)), np.asarray(weights / weights.sum())


def normal_index(probability: np.ndarray) -> np.ndarray:
    r"""Reliability index :math:`\beta = -\Phi^{-1}(P_f)`, at most `FAR` in size.

    Parameters
    ----------
    probability
        Failure probabilities, of any shape [1].

    Returns
    -------
    Indices, of the same shape [1].
    """
    clipped = np.clip(probability, float(ndtr(-FAR)), 1.0 - 1e-16)
    return np.asarray(-ndtri(clipped))
