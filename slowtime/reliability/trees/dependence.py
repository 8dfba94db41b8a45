r"""Dependence of member failures: one common factor per group.

Given the common factor of their group, members fail independently. A group is so a set of
values of the factor with weights, and the conditional failure probability of each member at
each of them.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr, ndtri

LARGEST_RHO = 0.999
"""Correlation up to which the common factor is integrated over."""

HALF_WIDTH = 10.0
"""Of the range of the common factor, in standard deviations; 1.5e-23 lies outside."""

WIDEST_PANEL = 0.5
"""Of the quadrature, in standard deviations; narrower where failure is more abrupt."""

PANEL_POINTS = 12
"""Gauss-Legendre points in a panel: the integral is exact to about 1e-12."""

Marginals: TypeAlias = Mapping[str, Float[np.ndarray, " case"]]
"""Of each member, its failure probability in each case."""


class ConditionalMembers(NamedTuple):
    """Members given the values of their common factor.

    Parameters
    ----------
    weights
        Probability of each value, in each case or in all of them; they sum to 1.
    """

    weights: Float[np.ndarray, "value weighting"]
    failing: Mapping[str, Float[np.ndarray, "value case"]]


@dataclasses.dataclass(frozen=True, slots=True)
class Independent:
    """Members that fail independently."""

    members: tuple[str, ...]

    def given(self, marginals: Marginals) -> ConditionalMembers:
        """Condition on nothing: one value with weight 1.

        Parameters
        ----------
        marginals
            Failure probability of each member in each case [1].

        Returns
        -------
        Weights of the values, and the failure probability of each member at each of them.
        """
        failing = {name: np.asarray(marginals[name])[None] for name in self.members}
        return ConditionalMembers(np.ones((1, 1)), failing)

    def draw(
        self, marginals: Mapping[str, float], rng: np.random.Generator, count: int
    ) -> dict[str, Bool[np.ndarray, " case"]]:
        """Draw which members have failed.

        Parameters
        ----------
        marginals
            Failure probability of each member [1].
        rng
            Generator of the draws.
        count
            Number of cases.

        Returns
        -------
        Name of each member → whether it has failed, in each case.
        """
        return {name: rng.random(count) < marginals[name] for name in self.members}


@dataclasses.dataclass(frozen=True, slots=True)
class CommonCause:
    r"""Members that one event makes fail all at once (beta factor).

    The event has the probability :math:`p_c = \beta \min_i p_i`; beside it each member fails
    independently with :math:`(p_i - p_c) / (1 - p_c)`, so that it keeps its probability
    :math:`p_i`. Of equal members this is the beta-factor model: the share :math:`\beta` of
    the failures of each is common to all. Of unequal ones the smallest is taken, since no
    common event can be more probable than the failure of any member.

    References
    ----------
    .. [1] A. Mosleh et al., "Procedures for treating common cause failures in safety and
       reliability studies", NUREG/CR-4780 (1988), section 3.3.
    """

    members: tuple[str, ...]
    beta: float

    def __post_init__(self) -> None:
        _check_group(self.members)
        if not 0.0 <= self.beta <= 1.0:
            raise ValueError(f"beta={self.beta:g} is outside [0, 1]. Give 0.1 for 10 %.")

    def given(self, marginals: Marginals) -> ConditionalMembers:
        """Condition on whether the common event happens."""
        event = self.beta * np.min([marginals[name] for name in self.members], axis=0)
        failing = {
            name: np.stack(
                [_probability_without_event(marginals[name], event), np.ones_like(event)]
            )
            for name in self.members
        }
        return ConditionalMembers(np.stack([1.0 - event, event]), failing)

    def draw(
        self, marginals: Mapping[str, float], rng: np.random.Generator, count: int
    ) -> dict[str, Bool[np.ndarray, " case"]]:
        """Draw which members have failed."""
        least = self.beta * min(marginals[name] for name in self.members)
        event = rng.random(count) < least
        return {
            name: event
            | (rng.random(count) < _probability_without_event(np.array(marginals[name]), least))
            for name in self.members
        }


@dataclasses.dataclass(frozen=True, slots=True)
class Equicorrelated:
    r"""Members whose standard normal safety margins have one pairwise correlation.

    Member i fails where :math:`\sqrt\rho \, Z + \sqrt{1 - \rho} \, \epsilon_i \le
    \Phi^{-1}(p_i)`, so that given the common factor Z

    .. math:: p_i(z) = \Phi\left( \frac{\Phi^{-1}(p_i) - \sqrt\rho \, z}{\sqrt{1 - \rho}}
              \right) .

    References
    ----------
    .. [1] C. W. Dunnett and M. Sobel, "Approximations to the probability integral and certain
       percentage points of a multivariate analogue of Student's t-distribution", Biometrika
       42 (1955) 258-260, for the normal case.
    """

    members: tuple[str, ...]
    rho: float

    def __post_init__(self) -> None:
        _check_group(self.members)
        if not 0.0 <= self.rho <= LARGEST_RHO:
            raise ValueError(
                f"rho={self.rho:g} is outside [0, {LARGEST_RHO:g}]: one common factor makes no "
                "negative correlation. Give 0.3, or a common cause for what fails together."
            )

    def given(self, marginals: Marginals) -> ConditionalMembers:
        """Condition on the values of the common factor, by Gauss-Legendre in panels."""
        z, weights = _factor(self.rho)
        failing = {
            name: self._conditional_probabilities(np.asarray(marginals[name]), z[:, None])
            for name in self.members
        }
        return ConditionalMembers(weights[:, None], failing)

    def _conditional_probabilities(
        self, marginal: Float[np.ndarray, " case"], z: Float[np.ndarray, "value 1"]
    ) -> Float[np.ndarray, "value case"]:
        argument = (ndtri(marginal) - math.sqrt(self.rho) * z) / math.sqrt(1.0 - self.rho)
        return np.asarray(ndtr(argument))

    def draw(
        self, marginals: Mapping[str, float], rng: np.random.Generator, count: int
    ) -> dict[str, Bool[np.ndarray, " case"]]:
        """Draw which members have failed."""
        common = math.sqrt(self.rho) * rng.standard_normal(count)
        own = math.sqrt(1.0 - self.rho)
        return {
            name: common + own * rng.standard_normal(count) <= ndtri(marginals[name])
            for name in self.members
        }


Group: TypeAlias = Independent | CommonCause | Equicorrelated


def grouped(names: tuple[str, ...], groups: tuple[Group, ...]) -> tuple[Group, ...]:
    """Put each member into one group: those of no group into one that is independent.

    Raises `ValueError` where a member is in two groups, or in one but not in the tree.
    """
    found: dict[str, int] = {}
    for number, group in enumerate(groups):
        for name in group.members:
            if name not in names:
                raise ValueError(
                    f"A group of dependent members names {name!r:.80}, which is not in the "
                    f"tree. Allowed: {', '.join(names)[:500]}."
                )
            if found.setdefault(name, number) != number:
                raise ValueError(
                    f"{name!r:.80} is in two groups of dependent members. Put each member "
                    "into one group at most."
                )
    rest = tuple(Independent((name,)) for name in names if name not in found)
    return (*groups, *rest)


def _check_group(members: tuple[str, ...]) -> None:
    if len(members) < 2 or len(set(members)) < len(members):
        raise ValueError(
            f"A group of dependent members was given as {', '.join(members)[:200] or 'none'}. "
            "Name at least two members, each once."
        )


def _probability_without_event(
    marginal: Float[np.ndarray, "*case"], event: Float[np.ndarray, "*case"] | float
) -> Float[np.ndarray, "*case"]:
    """Probability of a failure that is not the common event."""
    rest = 1.0 - np.asarray(event)
    return np.where(rest > 0.0, (marginal - event) / np.where(rest > 0.0, rest, 1.0), 0.0)


def _factor(rho: float) -> tuple[Float[np.ndarray, " value"], Float[np.ndarray, " value"]]:
    """Values and weights of a standard normal factor."""
    if rho == 0.0:
        return np.zeros(1), np.ones(1)
    width = min(WIDEST_PANEL, math.sqrt((1.0 - rho) / rho))
    panels = math.ceil(2.0 * HALF_WIDTH / width)
    x, w = np.polynomial.legendre.leggauss(PANEL_POINTS)
    edges = np.linspace(-HALF_WIDTH, HALF_WIDTH, panels + 1)
    half = 0.5 * np.diff(edges)[:, None]
    z = (edges[:-1, None] + half * (1.0 + x)).ravel()
    weights = (half * w).ravel() * np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)
    return z, weights / weights.sum()
