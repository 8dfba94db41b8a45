r"""Measured modes, and their distance from a model in standard deviations.

A frequency enters by its logarithm. A shape is known up to a factor a, which is fitted:

.. math:: y = a \, C x_j + e, \qquad e_c \sim N(0, s_c^2)

with C what each channel sees. So neither norm nor sign of a shape matters. With a measured
force shapes are mass-normalised, and a is known to be plus or minus one. Errors that channels
have in common make the covariance of e

.. math:: \operatorname{diag}(s^2) + \sum_k d_k d_k^T

with a pattern :math:`d_k` for each direction in which they err together.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from slowtime.finite_elements.close_modes import close_groups
from slowtime.identification.mode_shapes.criteria import real_shape
from slowtime.identification.modes import Mode

from .updatable_models import SensedModes, UpdatableModel

_BEYOND = 4  # modes of the model beyond as many as were measured, for pairing
_SEEN = 1e-8  # size of a direction of close shapes, over the largest, that sensors still see
_WIDEST = 0.3  # spread of ln f beyond which a prior says nothing on which mode is which
# [share of an eigenvalue] Stiffness between two close modes that no model states, such as of
# joints that are not quite alike. Source: judgement; no study is recorded.
_COUPLING = 1e-3


class WhitenedShape(NamedTuple):
    """Channels that saw a shape, what makes their errors white, and the shape so weighted."""

    known: Bool[np.ndarray, " channel"]
    whitening: Float[np.ndarray, "seen seen"]
    target: Float[np.ndarray, " seen"]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredModes:
    """Modes read off one state of the structure.

    Parameters
    ----------
    frequency_hz, frequency_sd_hz
        Natural frequencies and their standard deviations, in any order [Hz].
    shapes, shape_sd
        Real shapes of any norm, one row a mode, and standard deviations of the components in
        the same unit; NaN where not measured. None when only frequencies are known.
    channels
        What each channel sees of the degrees of freedom; all of them, one each, by default.
    shape_common
        Patterns of errors that the channels of a shape have in common, in the unit of the
        shapes; each adds to their covariance. None by default.
    scaled
        Whether the shapes are mass-normalised, as a measured force makes them.
    added_mass
        A known mass that was on the structure in this state.
    """

    frequency_hz: Float[np.ndarray, " mode"]
    frequency_sd_hz: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "mode channel"] | None = None
    shape_sd: Float[np.ndarray, "mode channel"] | None = None
    channels: Float[np.ndarray, "channel dof"] | None = None
    shape_common: Float[np.ndarray, "mode pattern channel"] | None = None
    scaled: bool = False
    added_mass: Float[np.ndarray, "dof dof"] | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be compared with a model."""
        for name, given in (("frequency", self.frequency_hz), ("sd", self.frequency_sd_hz)):
            if not ((given > 0.0) & np.isfinite(given)).all() or not given.size:
                raise ValueError(
                    f"A {name} of {given} Hz was given. Allowed are positive finite values for "
                    "at least one mode; leave out modes that were not identified."
                )
        if self.shapes is None:
            return
        if self.shape_sd is None:
            raise ValueError("Shapes without shape_sd. Give the sd of each component.")
        seen = np.isfinite(self.shapes) & np.isfinite(self.shape_sd)
        if not (self.shape_sd[seen] > 0.0).all():
            raise ValueError(
                "A component of a shape has a standard deviation that is not positive. Give a "
                "positive one, or NaN where the channel was not measured."
            )

    @classmethod
    def of(
        cls, modes: Sequence[Mode], channels: Float[np.ndarray, "channel dof"] | None = None
    ) -> "MeasuredModes":
        """Collect the structural ones of identified modes.

        The deviation of a complex component is taken to be as large along the real line as
        across it, so that the real shape has half of its variance.

        Parameters
        ----------
        modes
            Identified modes with shapes.
        channels
            What each channel sees of the degrees of freedom; all of them, one each, by default.

        Returns
        -------
        The measured modes.
        """
        own = [mode for mode in modes if mode.kind == "structural"]
        silent = [np.where(mode.shape_sd > 0.0, mode.shape_sd, np.nan) for mode in own]
        return cls(
            frequency_hz=np.array([mode.frequency_hz.value for mode in own]),
            frequency_sd_hz=np.array([mode.frequency_hz.sd for mode in own]),
            shapes=np.array([real_shape(mode.shape) for mode in own]),
            shape_sd=np.array(silent) / np.sqrt(2.0),
            channels=channels,
        )

    @property
    def relative_sd(self) -> Float[np.ndarray, " mode"]:
        """Standard deviations of the logarithms of the frequencies."""
        return np.asarray(self.frequency_sd_hz / self.frequency_hz)

    @functools.cached_property
    def whitened_shapes(self) -> tuple[WhitenedShape, ...]:
        r"""Each shape over its errors made white; a search compares it a thousand times.

        With :math:`D^{-1} d = U S V^T` of all patterns d, the covariance over the deviations D
        is :math:`I + U S^2 U^T`, of which the inverse root is taken.
        """
        assert self.shapes is not None
        assert self.shape_sd is not None
        found = []
        for j in range(len(self.shapes)):
            known = np.isfinite(self.shapes[j]) & np.isfinite(self.shape_sd[j])
            weight = 1.0 / self.shape_sd[j, known]
            whitening = np.diag(weight)
            if self.shape_common is not None and self.shape_common.shape[1]:
                patterns = weight[:, None] * self.shape_common[j][:, known].T
                left, size, _ = np.linalg.svd(patterns, full_matrices=False)
                whitening -= (left * (1.0 - (1.0 + size**2) ** -0.5)) @ left.T * weight
            found.append(WhitenedShape(known, whitening, whitening @ self.shapes[j, known]))
        return tuple(found)

    @functools.cached_property
    def heard(
        self,
    ) -> tuple[tuple[Bool[np.ndarray, " channel"], Int[np.ndarray, " mode"]], ...]:
        """Sets of channels that saw a shape, and the modes that each set saw."""
        assert self.shapes is not None
        assert self.shape_sd is not None
        known = np.isfinite(self.shapes) & np.isfinite(self.shape_sd)
        sets, which = np.unique(known, axis=0, return_inverse=True)
        return tuple((one, np.flatnonzero(which == k)) for k, one in enumerate(sets))

    def seen_by(self, structure: UpdatableModel) -> Float[np.ndarray, "channel dof"]:
        """Return what each channel sees, checked against the structure and the shapes."""
        seen = np.eye(structure.size) if self.channels is None else self.channels
        columns = seen.shape[0] if self.shapes is None else self.shapes.shape[1]
        if seen.shape != (columns, structure.size):
            raise ValueError(
                f"Shapes of {columns} channels and a channel matrix of shape {seen.shape} for "
                f"{structure.size} degrees of freedom. Give `channels` with one row a channel "
                "and one column a degree of freedom."
            )
        return seen


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ModeMisfit:
    """Measured minus model over standard deviation, and the slope of the model's part.

    Parameters
    ----------
    residual
        One entry a measured number.
    slope
        Of the model's prediction in the same units, so that a step of the parameters takes
        `slope @ step` off the residual.
    pairs
        Which mode of the model each measured mode was compared with.
    """

    residual: Float[np.ndarray, " row"]
    slope: Float[np.ndarray, "row parameter"]
    pairs: Int[np.ndarray, " mode"]


