r"""Which mode of this epoch is which of those followed.

The edge's name of a mode counts within one of its boots. Where there is none, or it is new, a
pair costs

.. math:: \frac{(\Delta \ln f)^2}{2 (s_w^2 + s_f^2)}
          + \frac{(c - 1)(1 - \mathrm{MAC})}{2 (m_w + m_s)}

with c channels, :math:`s_w` and :math:`m_w` how far a mode wanders between two epochs and
:math:`s_f`, :math:`m_s` what its own errors make, and the pairs that cost least as a whole win.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from twin_server.estimate.elements.memory import Reference

from .observed_modes import ObservedMode

_WANDERS = 0.02
_TURNS = 0.05
_GATE = 8.0
_FOREIGN = 0.2
_GROWTH = 0.1
_MOST_GROWN = 4.0
_LEARNS = 0.3


def match(
    references: Sequence[Reference], modes: Sequence[ObservedMode], boot: str
) -> dict[int, int]:
    """Find for each reference the place of its mode in `modes`; none for those not seen.

    Parameters
    ----------
    boot
        The edge's run, within which its names of modes last.
    """
    pairs = _by_name(references, modes, boot)
    left = [i for i in range(len(references)) if i not in pairs]
    free = [j for j in range(len(modes)) if j not in pairs.values()]
    gains = np.array(
        [[_GATE - _cost(references[i], modes[j], boot) for j in free] for i in left]
    ).reshape(len(left), len(free))
    return pairs | {left[i]: free[j] for i, j in best_pairs(gains)}


def best_pairs(gains: Float[np.ndarray, "row column"]) -> list[tuple[int, int]]:
    """Pairs of the best assignment as a whole; none that gains nothing."""
    if not gains.size:
        return []
    rows, columns = linear_sum_assignment(-np.maximum(gains, 0.0))
    return [
        (int(i), int(j))
        for i, j in zip(rows, columns, strict=True)
        if gains[int(i), int(j)] > 0
    ]


def update_reference(reference: Reference, mode: ObservedMode | None, boot: str) -> Reference:
    """Carry a reference on by one epoch."""
    if mode is None:
        return dataclasses.replace(reference, missed=reference.missed + 1)
    away = np.log(mode.frequency_hz / reference.frequency_hz)
    shape = _turned(reference.shape, mode)
    return Reference(
        float(reference.frequency_hz * np.exp(_LEARNS * away)),
        shape,
        boot,
        mode.identity,
    )


def new_reference(mode: ObservedMode, boot: str) -> Reference:
    """Follow a mode from now on."""
    return Reference(mode.frequency_hz, _floats(mode.shape), boot, mode.identity)


def channel_mac(
    one: Float[np.ndarray, " channel"], other: Float[np.ndarray, " channel"]
) -> tuple[float, int]:
    """MAC of two real shapes over the channels that both have, and how many those are."""
    both = np.isfinite(one) & np.isfinite(other)
    a, b = one[both], other[both]
    power = float(a @ a) * float(b @ b)
    return (float(a @ b) ** 2 / power if power > 0.0 else 0.0), int(both.sum())


def aligned(
    shape: Float[np.ndarray, " channel"], to: Float[np.ndarray, " channel"]
) -> tuple[Float[np.ndarray, " channel"], float]:
    """Shape with the sign and size of another over the channels that both have; its factor."""
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
            if channels > 1 and alike < _FOREIGN:
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
    grown = min(1.0 + _GROWTH * reference.missed, _MOST_GROWN)
    away = np.log(mode.frequency_hz / reference.frequency_hz)
    cost = 0.5 * float(away**2) / ((_WANDERS * grown) ** 2 + mode.relative_sd**2)
    cost += 0.5 * _GATE * named_otherwise
    if mode.shape is None or mode.shape_sd is None or reference.shape is None:
        return cost
    alike, channels = channel_mac(np.array(reference.shape), mode.shape)
    noise = float(np.nansum(mode.shape_sd**2))
    return cost + 0.5 * max(channels - 1, 0) * (1.0 - alike) / (_TURNS * grown + noise)


def _turned(known: tuple[float, ...] | None, mode: ObservedMode) -> tuple[float, ...] | None:
    """Move a remembered shape a little towards a new one."""
    if mode.shape is None:
        return known
    if known is None:
        return _floats(mode.shape)
    old = np.array(known)
    new, _ = aligned(mode.shape, old)
    mixed = np.where(np.isfinite(old), old + _LEARNS * (new - old), new)
    mixed = np.where(np.isfinite(mixed), mixed, old)
    norm = float(np.sqrt(np.nansum(mixed**2)))
    return _floats(mixed / norm) if norm > 0.0 else known


def _floats(shape: Float[np.ndarray, " channel"] | None) -> tuple[float, ...] | None:
    return None if shape is None else tuple(shape.tolist())
