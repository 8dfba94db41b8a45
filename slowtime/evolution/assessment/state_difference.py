r"""Modes of one structure before and now → their difference, in numbers that compare.

Of each pair of modes the logarithm of the frequency is compared, and the shape over its norm.
Shapes are compared across the direction that the mode had before: with :math:`Q_j` an
orthonormal basis of the complement of the shape before (of all shapes, where modes are close),
the rows are

.. math:: \ln f_j, \qquad Q_j^T \, u_j, \qquad u_j = \pm y_j / |y_j|

Neither norm nor sign matters, and modes that turn among close ones add nothing.
"""

import dataclasses
import functools
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from slowtime.evolution.structures import MeasuredModes
from slowtime.finite_elements.close_modes import close_groups

ALIKE = 0.5
"""MAC [1] from which a mode now may be one before; that of others is a few per cent, and losses
of 30 % of one member leave some 0.7. Of close modes, the share within their span."""

NEAR = 0.3
"""|ln f now - ln f before| [1] up to which two modes may be one: the stiffness of the whole
structure would have changed by 80 %."""

_PER_MAC = 0.1
"""Change of ln f [1] that speaks as much against a pair as a MAC of one half."""


@dataclasses.dataclass(frozen=True, slots=True)
class ModePair:
    """A mode before and the same mode now.

    Parameters
    ----------
    before, now
        Positions in the two sets of modes.
    mac
        Modal assurance criterion of the shapes at the sensors, of close modes with their span
        [1]; NaN without shapes.
    """

    before: int
    now: int
    mac: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ShapeRows:
    """Directions in which the shape of one mode is compared.

    Parameters
    ----------
    known
        Channels that measured it in both states.
    unit
        Shape before over its norm.
    basis
        Orthonormal directions across the shape before, and across those close to it.
    """

    known: Bool[np.ndarray, " channel"]
    unit: Float[np.ndarray, " seen"]
    basis: Float[np.ndarray, "seen row"]

    def compared(self, shape: Float[np.ndarray, " channel"]) -> Float[np.ndarray, " row"]:
        """Rows of a shape."""
        return np.asarray(self.basis.T @ self._unit(shape)[0])

    def slope(
        self,
        shape: Float[np.ndarray, " channel"],
        slope: Float[np.ndarray, "channel parameter"],
    ) -> Float[np.ndarray, "row parameter"]:
        """Differentiate the rows of a shape, from the derivative of its components."""
        unit, factor = self._unit(shape)
        across = slope[self.known] - np.outer(unit, unit @ slope[self.known])
        return np.asarray(self.basis.T @ (factor * across))

    def mac(self, shape: Float[np.ndarray, " channel"]) -> float:
        """Squared cosine of a shape and the span of the mode and those close to it [1]."""
        return float(1.0 - np.sum(self.compared(shape) ** 2))

    def _unit(self, shape: np.ndarray) -> tuple[np.ndarray, float]:
        seen = shape[self.known]
        norm = max(float(np.linalg.norm(seen)), 1e-300)
        factor = (1.0 if seen @ self.unit >= 0.0 else -1.0) / norm
        return factor * seen, factor


@dataclasses.dataclass(frozen=True, eq=False)
class StateDifference:
    """Modes now minus modes before.

    Parameters
    ----------
    before, now
        The modes that are in both, in the same order, ascending before.
    pairs
        Where they were in the sets that were given.
    shapes
        Directions in which shapes are compared; empty without shapes.
    groups
        Modes that are close to each other.
    """

    before: MeasuredModes
    now: MeasuredModes
    pairs: tuple[ModePair, ...]
    shapes: tuple[ShapeRows, ...]
    groups: tuple[tuple[int, ...], ...]

    @functools.cached_property
    def values(self) -> Float[np.ndarray, " row"]:
        """Measured difference, in rows."""
        before = self.rows(self.before.frequency_hz, self.before.shapes)
        return np.asarray(self.rows(self.now.frequency_hz, self.now.shapes) - before)

    def rows(
        self,
        frequency_hz: Float[np.ndarray, " mode"],
        shapes: Float[np.ndarray, "mode channel"] | None,
    ) -> Float[np.ndarray, " row"]:
        """Rows of modes in the order of the pairs."""
        parts = [np.log(frequency_hz)]
        if self.shapes and shapes is not None:
            parts += [one.compared(y) for one, y in zip(self.shapes, shapes, strict=True)]
        return np.concatenate(parts)

    @functools.cached_property
    def covariance(self) -> Float[np.ndarray, "row row"]:
        """Covariance of the errors of both measurements."""
        sizes = [one.basis.shape[1] for one in self.shapes]
        modes = len(self.pairs)
        found = np.zeros((modes + sum(sizes),) * 2)
        np.fill_diagonal(
            found[:modes, :modes], self.before.relative_sd**2 + self.now.relative_sd**2
        )
        start = modes
        for j, (one, size) in enumerate(zip(self.shapes, sizes, strict=True)):
            own = slice(start, start + size)
            for state in (self.before, self.now):
                found[own, own] += _shape_covariance(one, state, j)
            start += size
        return found

    @functools.cached_property
    def common_stiffness(self) -> Float[np.ndarray, " row"]:
        """Slope of the rows by the logarithm of a factor on all stiffness: f as its root."""
        found = np.zeros(len(self.values))
        found[: len(self.pairs)] = 0.5
        return found