def mode_misfit(
    structure: UpdatableModel,
    measured: MeasuredModes,
    theta: Float[np.ndarray, " parameter"],
    spread: Float[np.ndarray, " parameter"],
) -> ModeMisfit:
    """Compare measured modes with those of the structure at `theta`.

    Parameters
    ----------
    structure, measured, theta
        What to compare.
    spread
        How far each parameter may still be off, which decides how far a mode may be from its
        partner when modes are paired.

    Returns
    -------
    Residuals in standard deviations, their slopes, and the pairs of modes.
    """
    seen = measured.seen_by(structure)
    modes = structure.sensed_modes(
        theta, seen, len(measured.frequency_hz) + _BEYOND, measured.added_mass
    )
    if len(modes.eigenvalue) < len(measured.frequency_hz):
        raise ValueError(
            f"{len(measured.frequency_hz)} modes were measured, but the model has only "
            f"{len(modes.eigenvalue)}. Leave out modes that it does not describe."
        )
    groups = close_groups(modes.frequency_hz)
    pairs = _pair(measured, modes, groups, spread)
    away = np.log(measured.frequency_hz / modes.frequency_hz[pairs])
    residuals = [away / measured.relative_sd]
    slopes = [modes.log_frequency_slope[pairs] / measured.relative_sd[:, None]]
    if measured.shapes is not None:
        together = {r: group for group in groups for r in group}
        for j, r in enumerate(pairs.tolist()):
            gap = _shape_gap if len(together[r]) == 1 else _subspace_gap
            residual, slope = gap(measured, modes, j, together[r])
            residuals.append(residual)
            slopes.append(slope)
    return ModeMisfit(np.concatenate(residuals), np.concatenate(slopes), pairs)


