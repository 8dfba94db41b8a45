"""Acceptance tests of fitted modes, and removal of duplicates."""

import numpy as np

from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.spectral_likelihood.mode_selection import FittedMode
from slowtime.identification.spectral_likelihood.windows import WIDEST
from slowtime.identification.subspace.stabilisation import StablePole

MOST_DAMPING = 0.12
"""Largest damping ratio of a mode [1]; a wider peak is taken for the colour of the force."""

MOST_DOUBT = 0.8
"""Largest standard deviation of ln zeta, and of the frequency [half-bandwidths]."""

PEAK = 1.0
"""Least prominence: density of the mode over everything else at its peak [1]."""

MOVED = 2.0
"""Distance from the candidate beyond which `CLEAR_PEAK` applies [half-bandwidths]."""

FLANKS = 6.0
"""Visible distance on either side below which `CLEAR_PEAK` applies [half-bandwidths]."""

CLEAR_PEAK = 10.0
"""Least prominence of a mode that moved far from its candidate or whose flanks are hardly
visible [1]."""

ALIKE = 0.8
"""Least MAC of two estimates of one mode, less than a half-bandwidth apart [1]."""

SKIRT = 12.0
"""Range of satellites of a mode [half-bandwidths]."""

FAINT = 0.1
"""Strength of a satellite relative to its mode, at most [1]."""

SAME_SHAPE = 0.95
"""Least MAC of a satellite with its mode [1]."""

FEWEST_TO_TELL = 3
"""Least number of channels for a comparison of shapes."""


def is_mode(start: StablePole, sharp: FittedMode, edges: tuple[float, float]) -> bool:
    """Whether damping, prominence and errors of a fitted pole are those of a mode."""
    frequency = abs(sharp.pole) / (2 * np.pi)
    damping = -sharp.pole.real / abs(sharp.pole)
    sd_of_log_decay, sd_of_omega = np.sqrt(np.diag(sharp.covariance))
    moved = abs(sharp.pole - start.pole) / max(-sharp.pole.real, -start.pole.real)
    plain = moved < MOVED and damping * FLANKS < WIDEST
    return bool(
        edges[0] <= frequency <= edges[1]
        and damping < MOST_DAMPING
        and sharp.prominence > (PEAK if plain else CLEAR_PEAK)
        and sd_of_log_decay < MOST_DOUBT
        and sd_of_omega < MOST_DOUBT * -sharp.pole.real
    )


def without_duplicates(sharp: list[tuple[int, FittedMode]]) -> list[tuple[int, FittedMode]]:
    """Remove fits that converged to a likelier one, and satellites of stronger modes."""
    # A force that is not white leaves bumps on the skirt of a strong mode. They have its shape:
    # what moves is that mode.
    kept: list[tuple[int, FittedMode]] = []
    for k, one in sorted(sharp, key=lambda pair: -pair[1].strength):
        if not any(_is_same(one, other) for _, other in kept):
            kept.append((k, one))
    return sorted(kept, key=lambda pair: abs(pair[1].pole))


def _is_same(weak: FittedMode, strong: FittedMode) -> bool:
    width = max(-weak.pole.real, -strong.pole.real)
    away = abs(weak.pole - strong.pole) / width
    alike = mac(weak.shape, strong.shape)
    if away < 1.0:
        return alike > ALIKE
    told_apart = len(weak.shape) >= FEWEST_TO_TELL and alike < SAME_SHAPE
    return away < SKIRT and weak.strength < FAINT * strong.strength and not told_apart
