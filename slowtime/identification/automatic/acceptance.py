"""Acceptance tests of fitted modes, and removal of duplicates."""

import numpy as np

from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.spectral_likelihood.mode_selection import FittedMode
from slowtime.identification.spectral_likelihood.windows import WIDEST
from slowtime.identification.subspace.stabilisation import StablePole

MOST_DAMPING = 0.12
"""Beyond it what is found is the colour of the force rather than a mode."""

MOST_DOUBT = 0.8
"""Standard deviation of log damping, and of frequency in half-bandwidths, at most."""

PEAK = 1.0
"""A mode stands out of what surrounds it by this ratio of densities at least ..."""

MOVED = 2.0
FLANKS = 6.0
CLEAR_PEAK = 10.0
"""... and by this one if it climbed further than so many half-bandwidths from its candidate, or
is so wide that less than so many of them could be seen on either side."""

ALIKE = 0.8
"""MAC of two estimates, less than a half-bandwidth apart, of one mode."""

SKIRT = 12.0
FAINT = 0.1
SAME_SHAPE = 0.95
FEWEST_TO_TELL = 3
"""A bump within so many half-bandwidths of a mode so much stronger, of so much the same shape
where so many channels tell, is a part of it."""


def is_mode(start: StablePole, sharp: FittedMode, edges: tuple[float, float]) -> bool:
    """Within the band, damped like a mode, standing out, and known at all."""
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
    """Without those that climbed to where a likelier one already was, and without satellites.

    A force that is not white leaves bumps on the skirt of a strong mode. They have its shape:
    what moves is that mode.
    """
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
