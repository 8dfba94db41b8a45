r"""Losses of members → the change of the modes that they make.

The model is first fitted to the modes before, with the stated error of the stiffness of each
member as prior. About these parameters :math:`\theta` it predicts the change of the rows

.. math:: d(a) = h(\theta + \ln(1 - a)) - h(\theta)

by solving the eigenproblem again. What is not known of :math:`\theta`, with covariance C, makes
errors of the prediction of which those of both states cancel to first order:

.. math:: \Sigma(a) = (G(a) - G(0)) \, C \, (G(a) - G(0))^T, \qquad
          G(a) = \partial h / \partial \theta \,|_{\theta + \ln(1 - a)}

Without a change the errors of the model cancel altogether.
"""

import dataclasses
import functools

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from slowtime.evolution.structures import MeasuredModes, UpdatableModel
from slowtime.evolution.structures.fit import optimise_from
from slowtime.evolution.structures.updatable_models import SensedModes

from .state_difference import StateDifference

FREQUENCY_SPREAD, SHAPE_SPREAD = 0.03, 0.05
"""Error of ln f [1], and of 1 - MAC [1], of a predicted mode that is the measured one: those of
changes that are not fitted yet."""

_BEYOND = 4
"""Modes of the model beyond as many as were measured, for pairing, as in updating."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class PredictedChange:
    """Change of the modes by some losses.

    Parameters
    ----------
    rows
        Change of the rows.
    slope
        Derivative of the rows by the loss of each member.
    covariance
        Of the errors that the model makes.
    """

    rows: Float[np.ndarray, " row"]
    slope: Float[np.ndarray, "row member"]
    covariance: Float[np.ndarray, "row row"]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ChangeModel:
    """A model as the modes before say that it is.

    Parameters
    ----------
    structure
        The model; each parameter is the stiffness of a member.
    difference
        Modes before and now.
    theta, theta_covariance
        Logarithms of factors on the members before, and their covariance.
    """

    structure: UpdatableModel
    difference: StateDifference
    theta: Float[np.ndarray, " member"]
    theta_covariance: Float[np.ndarray, "member member"]

    @functools.cached_property
    def _before(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the model before, and their slope by the logarithms."""
        modes, pairs = self._modes(self.theta, self.difference.before.frequency_hz, before=True)
        return self._rows(modes, pairs)

    @functools.cached_property
    def likeness(self) -> Float[np.ndarray, " mode"]:
        """MAC of each mode before with that of the model [1]; NaN without shapes."""
        modes, pairs = self._modes(self.theta, self.difference.before.frequency_hz, before=True)
        if not self.difference.shapes:
            return np.full(len(pairs), np.nan)
        each = zip(self.difference.shapes, modes.sensed[:, pairs].T, strict=True)
        return np.array([one.mac(shape) for one, shape in each])

    @functools.cached_property
    def _target_hz(self) -> Float[np.ndarray, " mode"]:
        """Frequencies of the model, changed as those that were measured."""
        count = len(self.difference.pairs)
        measured = self.difference.now.frequency_hz / self.difference.before.frequency_hz
        return np.asarray(np.exp(self._before[0][:count]) * measured)

    def change(self, loss: Float[np.ndarray, " member"]) -> PredictedChange:
        """Predict the change by losses of the members.

        Parameters
        ----------
        loss
            Share of the stiffness that each member has lost [1].

        Returns
        -------
        The change, its slope by the losses, and the covariance of its errors.
        """
        modes, pairs = self._modes(self.theta + np.log1p(-loss), self._target_hz)
        rows, slope = self._rows(modes, pairs)
        turned = slope - self._before[1]
        return PredictedChange(
            rows - self._before[0],
            -slope / (1.0 - loss),
            turned @ self.theta_covariance @ turned.T,
        )

    def _rows(self, modes: SensedModes, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sensed, slopes = modes.sensed[:, pairs], [modes.log_frequency_slope[pairs]]
        for j, one in enumerate(self.difference.shapes):
            slopes.append(one.slope(sensed[:, j], modes.sensed_slope[:, pairs[j]]))
        rows = self.difference.rows(modes.frequency_hz[pairs], sensed.T)
        return rows, np.concatenate(slopes)

    def _modes(
        self, theta: np.ndarray, target_hz: np.ndarray, *, before: bool = False
    ) -> tuple[SensedModes, Int[np.ndarray, " mode"]]:
        """Modes of the model, and which of them are those of the difference."""
        difference = self.difference
        seen = difference.before.seen_by(self.structure)
        modes = self.structure.sensed_modes(theta, seen, len(target_hz) + _BEYOND)
        away = np.log(modes.frequency_hz / target_hz[:, None]) / FREQUENCY_SPREAD
        cost = 0.5 * away**2
        state = difference.before if before else difference.now
        if difference.shapes:
            assert state.shapes is not None
            for j, one in enumerate(difference.shapes):
                cost[j] += (1.0 - _likeness(one.known, state.shapes[j], modes)) / SHAPE_SPREAD
        pairs = np.asarray(linear_sum_assignment(cost)[1])
        for group in difference.groups:
            pairs[[*group]] = np.sort(pairs[[*group]])
        return modes, pairs


def _likeness(known: np.ndarray, shape: np.ndarray, modes: SensedModes) -> np.ndarray:
    """MAC of one measured shape with each mode of the model."""
    seen, columns = shape[known], modes.sensed[known]
    power = np.sum(columns**2, axis=0) * (seen @ seen)
    return np.asarray((seen @ columns) ** 2 / np.maximum(power, 1e-300))


def change_model(
    structure: UpdatableModel,
    difference: StateDifference,
    *,
    model_error: float,
    frequency_error: float,
    shape_error: float,
) -> ChangeModel:
    """Fit the model to the modes before.

    Parameters
    ----------
    structure
        The model; each parameter is the stiffness of a member.
    difference
        Modes before and now.
    model_error
        Relative standard deviation of the stiffness of a member about the model [1].
    frequency_error, shape_error
        Standard deviations of ln f [1], and of components of shapes of norm 1 [1], by which
        the model errs besides. They cancel in the difference.

    Returns
    -------
    The model as fitted.
    """
    before = _widened(difference.before, frequency_error, shape_error)
    prior = np.full(len(structure.names), model_error)
    found = optimise_from(structure, (before,), prior, np.zeros(len(prior)))
    return ChangeModel(
        structure=structure,
        difference=difference,
        theta=found.theta,
        theta_covariance=found.covariance,
    )


def _widened(modes: MeasuredModes, frequency_error: float, shape_error: float) -> MeasuredModes:
    sd = modes.shape_sd
    if modes.shapes is not None and sd is not None:
        norm = np.sqrt(np.nansum(modes.shapes**2, axis=1, keepdims=True))
        sd = np.hypot(sd, shape_error * norm)
    frequency_sd = np.hypot(modes.frequency_sd_hz, frequency_error * modes.frequency_hz)
    return dataclasses.replace(modes, frequency_sd_hz=frequency_sd, shape_sd=sd)
