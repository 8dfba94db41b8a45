r"""Sensors whose measured modes tell most about the parameters of a model.

A mode seen by the sensors S has frequency and shape. The factor of a shape is unknown and is a
parameter of its own; so are those of all modes close to it, among which its shape turns. With
prior-whitened parameters the information is a sum over sensors,

.. math:: H(S) = H_0 + \sum_{s \in S} U_s U_s^T, \qquad
          U_s^T = \frac{1}{\sigma} \Big[ \frac{\partial x_{sj}}{\partial \theta} \sigma_\theta,
          \; x_{sr} e_{jr} \Big]_j ,

and the parameters have information :math:`H_{\theta\theta} - H_{\theta a} H_{aa}^{-1}
H_{a\theta}` beside the factors a. Its determinant is maximised (D-optimality), or the trace of
its inverse minimised (A-optimality), greedily and then by exchanges of single sites.

For damage, two states are compared and each parameter is tested alone: the loss of one that is
found is, to first order, inversely proportional to the root of its diagonal entry of that
information without the prior, the others being as before. The largest of these losses is
minimised (a minimax design), with a common change of all stiffness, as by
temperature, as a further factor.

References
----------
.. [1] D. C. Kammer, "Sensor placement for on-orbit modal identification and correlation of
   large space structures", J. Guidance, Control, and Dynamics 14 (1991).
.. [2] C. Papadimitriou, "Optimal sensor placement methodology for parametric identification of
   structural systems", J. Sound and Vibration 278 (2004).
.. [3] V. V. Fedorov, "Theory of Optimal Experiments", Academic Press (1972) (exchanges).
"""

import dataclasses
import functools
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from slowtime.finite_elements.close_modes import close_groups

from .fit import check_prior
from .updatable_models import SensedModes, UpdatableModel

FREE = 1e-9
"""Prior information on the factor of a shape, over that of all sensors together [1]: so little
that one sensor alone says nothing about a shape."""

BETTER = 1e-6
"""Increase over that by the site in place [1] below which exchanges end."""

Criterion = Literal["determinant", "variance", "detection"]
"""Determinant of the information (D-optimality), sum of the posterior variances (A), or largest
loss of a parameter alone that is just found."""

_FINDABLE = 3.0
"""Standard deviations [1] by which the loss of all stiffness of a parameter must show at all
candidates together; others are found by no plan and are left out of the largest loss."""

_SHARE_OF_ALL = 0.01
"""Weight [1] of the mean loss beside the largest, so that sites still differ where none of them
helps the parameter with the largest."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ModePrecision:
    """How well modes will be measured.

    Parameters
    ----------
    modes
        Number of lowest modes.
    frequency_sd
        Relative standard deviation of a frequency [1].
    shape_sd
        Standard deviation of a component of a shape over the largest component that any
        candidate sees of it [1].
    """

    modes: int
    frequency_sd: float = 0.002
    shape_sd: float = 0.02

    def __post_init__(self) -> None:
        """Refuse values without a meaning."""
        if not (self.modes > 0 and self.frequency_sd > 0.0 and self.shape_sd > 0.0):
            raise ValueError(
                f"modes={self.modes}, frequency_sd={self.frequency_sd}, "
                f"shape_sd={self.shape_sd}. Allowed are positive values."
            )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Chosen sites, best first, and what measurements there will tell.

    Parameters
    ----------
    sites
        Positions of the chosen sites.
    names
        Of the parameters.
    prior_sd, posterior_sd
        Standard deviations of the logarithms of the factors on the parts [1]; the second as
        expected with the sensors, to first order.
    gain
        Logarithm of the determinant of the information over that of the prior [1].
    """

    sites: tuple[int, ...]
    names: tuple[str, ...]
    prior_sd: Float[np.ndarray, " parameter"]
    posterior_sd: Float[np.ndarray, " parameter"]
    gain: float

    @property
    def ratio(self) -> Float[np.ndarray, " parameter"]:
        """Posterior over prior standard deviation: 1 where nothing will be learnt."""
        free = self.prior_sd > 0.0
        return np.where(free, self.posterior_sd / np.where(free, self.prior_sd, 1.0), 0.0)


