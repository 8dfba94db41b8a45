"""Modes of several sensor set-ups: of all records together, none of a single one lost."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.mode_shapes.merging import ALIKE, MergedMode, SetUp, merge
from slowtime.identification.modes import Mode
from slowtime.identification.subspace.poles import Poles
from slowtime.identification.subspace.setup_merging import (
    PreMerged,
    SetUpRecord,
    merge_before,
)

from .estimation import identify_modes

SAME = 3.0
"""Distance of the frequencies of one mode by two ways of merging [standard deviations]."""

AFTER = "merged_after"
"""Flag of modes merged after identification, as the joint model of all records lacks them."""

DISAGREE = "ways_disagree"
"""Flag of modes whose frequency or damping by the joint model is not that of single records."""

ONLY_TOGETHER = "in_no_set_up_alone"
"""Flag of modes of the joint model that no record shows by itself."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointModes:
    """Modes of all set-ups.

    Parameters
    ----------
    modes
        Over all channels, ascending in frequency; those merged after identification have the
        flag `merged_after`.
    partial
        Modes that a part of the set-ups shows and the joint model does not, over the channels
        of these.
    notes
        Which modes the joint model lacks, and why.
    """

    modes: tuple[Mode, ...]
    channels: tuple[str, ...]
    partial: tuple[MergedMode, ...]
    notes: tuple[str, ...]


def merge_records(
    setups: Sequence[SetUpRecord],
    rate_hz: float,
    references: Sequence[str],
    *,
    block_rows: int,
    orders: Sequence[int],
    band_hz: tuple[float, float],
) -> JointModes:
    """Identify the modes of a structure from the records of all set-ups.

    One model of all records (PreGER) may lack a mode that is weak at the references, that one
    record shows alone, or that it does not separate from a neighbour. Each record is therefore
    identified by itself, too. What the joint model lacks is merged after identification
    (PoSER), mode by mode.

    Parameters
    ----------
    block_rows
        Lags in a block row or column of the joint model.
    orders
        Orders of the joint model, two for each mode.

    Raises
    ------
    ValueError
        Where a set-up lacks a reference, or there are too few channels.
    """
    joint = merge_before(
        setups, rate_hz, references, block_rows=block_rows, orders=orders, band_hz=band_hz
    )
    parts = [
        SetUp(
            modes=identify_modes(one.samples, rate_hz, band_hz=band_hz).structural,
            channels=one.channels,
        )
        for one in setups
    ]
    after = merge(parts, references)
    partners = _partners(joint, after)
    lacking = [k for k in range(len(after)) if k not in partners]
    # A joint mode that is two modes of the set-ups is neither.
    mixed = {k: n for k in lacking for n in _near(after[k], joint) if n in partners.values()}
    modes = _joint_modes(joint, after, partners, set(mixed.values()))
    partial, notes = [], []
    for k in [k for k in range(len(after)) if k in lacking or partners[k] in mixed.values()]:
        one, at = after[k], mixed.get(k, partners.get(k))
        both = [
            other.mode
            for j, other in enumerate(after)
            if j != k and at is not None and mixed.get(j, partners.get(j)) == at
        ]
        why = _why_lacking(one, joint, both)
        where = ", ".join(str(which + 1) for which in one.setups)
        said = f"{_hz(one.mode)} (set-ups {where}): {why}."
        if set(one.channels) == set(joint.channels):
            modes.append(_over(one, joint.channels))
            notes.append(f"{said} It was merged after identification.")
        else:
            partial.append(one)
            notes.append(f"{said} Other set-ups do not show it, so its shape is not whole.")
    return JointModes(
        modes=tuple(sorted(modes, key=lambda mode: mode.frequency_hz.value)),
        channels=joint.channels,
        partial=tuple(partial),
        notes=tuple(notes),
    )


