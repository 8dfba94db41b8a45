r"""Whether measured shapes scatter about the updated model by as much as they are said to.

With r numbers left over after the factors of the shapes and the parameters are fitted, the sum
of squared residuals of the shapes is chi-square distributed with r degrees of freedom, if their
standard deviations hold and the model is right. Where it is far larger, the deviations are
multiplied by :math:`\sqrt{\chi^2 / r}` (Birge's ratio) and the parameters are estimated again.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from slowtime.finite_elements.close_modes import close_groups

from .fit import StructurePosterior, estimate, total_misfit
from .measured_modes import MeasuredModes
from .updatable_models import UpdatableModel

CLEAR = 1.5
"""Scatter over standard deviation [1] above which it counts; as for the baselines of a twin."""

UNLIKELY = 0.01
"""Probability of a scatter as large [1], below which it counts."""

ROUNDS = 5
"""Most times that deviations are multiplied. A wider shape moves the parameters, and these the
residuals; two or three are enough in all tests."""

SETTLED = 1.1
"""Ratio of the scatter to the deviations [1] within which they are left; that of 60 numbers has
a standard deviation of 9 %."""


@dataclasses.dataclass(frozen=True, slots=True)
class ShapeScatter:
    """Scatter of measured shapes about an updated model.

    Parameters
    ----------
    chi_square
        Sum of squared residuals of shapes, in the standard deviations that they came with [1].
    count
        Numbers of shapes left over after fitting [1].
    factor
        By which the deviations were multiplied [1]; 1 where they were kept.
    """

    chi_square: float
    count: float
    factor: float = 1.0

    @property
    def ratio(self) -> float:
        """Root mean square of the residuals in standard deviations [1]."""
        return float(np.sqrt(self.chi_square / self.count)) if self.count > 0.0 else 1.0

    @property
    def is_excessive(self) -> bool:
        """Whether the deviations are far too small for the residuals."""
        if not self.count > 0.0:
            return False
        return self.ratio > CLEAR and float(chdtrc(self.count, self.chi_square)) < UNLIKELY

    @property
    def sentence(self) -> str:
        """What is said to the user; empty where the deviations were kept."""
        if self.factor == 1.0:
            return ""
        return (
            "Standard deviations of the shapes are far too small: their residuals have "
            f"chi-square {self.chi_square:.3g} for {self.count:.3g} numbers. They were "
            f"multiplied by {self.factor:.2g}, so that the parameters are less certain. Give "
            "--shape-error where the model is known to be inexact."
        )


def shape_scatter(
    structure: UpdatableModel, sets: Sequence[MeasuredModes], found: StructurePosterior
) -> ShapeScatter:
    """Compare the residuals of the shapes with their number.

    Parameters
    ----------
    structure, sets
        The model and the measured modes.
    found
        Posterior of its parameters from these.

    Returns
    -------
    Sum of squares and the numbers left over, of the most probable parameters.
    """
    total, left = 0.0, 0.0
    misfit = total_misfit(structure, sets, found.theta, found.prior_sd)
    whitened = misfit.slope * found.prior_sd
    inverse = found.optima[0].covariance / np.outer(
        *(2 * [np.where(found.prior_sd > 0.0, found.prior_sd, np.inf)])
    )
    leverage = np.einsum("rp,pq,rq->r", whitened, inverse, whitened)
    start = first_pair = 0
    for one in sets:
        count = len(one.frequency_hz)
        rows = _shape_rows(one)
        inside = slice(start + count, start + count + sum(rows))
        total += float(misfit.residual[inside] @ misfit.residual[inside])
        left -= float(leverage[inside].sum())
        if sum(rows):
            pairs = misfit.pairs[first_pair : first_pair + count]
            left += sum(rows) - _fitted(structure, one, found, pairs, rows)
        start, first_pair = inside.stop, first_pair + count
    return ShapeScatter(total, left)


def estimate_with_scatter(
    structure: UpdatableModel,
    measured: MeasuredModes | Sequence[MeasuredModes],
    prior_sd: Float[np.ndarray, " parameter"] | float = 0.3,
    *,
    starts: int = 8,
) -> tuple[StructurePosterior, ShapeScatter]:
    """Estimate parameters, and again with wider shapes where these scatter far more than said.

    Parameters
    ----------
    structure, measured, prior_sd, starts
        As for `estimate`.

    Returns
    -------
    The posterior, and the scatter of the shapes with the factor on their deviations.
    """
    sets = (measured,) if isinstance(measured, MeasuredModes) else tuple(measured)
    found = estimate(structure, sets, prior_sd, starts=starts)
    scatter = shape_scatter(structure, sets, found)
    if not scatter.is_excessive:
        return found, scatter
    factor = 1.0
    for _ in range(ROUNDS):
        # Deviations that are too small also make false optima; the ratio may fall again.
        factor = max(1.0, factor * scatter.ratio)
        wider = tuple(_widened(one, factor) for one in sets)
        found = estimate(structure, wider, prior_sd, starts=starts)
        scatter = shape_scatter(structure, wider, found)
        if 1.0 / SETTLED < scatter.ratio < SETTLED:
            break
    return found, ShapeScatter(scatter.chi_square * factor**2, scatter.count, factor)


def _widened(measured: MeasuredModes, factor: float) -> MeasuredModes:
    if measured.shape_sd is None:
        return measured
    return dataclasses.replace(measured, shape_sd=factor * measured.shape_sd)


def _shape_rows(measured: MeasuredModes) -> list[int]:
    """Components of each shape that were measured."""
    if measured.shapes is None or measured.shape_sd is None:
        return []
    known = np.isfinite(measured.shapes) & np.isfinite(measured.shape_sd)
    return [int(n) for n in known.sum(axis=1)]


def _fitted(
    structure: UpdatableModel,
    measured: MeasuredModes,
    found: StructurePosterior,
    pairs: np.ndarray,
    rows: list[int],
) -> int:
    """Count the factors that were fitted to the shapes: one, or one for each close mode."""
    highest = max(int(pairs.max()) + 1, len(pairs)) + 1
    modes = structure.sensed_modes(
        found.theta, measured.seen_by(structure), highest, measured.added_mass
    )
    size = {r: len(group) for group in close_groups(modes.frequency_hz) for r in group}
    own = [size[int(r)] - (measured.scaled and size[int(r)] == 1) for r in pairs]
    return sum(min(n, k) for n, k in zip(rows, own, strict=True))