class PlacementProblem:
    """Information that each site would give about the parameters.

    Parameters
    ----------
    model
        The model, at nominal parameters.
    sensors
        What each candidate sensor sees of the degrees of freedom.
    sites
        Site of each sensor, counted from 0; sensors of one site come together, such as the
        three of a triaxial accelerometer.
    precision
        How well modes will be measured.
    prior_sd
        Prior standard deviations of the logarithms of the factors [1].
    common_sd
        Standard deviation of the logarithm of a common factor on all stiffness, which is no
        parameter [1].
    """

    def __init__(
        self,
        model: UpdatableModel,
        sensors: Float[np.ndarray, "sensor dof"],
        sites: Int[np.ndarray, " sensor"],
        precision: ModePrecision,
        prior_sd: Float[np.ndarray, " parameter"] | float = 0.3,
        common_sd: float = 0.0,
    ) -> None:
        sd = check_prior(model, prior_sd)
        if len(sites) != len(sensors) or set(sites.tolist()) != set(range(len(set(sites)))):
            raise ValueError(
                f"{len(sites)} sites for {len(sensors)} sensors. Give each sensor the number "
                "of its site, counted from 0 without gaps."
            )
        modes = model.sensed_modes(np.zeros(len(sd)), sensors, precision.modes)
        count = min(precision.modes, len(modes.eigenvalue))
        self.names, self.prior_sd = model.names, sd
        self.sites, self._parts = int(sites.max()) + 1, len(sd)
        frequency = modes.log_frequency_slope[:count] * sd / precision.frequency_sd
        rows = _rows(modes, count, precision.shape_sd, sd)
        each = np.bincount(sites, minlength=self.sites)
        if len(set(each.tolist())) > 1:
            raise ValueError(
                f"Sites have {each.min()} to {each.max()} sensors. Give each the same number."
            )
        order = np.argsort(sites, kind="stable")
        self._blocks = rows[order].reshape(self.sites, -1, rows.shape[2])
        start = np.eye(rows.shape[2])
        # Frequencies are as the root of a common factor on all stiffness.
        common = np.full((count, 1), 0.5 * common_sd / precision.frequency_sd)
        known = np.hstack([frequency, common])
        start[: len(sd) + 1, : len(sd) + 1] += known.T @ known
        power = np.sum(rows[:, :, len(sd) + 1 :] ** 2, axis=(0, 1))
        factors = range(len(sd) + 1, len(start))
        start[factors, factors] = FREE * np.where(power > 0, power, 1.0)
        self._start = start

    def information(self, chosen: tuple[int, ...]) -> Float[np.ndarray, "all all"]:
        """Information on parameters and factors with sensors at some sites."""
        rows = self._blocks[list(chosen)].reshape(-1, len(self._start))
        return np.asarray(self._start + rows.T @ rows)

    def placement(self, chosen: tuple[int, ...]) -> Placement:
        """Say what measurements at some sites will tell.

        Parameters
        ----------
        chosen
            Positions of the sites.

        Returns
        -------
        The placement with its expected posterior.
        """
        covariance = np.linalg.inv(self.information(chosen))[: self._parts, : self._parts]
        posterior = self.prior_sd * np.sqrt(np.diag(covariance))
        gain = -float(np.linalg.slogdet(covariance)[1])
        return Placement(chosen, self.names, self.prior_sd, posterior, gain)

    def gains(
        self,
        chosen: tuple[int, ...],
        open_sites: Int[np.ndarray, " open"],
        criterion: Criterion,
    ) -> Float[np.ndarray, " open"]:
        r"""Increase of the criterion by each of several sites.

        By the determinant lemma, :math:`\ln \det (I + U^T H^{-1} U)` less what the factors of
        the shapes gain by themselves; or by Woodbury's identity the fall of the sum of the
        posterior variances.

        Parameters
        ----------
        chosen
            Sites chosen so far.
        open_sites
            Sites to try.
        criterion
            What is to grow.

        Returns
        -------
        Increase by each [1].
        """
        information, blocks = self.information(chosen), self._blocks[open_sites]
        if criterion == "detection":
            added = np.swapaxes(blocks, 1, 2) @ blocks
            return np.asarray(
                self._largest_loss(information) - self._largest_loss(information + added)
            )
        if criterion == "determinant":
            factors = blocks[:, :, self._parts :]
            whole = _growth(blocks, information)
            own = _growth(factors, information[self._parts :, self._parts :])
            return np.asarray(whole - own)
        spread = blocks @ np.linalg.inv(information)
        inner = np.eye(blocks.shape[1]) + spread @ np.swapaxes(blocks, 1, 2)
        own = spread[:, :, : self._parts] * self.prior_sd
        return np.asarray(np.sum(own * np.linalg.solve(inner, own), axis=(1, 2)))

    def largest_loss(self, chosen: tuple[int, ...]) -> float:
        """Largest loss that one standard deviation of a parameter alone is [1].

        Parameters
        ----------
        chosen
            Sites with sensors.

        Returns
        -------
        The largest over the parameters that sensors at all sites would find, with a small
        share of the mean.
        """
        return float(self._largest_loss(self.information(chosen)))

    def _largest_loss(self, information: Float[np.ndarray, "*set all all"]) -> np.ndarray:
        losses = self._losses(information)[..., self._findable]
        return np.asarray(losses.max(axis=-1) + _SHARE_OF_ALL * losses.mean(axis=-1))

    def _losses(self, information: Float[np.ndarray, "*set all all"]) -> np.ndarray:
        """Loss of each parameter alone that is one standard deviation [1]."""
        own = np.diagonal(information, axis1=-2, axis2=-1)[..., : self._parts] - 1.0
        cross = information[..., self._parts :, : self._parts]
        solved = np.linalg.solve(information[..., self._parts :, self._parts :], cross)
        power = np.maximum(own - np.sum(cross * solved, axis=-2), 1e-300)
        return np.asarray(self.prior_sd / np.sqrt(power))

    @functools.cached_property
    def _findable(self) -> Bool[np.ndarray, " parameter"]:
        losses = self._losses(self.information(tuple(range(self.sites))))
        found = (self.prior_sd > 0.0) & (losses < 1.0 / _FINDABLE)
        return found if found.any() else np.ones(len(losses), dtype=bool)


