"""A person's edits of an automatic choice of modes: keep, drop, merge and split poles."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from .mode_shapes.criteria import mac_matrix
from .options import Edit, Selection
from .subspace.poles import Poles
from .subspace.stabilisation import ALIKE, StablePole

REACH = 0.01
"""Largest relative distance of a frequency that a person gives from the pole that is meant [1]:
that of three digits, as tables and diagrams are read."""

READ = 1e-3
"""Relative distance [1] within which poles of a diagram are not told apart by a frequency that
a person reads off it; of these, the pole that most orders have is meant."""

KEPT, MERGED, SPLIT = "kept_by_hand", "merged_by_hand", "split_by_hand"
"""Flags of modes that are not the automatic choice."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SelectionPlan:
    """What edits make of the automatic modes.

    Parameters
    ----------
    hidden
        Automatic modes that are modelled and not reported.
    replaced
        Automatic modes that are neither.
    added
        Starts of modes by hand, with the flag of each.
    """

    hidden: frozenset[int]
    replaced: frozenset[int]
    added: tuple[tuple[StablePole, str], ...]


def plan_edits(
    selection: Selection, automatic: Sequence[StablePole], poles: Sequence[Poles]
) -> SelectionPlan:
    """Find what the edits of a person mean in a diagram.

    Poles are those of the diagram, source by source. Raises `ValueError` where a frequency is
    that of no mode or pole, or a mode is named twice.
    """
    named: dict[int, Edit] = {}
    hidden: set[int] = set()
    added: list[tuple[StablePole, str]] = []
    for edit in selection.edits:
        modes = [_mode_at(hz, automatic, edit) for hz in edit.at_hz]
        for mode in modes:
            if mode is not None and named.setdefault(mode, edit) is not edit:
                raise ValueError(
                    f"{edit} and {named[mode]} name the same mode. Leave out one of them."
                )
        known = [mode for mode in modes if mode is not None]
        if edit.action == "drop":
            hidden.update(known)
        elif edit.action == "keep" and not known:
            added.append((_pole_at(edit.at_hz[0], edit, poles), KEPT))
        elif edit.action == "merge":
            if len(set(known)) < 2:
                raise ValueError(f"{edit} names a single mode. Give two or more of them.")
            added.append((_mean([automatic[mode] for mode in known]), MERGED))
        elif edit.action == "split":
            added += [(_pole_at(hz, edit, poles), SPLIT) for hz in edit.into_hz]
    replaced = {mode for mode, edit in named.items() if edit.action in ("merge", "split")}
    if not selection.automatic:
        hidden.update(set(range(len(automatic))) - set(named))
    return SelectionPlan(
        hidden=frozenset(hidden), replaced=frozenset(replaced), added=tuple(added)
    )


def _mode_at(hz: float, automatic: Sequence[StablePole], edit: Edit) -> int | None:
    """Automatic mode nearest to a frequency; None where a pole beside all modes is kept."""
    away = np.array([abs(one.frequency_hz / hz - 1.0) for one in automatic])
    if len(away) and away.min() <= REACH:
        nearest = int(np.argmin(away))
        # Of a pole beside a mode, the distances tell which is meant.
        if edit.action != "keep" or edit.order is None:
            return nearest
        return None
    if edit.action == "keep":
        return None
    there = ", ".join(f"{one.frequency_hz:.5g}" for one in automatic) or "none"
    raise ValueError(
        f"{edit}: there is no mode within {100 * REACH:g} % of {hz:g} Hz. Modes [Hz]: {there}."
    )


def _pole_at(hz: float, edit: Edit, sources: Sequence[Poles]) -> StablePole:
    """Pole of the diagram nearest to a frequency, of the order given or else of the most."""
    best: tuple[float, int, Poles, int] | None = None
    before = 0
    for poles in sources:
        away = np.abs(poles.frequency_hz / hz - 1.0)
        # Far from the middle of its band, a pole comes without errors.
        known = np.isfinite(poles.standard_deviations()[0])
        meant = (away <= REACH) & (poles.damping_ratio > 0) & known
        if edit.order is not None:
            meant &= poles.order == edit.order
        for index in np.flatnonzero(meant).tolist():
            rank = float(away[index])
            if rank <= READ:
                rank -= len(_members(poles, index))
            if best is None or rank < best[0]:
                best = rank, before, poles, index
        before += len(poles.order)
    if best is None:
        of = "" if edit.order is None else f" of order {edit.order}"
        raise ValueError(
            f"{edit}: the stabilisation diagram has no pole{of} within {100 * REACH:g} % of "
            f"{hz:g} Hz. Read frequency and order off the diagram of --report."
        )
    _, before, poles, index = best
    members = _members(poles, index)
    orders = np.unique(poles.order[members])
    sd_f, sd_z, _ = poles.standard_deviations()
    return StablePole(
        pole=complex(poles.pole[index]),
        shape=poles.shape[:, index],
        frequency_sd_hz=float(sd_f[index]),
        damping_sd=float(sd_z[index]),
        orders=len(orders),
        share=len(orders) / (int(poles.order.max()) - int(orders[0]) + 1),
        members=members + before,
        index=index + before,
    )


def _members(poles: Poles, index: int) -> np.ndarray:
    """Poles of all orders within the half-bandwidths of a pole and of its shape."""
    pole = poles.pole[index]
    width = np.minimum(np.abs(poles.pole.real), abs(pole.real))
    near = np.flatnonzero(np.abs(poles.pole - pole) <= width)
    alike = mac_matrix(poles.shape[:, near], poles.shape[:, [index]])[:, 0] >= ALIKE
    return np.asarray(near[alike | (near == index)])


def _mean(modes: Sequence[StablePole]) -> StablePole:
    """Start of a mode that several poles are: their mean, with the shape of the longest."""
    longest = max(modes, key=lambda one: one.orders)
    return dataclasses.replace(
        longest,
        pole=complex(np.mean([one.pole for one in modes])),
        members=np.unique(np.concatenate([one.members for one in modes])),
    )