def _shape_gap(
    measured: MeasuredModes, modes: SensedModes, j: int, group: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Residual and slope of one shape, its factor fitted unless it is known."""
    known, whitening, target = measured.whitened_shapes[j]
    model = whitening @ modes.sensed[known, group[0]]
    slope = whitening @ modes.sensed_slope[known, group[0]]
    power = float(model @ model)
    if measured.scaled:
        sign = 1.0 if model @ target >= 0.0 else -1.0
        return target - sign * model, sign * slope
    if power <= 0.0:
        return target, 0.0 * slope
    factor = float(model @ target) / power
    across = slope - np.outer(model, model @ slope) / power
    return target - factor * model, factor * across


def _subspace_gap(
    measured: MeasuredModes, modes: SensedModes, j: int, group: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Residual and slope of one shape beside the span of a group of close modes.

    The shapes of close modes turn among each other under the least change, so that only their
    span can be compared; the factors on all of them are fitted.
    """
    known, whitening, target = measured.whitened_shapes[j]
    model = whitening @ modes.sensed[known][:, group]
    slopes = np.tensordot(whitening, modes.sensed_slope[known][:, group], axes=1)
    if not model.any():
        return target, 0.0 * slopes[:, 0]
    left, size, right = np.linalg.svd(model, full_matrices=False)
    kept = size > _SEEN * size[0]
    left = left[:, kept]
    factors = right[kept].T @ ((left.T @ target) / size[kept])
    slope = np.einsum("cgp,g->cp", slopes, factors)
    return target - left @ (left.T @ target), slope - left @ (left.T @ slope)


def _pair(
    measured: MeasuredModes,
    modes: SensedModes,
    groups: list[list[int]],
    spread: Float[np.ndarray, " parameter"],
) -> Int[np.ndarray, " mode"]:
    """Partner of each measured mode, the likeliest as a whole by frequency and MAC.

    A shape has as many directions across the span of close modes as there are channels left,
    and one for each other mode within the span. The latter tell which member of a close group
    was measured where the others were not.
    """
    reach = np.sum((modes.log_frequency_slope * spread) ** 2, axis=1)
    variance = np.minimum(reach, _WIDEST**2) + measured.relative_sd[:, None] ** 2
    away = np.log(measured.frequency_hz[:, None] / modes.frequency_hz)
    cost = 0.5 * away**2 / variance
    if measured.shapes is not None and measured.shape_sd is not None:
        known = np.isfinite(measured.shapes) & np.isfinite(measured.shape_sd)
        shapes = np.where(known, measured.shapes, 0.0)
        own, span = _alike(modes, groups, shapes, known, measured.heard)
        columns, power = modes.sensed, np.sum(shapes**2, axis=1)[:, None]
        turned = np.sum((modes.sensed_slope * spread) ** 2, axis=(0, 2))
        drift = turned / np.maximum(np.sum(columns**2, axis=0), 1e-300)
        others, turning = np.zeros(len(drift)), np.zeros(len(drift))
        for group in groups:
            # Each member could lie anywhere in the span, so that all drift as far as one.
            if len(group) == 1:
                continue
            drift[group], others[group] = drift[group].max(), len(group) - 1
            turning[group] = _turning(modes.frequency_hz[group])
        noise = np.sum(np.where(known, _component_sd(measured), 0.0) ** 2, axis=1)[:, None]
        noise = noise / power
        directions = np.maximum(known.sum(axis=1) - 1, 0)[:, None]
        cost = cost + 0.5 * directions * (1.0 - span) / (np.minimum(drift, 0.5) + noise)
        within = np.minimum(drift + turning, 0.5) + noise
        cost = cost + 0.5 * others * (span - own) / within
    _, partners = linear_sum_assignment(cost)
    return _in_order(measured, groups, np.asarray(partners))


def _turning(frequency_hz: np.ndarray) -> np.ndarray:
    """Mean square by which what no model states turns each of some close shapes in their span.

    A stiffness that couples two modes turns them by itself over the difference of their
    eigenvalues (first order). Modes that are equal lie anywhere in their span.
    """
    eigenvalue = frequency_hz**2
    apart = np.abs(eigenvalue - eigenvalue[:, None]) / eigenvalue[:, None]
    np.fill_diagonal(apart, np.inf)
    return np.asarray(np.sum((_COUPLING / np.maximum(apart, 1e-12)) ** 2, axis=1))


def _component_sd(measured: MeasuredModes) -> np.ndarray:
    """Compute deviations of components, with what these have in common with others."""
    assert measured.shape_sd is not None
    if measured.shape_common is None:
        return measured.shape_sd
    common = np.sum(measured.shape_common**2, axis=1)
    return np.asarray(np.sqrt(measured.shape_sd**2 + common))


def _in_order(
    measured: MeasuredModes, groups: list[list[int]], pairs: Int[np.ndarray, " mode"]
) -> Int[np.ndarray, " mode"]:
    """Pairs with measured modes of one close group in the order of their frequencies.

    Their shapes are compared as a subspace, so that nothing else tells which is which.
    """
    for group in groups:
        if len(group) == 1:
            continue
        own = np.flatnonzero(np.isin(pairs, group))
        if len(own) > 1:
            ranked = own[np.argsort(measured.frequency_hz[own], kind="stable")]
            pairs[ranked] = np.sort(pairs[own])
    return pairs


def _alike(
    modes: SensedModes,
    groups: list[list[int]],
    shapes: np.ndarray,
    known: np.ndarray,
    heard: Sequence[tuple[np.ndarray, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray]:
    """MAC of each measured shape with each mode, and with the span of all that are close."""
    columns = modes.sensed
    power = np.maximum(np.sum(shapes**2, axis=1), 1e-300)[:, None]
    alone = (shapes @ columns) ** 2 / np.maximum((known @ columns**2) * power, 1e-300)
    alike = alone.copy()
    close = [group for group in groups if len(group) > 1]
    for channels, own in heard:
        for group in close:
            basis = np.linalg.qr(columns[channels][:, group])[0]
            inside = np.sum((shapes[own][:, channels] @ basis) ** 2, axis=1, keepdims=True)
            alike[np.ix_(own, np.array(group))] = inside / power[own]
    return np.asarray(alone), np.asarray(alike)