def _growth(blocks: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Logarithm of det(I + U^T H^-1 U) for the rows of each block."""
    inner = blocks @ np.linalg.inv(information) @ np.swapaxes(blocks, 1, 2)
    return np.asarray(np.linalg.slogdet(np.eye(blocks.shape[1]) + inner)[1])


def _rows(
    modes: SensedModes, count: int, shape_sd: float, prior_sd: np.ndarray
) -> Float[np.ndarray, "sensor mode all"]:
    """Find what each sensor tells of each mode, by parameters and factors of shapes."""
    sensed, parts = modes.sensed, len(prior_sd)
    largest = np.abs(sensed[:, :count]).max(axis=0)
    weight = 1.0 / (np.where(largest > 0.0, largest, 1.0) * shape_sd)
    pairs = [
        (j, r)
        for group in close_groups(modes.frequency_hz)
        for j in group
        if j < count
        for r in group
    ]
    # No sensor sees a common factor on all stiffness, which leaves shapes as they are.
    rows = np.zeros((len(sensed), count, parts + 1 + len(pairs)))
    for column, (j, r) in enumerate(pairs):
        rows[:, j, parts + 1 + column] = weight[j] * sensed[:, r]
    for j in range(count):
        own = sensed[:, [r for i, r in pairs if i == j]]
        slope = modes.sensed_slope[:, j] * prior_sd
        # A turn among close shapes is taken by their factors; it may be of any size.
        rows[:, j, :parts] = weight[j] * (slope - own @ np.linalg.lstsq(own, slope)[0])
    return rows


def place_sensors(
    problem: PlacementProblem,
    number: int,
    *,
    fixed: tuple[int, ...] = (),
    criterion: Criterion = "determinant",
) -> Placement:
    """Choose sites for sensors by greedy additions, then by exchanges.

    Parameters
    ----------
    problem
        Candidates, and what each would tell.
    number
        Number of sites to choose, fixed ones among them.
    fixed
        Sites that have a sensor already.
    criterion
        `determinant` weighs all directions of the parameters alike, `variance` minimises the
        mean of their posterior variances, `detection` the largest loss of a parameter alone
        that is just found. The last is rugged; exchanges also start from the sites of the
        other two.

    Returns
    -------
    The sites, fixed ones first, with what they will tell.

    Raises
    ------
    ValueError
        Where there are fewer candidates.
    """
    if not len(fixed) <= number <= problem.sites or len(set(fixed)) < len(fixed):
        raise ValueError(
            f"{number} sites were asked for, {len(set(fixed))} of them fixed. Allowed are "
            f"{len(set(fixed))} to {problem.sites}, the number of candidates."
        )
    chosen = _added(problem, number, fixed, criterion)
    if criterion != "detection":
        return problem.placement(_exchanged(problem, chosen, len(fixed), criterion))
    starts = [chosen]
    others: tuple[Criterion, ...] = ("determinant", "variance")
    for other in others:
        start = _added(problem, number, fixed, other)
        starts.append([*_exchanged(problem, start, len(fixed), other)])
    found = [_exchanged(problem, one, len(fixed), criterion) for one in starts]
    return problem.placement(min(found, key=problem.largest_loss))


def _added(
    problem: PlacementProblem, number: int, fixed: tuple[int, ...], criterion: Criterion
) -> list[int]:
    """Add sites one by one, each time the one that adds most."""
    chosen = list(fixed)
    while len(chosen) < number:
        # One sensor tells nothing of a shape; the determinant still ranks first sites.
        early = "determinant" if len(chosen) < 2 else criterion
        chosen.append(_best(problem, chosen, early)[0])
    return chosen


def _exchanged(
    problem: PlacementProblem, chosen: list[int], fixed: int, criterion: Criterion
) -> tuple[int, ...]:
    """Exchange single sites, all but the first that are fixed, until none adds more."""
    chosen, improved = [*chosen], True
    while improved:
        improved = False
        for place in range(fixed, len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            site, gains = _best(problem, others, criterion)
            if gains[site] > (1 + BETTER) * gains[chosen[place]]:
                chosen[place], improved = site, True
    return tuple(chosen)


def _best(
    problem: PlacementProblem, chosen: list[int], criterion: Criterion
) -> tuple[int, dict[int, float]]:
    """Site that adds most to those chosen, and what each adds."""
    free = np.setdiff1d(np.arange(problem.sites), chosen)
    found = problem.gains(tuple(chosen), free, criterion).tolist()
    gains = dict(zip(free.tolist(), found, strict=True))
    return max(gains, key=lambda site: gains[site]), gains
