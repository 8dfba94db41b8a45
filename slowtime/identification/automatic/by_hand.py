"""Modes of a record as a person chose them among the automatic ones and their diagram."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.options import Selection
from slowtime.identification.selection import plan_edits
from slowtime.identification.spectral_likelihood.mode_selection import (
    SELECTING,
    FittedMode,
    InitialMode,
    fit_modes,
    widen_for_windows,
)
from slowtime.identification.spectral_likelihood.windows import Spectrum
from slowtime.identification.subspace.poles import Poles
from slowtime.identification.subspace.stabilisation import StablePole

STRAYED = 2.0
"""Distance of a fitted mode from the pole chosen [half-bandwidths] above which the values of
the diagram are stated: the spectrum has nothing there for the fit to hold on to."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Chosen:
    """A mode: its candidate, all poles of which it is one, its fit, and flags."""

    candidate: StablePole
    members: np.ndarray
    fit: FittedMode
    flags: tuple[str, ...] = ()


def edited(
    spectrum: Spectrum,
    automatic: Sequence[Chosen],
    others: Sequence[InitialMode],
    poles: Sequence[Poles],
    selection: Selection,
    limits_hz: tuple[float, float],
) -> list[Chosen]:
    """Edit the automatic choice as a person says.

    Modes by hand are fitted together with all others that are not replaced, whether or not
    these are reported; modes far from an edit keep their values. A mode that the spectrum does
    not bear has the values of its pole.

    The `others` were modelled beside the automatic modes, and are none. Raises `ValueError`
    where an edit names no mode or pole.
    """
    known = [
        dataclasses.replace(
            one.candidate, pole=one.fit.pole, shape=one.fit.shape, members=one.members
        )
        for one in automatic
    ]
    plan = plan_edits(selection, known, poles)
    stays = [k for k in range(len(automatic)) if k not in plan.replaced]
    fits = {k: automatic[k].fit for k in stays}
    by_hand: list[Chosen] = []
    if plan.added:
        new = [one for one, _ in plan.added]
        starts = [
            InitialMode(one.pole, one.shape) for one in (*new, *(known[k] for k in stays))
        ]
        found = _fitted(spectrum, [*starts, *others], limits_hz)
        for number, (one, flag) in enumerate(plan.added):
            fit = _held(found.get(number), of_diagram(one, poles))
            by_hand.append(Chosen(one, one.members, fit, (flag,)))
        edits = [*(one.pole for one in new), *(known[k].pole for k in plan.replaced)]
        for number, k in enumerate(stays, start=len(new)):
            if any(_beside(known[k].pole, pole) for pole in edits):
                fits[k] = _held(found.get(number), fits[k])
    shown = [
        dataclasses.replace(automatic[k], fit=fits[k]) for k in stays if k not in plan.hidden
    ]
    return sorted([*shown, *by_hand], key=lambda one: abs(one.fit.pole))


def _fitted(
    spectrum: Spectrum, starts: Sequence[InitialMode], limits_hz: tuple[float, float]
) -> dict[int, FittedMode]:
    """Fit all modes together, by the place of their start."""
    low, high = limits_hz
    found = fit_modes(spectrum, list(starts), low_hz=low, high_hz=high, all_of_them=True)
    wide = widen_for_windows(spectrum, [s for _, s in found], low_hz=low, high_hz=high)
    return {k: sharp for (k, _), sharp in zip(found, wide, strict=True)}


def _beside(pole: complex, edit: complex) -> bool:
    """Whether a mode is so close to an edit that its values depend on it."""
    return abs(pole - edit) <= SELECTING * max(-pole.real, -edit.real)


def _held(fit: FittedMode | None, before: FittedMode) -> FittedMode:
    """Fit of a mode, or what it was before where the fit left for elsewhere."""
    if fit is None or not np.isfinite(fit.covariance).all():
        return before
    steady = abs(fit.pole - before.pole) <= STRAYED * -before.pole.real
    return fit if steady and fit.pole.real < 0 else before


def of_diagram(one: StablePole, sources: Sequence[Poles]) -> FittedMode:
    """Values of a pole of the diagram, with errors to first order."""
    shapes = np.concatenate([poles.shape for poles in sources], axis=1)[:, one.members]
    shape = one.shape / np.linalg.norm(one.shape)
    turned = shapes / np.linalg.norm(shapes, axis=0)
    turned = turned * np.exp(-1j * np.angle(shape.conj() @ turned))
    away = np.sqrt(np.mean(np.abs(turned - shape[:, None]) ** 2, axis=1))
    alone = len(one.members) < 2 or mac(shape, turned.mean(axis=1)) == 1.0
    # The scatter over the poles of other orders, or the deviation of an arbitrary shape where
    # there are none.
    sd = np.full(len(shape), 1 / np.sqrt(len(shape))) if alone else away
    size, decay = abs(one.pole), -one.pole.real
    omega_sd = 2 * np.pi * one.frequency_sd_hz
    # Of the log decay rate: that of damping ratio and frequency, which err independently.
    log_sd = np.hypot(one.damping_sd / (decay / size), omega_sd / size)
    return FittedMode(
        pole=one.pole,
        covariance=np.diag([log_sd**2, omega_sd**2]),
        shape=shape,
        shape_sd=sd,
        evidence=0.0,
        prominence=0.0,
        strength=0.0,
    )