def _joint_modes(
    joint: PreMerged, after: Sequence[MergedMode], partners: dict[int, int], mixed: set[int]
) -> list[Mode]:
    """Joint modes that are one mode, flagged where the set-ups do not bear them."""
    of_joint = {n: after[k].mode for k, n in partners.items()}
    modes = []
    for number, mode in enumerate(joint.modes):
        if number in mixed:
            continue
        flags = mode.flags
        if number not in of_joint:
            flags = (*flags, ONLY_TOGETHER)
        elif not _agree(mode, of_joint[number]):
            flags = (*flags, DISAGREE)
        modes.append(dataclasses.replace(mode, flags=flags))
    return modes


def _near(one: MergedMode, joint: PreMerged) -> list[int]:
    """Modes of the joint model at the frequency of one merged afterwards, nearest first."""
    away = [_distance(one.mode, mode) for mode in joint.modes]
    return [int(n) for n in np.argsort(away) if away[n] <= 1.0]


def _partners(joint: PreMerged, after: Sequence[MergedMode]) -> dict[int, int]:
    """Mode of the joint model that each mode merged afterwards is, one to one."""
    pairs = []
    for k, one in enumerate(after):
        for n, mode in enumerate(joint.modes):
            away = _distance(one.mode, mode)
            if away <= 1.0 and _alike(one, mode.shape, joint.channels) >= ALIKE:
                pairs.append((away, k, n))
    found: dict[int, int] = {}
    for _, k, n in sorted(pairs):
        if k not in found and n not in found.values():
            found[k] = n
    return found


def _distance(one: Mode, other: Mode) -> float:
    """Distance of frequencies over what errors, or half a half-bandwidth, allow [1]."""
    f, g = one.frequency_hz, other.frequency_hz
    allowed = SAME * np.hypot(f.sd, g.sd)
    damping = one.damping_ratio.value
    if np.isfinite(damping):
        allowed = max(allowed, 0.5 * damping * f.value)
    return float(abs(f.value - g.value) / allowed)


def _agree(one: Mode, other: Mode) -> bool:
    """Whether frequency and damping agree within their errors."""
    pairs = (
        (one.frequency_hz, other.frequency_hz),
        (one.damping_ratio, other.damping_ratio),
    )
    # Written so that a NaN agrees: a damping that is unknown contradicts nothing.
    return not any(abs(a.value - b.value) > SAME * np.hypot(a.sd, b.sd) for a, b in pairs)


def _alike(one: MergedMode, shape: np.ndarray, channels: Sequence[str]) -> float:
    """MAC over the channels that a mode merged afterwards has."""
    at = [channels.index(name) for name in one.channels]
    return mac(one.mode.shape, shape[at]) if np.any(shape[at]) else 0.0


def _why_lacking(one: MergedMode, joint: PreMerged, both: Sequence[Mode]) -> str:
    """Reason for which the joint model lacks a mode, or has one for it and others."""
    if both:
        others = " and ".join(_hz(mode) for mode in both)
        return f"the model of all records has one mode for it and {others}"
    if _near(one, joint):
        return "the model of all records has another shape there"
    if _has_pole(one, joint.poles, joint.channels):
        return "the model of all records has poles there that do not stay over the orders"
    return "the model of all records has no pole there"


def _has_pole(one: MergedMode, poles: Poles, channels: Sequence[str]) -> bool:
    f = one.mode.frequency_hz
    width = max(SAME * f.sd, abs(one.mode.damping_ratio.value) * f.value)
    near = np.flatnonzero(np.abs(poles.frequency_hz - f.value) <= width)
    return any(_alike(one, poles.shape[:, k], channels) >= ALIKE for k in near)


def _hz(mode: Mode) -> str:
    return f"{mode.frequency_hz.value:.5g} Hz"


def _over(one: MergedMode, channels: Sequence[str]) -> Mode:
    """Mode over the channels in the order of the joint model, flagged."""
    at = [one.channels.index(name) for name in channels]
    return dataclasses.replace(
        one.mode,
        shape=one.mode.shape[at],
        shape_sd=one.mode.shape_sd[at],
        flags=(*one.mode.flags, AFTER),
    )
