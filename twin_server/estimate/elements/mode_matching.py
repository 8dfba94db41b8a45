r"""Matches the modes of an epoch with the modes that are followed.

The edge's name of a mode counts within one of its boots. Where there is none, or it is new, a
pair costs

.. math:: \frac{(\Delta \ln f)^2}{2 (s_w^2 + s_f^2)}
          + \frac{\min(c - 1, d)(1 - \mathrm{MAC})}{2 (m_w + m_s)}

with c channels, d `directions`, :math:`s_w` and :math:`m_w` how far a mode wanders between two
epochs and :math:`s_f`, :math:`m_s` what its own errors make, and the pairs that cost least as a
whole win.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from twin_server.estimate.elements.memory import Reference

from .observed_modes import ObservedMode


@dataclasses.dataclass(frozen=True, slots=True)
class MatchingLimits:
    """Thresholds of mode matching; chosen, without a recorded study of their trade-off.

    Parameters
    ----------
    frequency_drift
        Standard deviation of ln f from one epoch to the next, :math:`s_w` [1].
    shape_drift
        1 - MAC that a mode's shape changes by from one epoch to the next, :math:`m_w` [1].
    gate
        Cost at and above which two modes are not paired [1].
    directions
        Directions in which a shape errs independently, at most [1]: errors of identified shapes
        lie along the modes beside it, two on each side, in however many channels. With 24
        channels counted as independent, the modes of a tower of 180 m were lost from one
        window to the next; with at most 4, all were followed.
    foreign_mac
        MAC below which a mode under the same name is taken for another one [1].
    growth_per_miss
        Growth of both drifts for each epoch in which the mode was not seen [1].
    most_growth
        Greatest factor of that growth [1].
    learning_rate
        Weight of the newest epoch in the reference [1].
    """

    frequency_drift: float = 0.02
    shape_drift: float = 0.05
    gate: float = 8.0
    directions: int = 4
    foreign_mac: float = 0.2
    growth_per_miss: float = 0.1
    most_growth: float = 4.0
    learning_rate: float = 0.3


LIMITS = MatchingLimits()


def match(
    references: Sequence[Reference], modes: Sequence[ObservedMode], boot: str
) -> dict[int, int]:
    """Match references with the modes of an epoch.

    Parameters
    ----------
    boot
        The edge's run, within which its names of modes last.

    Returns
    -------
    For each reference that was seen, its place → that of its mode in `modes`.
    """
    pairs = _by_name(references, modes, boot)
    left = [i for i in range(len(references)) if i not in pairs]
    free = [j for j in range(len(modes)) if j not in pairs.values()]
    gains = np.array(
        [[LIMITS.gate - _cost(references[i], modes[j], boot) for j in free] for i in left]
    ).reshape(len(left), len(free))
    return pairs | {left[i]: free[j] for i, j in best_pairs(gains)}


def best_pairs(gains: Float[np.ndarray, "row column"]) -> list[tuple[int, int]]:
    """Return the pairs of the assignment with the greatest total gain.

    Pairs that gain nothing are left out.

    Parameters
    ----------
    gains
        Gain of each pair of row and column [1].

    Returns
    -------
    Row and column of each pair.
    """
    if not gains.size:
        return []
    rows, columns = linear_sum_assignment(-np.maximum(gains, 0.0))
    return [
        (int(i), int(j))
        for i, j in zip(rows, columns, strict=True)
        if gains[int(i), int(j)] > 0
    ]


def update_reference(reference: Reference, mode: ObservedMode | None, boot: str) -> Reference:
    """Update a reference by its mode of one epoch; None where it was not seen."""
    if mode is None:
        return dataclasses.replace(reference, missed=reference.missed + 1)
    away = np.log(mode.frequency_hz / reference.frequency_hz)
    shape = _updated_shape(reference.shape, mode)
    return Reference(
        float(reference.frequency_hz * np.exp(LIMITS.learning_rate * away)),
        shape,
        boot,
        mode.identity,
    )


def new_reference(mode: ObservedMode, boot: str) -> Reference:
    """Make the reference of a mode that is followed from now on."""
    return Reference(mode.frequency_hz, _floats(mode.shape), boot, mode.identity)


def channel_mac(
    one: Float[np.ndarray, " channel"], other: Float[np.ndarray, " channel"]
) -> tuple[float, int]:
    """Return the modal assurance criterion (MAC) of two real shapes.

    Parameters
    ----------
    one, other
        Components [1]; NaN for channels that a shape does not have.

    Returns
    -------
    MAC over the channels that both have [1], and the number of these.

    References
    ----------
    Allemang and Brown, A correlation coefficient for modal vector analysis, IMAC 1982.
    """
    both = np.isfinite(one) & np.isfinite(other)
    a, b = one[both], other[both]
    power = float(a @ a) * float(b @ b)
    return (float(a @ b) ** 2 / power if power > 0.0 else 0.0), int(both.sum())


def aligned(
    shape: Float[np.ndarray, " channel"], to: Float[np.ndarray, " channel"]
) -> tuple[Float[np.ndarray, " channel"], float]:
    """Scale a shape to the sign and norm of another over the channels that both have.

    Parameters
    ----------
    shape, to
        Components [1]; NaN for channels that a shape does not have.

    Returns
    -------
    The scaled shape, and the absolute factor [1].
    """
    both = np.isfinite(shape) & np.isfinite(to)
    size = float(np.linalg.norm(to[both]) / max(float(np.linalg.norm(shape[both])), 1e-300))
    factor = size if float(shape[both] @ to[both]) >= 0.0 else -size
    return factor * shape, abs(factor)


def _by_name(
    references: Sequence[Reference], modes: Sequence[ObservedMode], boot: str
) -> dict[int, int]:
    names = {mode.identity: j for j, mode in enumerate(modes) if mode.identity is not None}
    pairs = {}
    for i, reference in enumerate(references):
        if reference.identity is None or reference.boot != boot:
            continue
        j = names.get(reference.identity)
        if j is None:
            continue
        shape = modes[j].shape
        if shape is not None and reference.shape is not None:
            alike, channels = channel_mac(np.array(reference.shape), shape)
            if channels > 1 and alike < LIMITS.foreign_mac:
                continue
        pairs[i] = j
    return pairs


def _cost(reference: Reference, mode: ObservedMode, boot: str) -> float:
    named_otherwise = (
        reference.boot == boot
        and None not in (reference.identity, mode.identity)
        and reference.missed == 0
        and reference.identity != mode.identity
    )
    grown = min(1.0 + LIMITS.growth_per_miss * reference.missed, LIMITS.most_growth)
    away = np.log(mode.frequency_hz / reference.frequency_hz)
    cost = 0.5 * float(away**2) / ((LIMITS.frequency_drift * grown) ** 2 + mode.relative_sd**2)
    cost += 0.5 * LIMITS.gate * named_otherwise
    if mode.shape is None or mode.shape_sd is None or reference.shape is None:
        return cost
    alike, channels = channel_mac(np.array(reference.shape), mode.shape)
    noise = float(np.nansum(mode.shape_sd**2))
    free = min(max(channels - 1, 0), LIMITS.directions)
    return cost + 0.5 * free * (1.0 - alike) / (LIMITS.shape_drift * grown + noise)


def _updated_shape(
    known: tuple[float, ...] | None, mode: ObservedMode
) -> tuple[float, ...] | None:
    """Move a remembered shape a little towards a new one."""
    if mode.shape is None:
        return known
    if known is None:
        return _floats(mode.shape)
    old = np.array(known)
    new, _ = aligned(mode.shape, old)
    mixed = np.where(np.isfinite(old), old + LIMITS.learning_rate * (new - old), new)
    mixed = np.where(np.isfinite(mixed), mixed, old)
    norm = float(np.sqrt(np.nansum(mixed**2)))
    return _floats(mixed / norm) if norm > 0.0 else known


def _floats(shape: Float[np.ndarray, " channel"] | None) -> tuple[float, ...] | None:
    return None if shape is None else tuple(shape.tolist())