def _shape_covariance(one: ShapeRows, state: MeasuredModes, j: int) -> np.ndarray:
    assert state.shapes is not None
    assert state.shape_sd is not None
    errors = np.diag(state.shape_sd[j, one.known])
    if state.shape_common is not None:
        errors = np.hstack([errors, state.shape_common[j][:, one.known].T])
    whole = np.zeros((len(one.known), errors.shape[1]))
    whole[one.known] = errors
    spread = one.slope(state.shapes[j], whole)
    return np.asarray(spread @ spread.T)


def paired_modes(before: MeasuredModes, now: MeasuredModes) -> tuple[ModePair, ...]:
    """Find the modes that are in both states, by MAC and frequency.

    Parameters
    ----------
    before, now
        Modes of the two states, at the same channels.

    Returns
    -------
    Pairs, ascending in the frequency before.
    """
    order = np.argsort(before.frequency_hz, kind="stable")
    first = chosen_modes(before, order)
    groups = close_groups(first.frequency_hz)
    away = np.log(now.frequency_hz / first.frequency_hz[:, None])
    alike = np.full(away.shape, np.nan)
    if first.shapes is not None and now.shapes is not None:
        for group in groups:
            for j, k in itertools.product(group, range(len(now.frequency_hz))):
                alike[j, k] = shape_rows(first, j, now, k, group).mac(now.shapes[k])
    allowed = (np.abs(away) <= NEAR) & ~(alike < ALIKE)
    cost = (away / _PER_MAC) ** 2 + 2.0 * (1.0 - np.nan_to_num(alike, nan=1.0))
    rows, partners = linear_sum_assignment(np.where(allowed, cost, 1e3))
    kept = allowed[rows, partners]
    rows, partners = rows[kept], _in_order(rows[kept], partners[kept], groups, now)
    return tuple(
        ModePair(int(order[j]), int(k), float(alike[j, k]))
        for j, k in zip(rows, partners, strict=True)
    )


def state_difference(
    before: MeasuredModes, now: MeasuredModes, pairs: Sequence[ModePair]
) -> StateDifference:
    """Subtract the modes before from the modes now.

    Parameters
    ----------
    before, now
        Modes of the two states, at the same channels.
    pairs
        Which of them are compared, ascending in the frequency before; at least one.

    Returns
    -------
    The difference.
    """
    first = chosen_modes(before, np.array([pair.before for pair in pairs]))
    second = chosen_modes(now, np.array([pair.now for pair in pairs]))
    groups = close_groups(first.frequency_hz)
    shapes: tuple[ShapeRows, ...] = ()
    if first.shapes is not None and second.shapes is not None:
        shapes = tuple(
            shape_rows(first, j, second, j, group) for group in groups for j in group
        )
    return StateDifference(first, second, tuple(pairs), shapes, tuple(map(tuple, groups)))


def chosen_modes(modes: MeasuredModes, rows: Int[np.ndarray, " chosen"]) -> MeasuredModes:
    """Take some of the measured modes, in the order of their positions."""

    def rows_of(whole: np.ndarray | None) -> np.ndarray | None:
        return None if whole is None else whole[rows]

    return dataclasses.replace(
        modes,
        frequency_hz=modes.frequency_hz[rows],
        frequency_sd_hz=modes.frequency_sd_hz[rows],
        shapes=rows_of(modes.shapes),
        shape_sd=rows_of(modes.shape_sd),
        shape_common=rows_of(modes.shape_common),
    )


def shape_rows(
    before: MeasuredModes, j: int, now: MeasuredModes, k: int, group: Sequence[int]
) -> ShapeRows:
    """Directions in which mode j before, one of a close group, is compared with mode k now."""
    assert before.shapes is not None
    assert now.shapes is not None
    known = np.isfinite(before.shapes[[*group]]).all(axis=0) & np.isfinite(now.shapes[k])
    for state, row in ((before, j), (now, k)):
        assert state.shape_sd is not None
        known &= np.isfinite(state.shape_sd[row])
    left, size, _ = np.linalg.svd(before.shapes[[*group]][:, known].T)
    rank = int(np.sum(size > 1e-8 * size.max(initial=0.0)))
    own = before.shapes[j, known]
    unit = own / max(float(np.linalg.norm(own)), 1e-300)
    return ShapeRows(known, unit, left[:, rank:])


def _in_order(
    rows: np.ndarray, partners: np.ndarray, groups: list[list[int]], now: MeasuredModes
) -> np.ndarray:
    """Partners with close modes in the order of their frequencies: shapes cannot tell them."""
    found = partners.copy()
    for group in groups:
        own = np.flatnonzero(np.isin(rows, group))
        found[own] = partners[own][np.argsort(now.frequency_hz[partners[own]], kind="stable")]
    return found
