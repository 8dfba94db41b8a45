"""Frequency windows of a spectrum, with the modes that are fitted together."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Complex

WIDEST = 0.5
"""Largest half-width of a window, relative to frequency [1]."""

FEWEST_BINS = 40
"""Least half-width of a window [bins]."""

CLOSE = 6.0
"""Distance below which modes are fitted together [half-bandwidths]."""

MOST_TOGETHER = 8
"""Largest number of modes in one window."""

JOINT = 1.1
"""Largest width of a joint window, relative to the wider of the two [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Fourier coefficients of channels of like power; |coefficient|² is a density.

    `spared` marks ordinates that are not to be used, such as those of a line taken out;
    `worth` is what one ordinate is worth in independent ones [1].
    """

    coefficients: Complex[np.ndarray, "frequency channel"]
    spacing_hz: float
    spared: np.ndarray
    worth: float = 1.0


@dataclasses.dataclass(frozen=True, slots=True)
class SpectralWindow:
    """Ordinates from `first` to `last`, the modes in them, and modes beside them."""

    first: int
    last: int
    modes: list[int]
    beside: list[int]

    @staticmethod
    def about(
        spectrum: Spectrum,
        poles: np.ndarray,
        group: list[int],
        edges: tuple[float, float],
        wide: float,
        beside: int,
    ) -> "SpectralWindow":
        """Window about a group of poles.

        It reaches `wide` [half-bandwidths] beyond the group, within the edges [Hz]; at most
        `beside` modes on either side are modelled with it.
        """
        frequency, half = poles.imag / (2 * np.pi), -poles.real / (2 * np.pi)
        below = min(frequency[k] - wide * half[k] for k in group)
        above = max(frequency[k] + wide * half[k] for k in group)
        lowest, highest = frequency[group[0]], frequency[group[-1]]
        least = FEWEST_BINS * spectrum.spacing_hz
        below = min(max(below, lowest * (1 - WIDEST)), lowest - least)
        above = max(min(above, highest * (1 + WIDEST)), highest + least)
        modes = list(group)
        others = [k for k in range(len(poles)) if k not in group]
        for k in sorted(others, key=lambda k: min(abs(frequency[k] - frequency[group]))):
            if not below < frequency[k] < above:
                continue
            if len(modes) < MOST_TOGETHER:
                modes.append(k)
            elif frequency[k] < lowest:
                below = 0.5 * (frequency[k] + min(frequency[m] for m in modes))
            else:
                above = 0.5 * (frequency[k] + max(frequency[m] for m in modes))
        lower = [k for k in range(min(modes)) if frequency[k] <= below]
        upper = [k for k in range(max(modes) + 1, len(poles)) if frequency[k] >= above]
        around = lower[len(lower) - min(beside, len(lower)) :] + upper[:beside]
        below, above = max(below, edges[0] / 2), min(above, edges[1])
        first = max(2, int(np.ceil(below / spectrum.spacing_hz)))
        last = min(len(spectrum.coefficients) - 2, int(above / spectrum.spacing_hz))
        return SpectralWindow(first, last, sorted(modes), around)


def group_close_poles(poles: np.ndarray) -> list[list[int]]:
    """Group neighbouring poles; large groups are split at the widest gaps."""
    groups: list[list[int]] = []
    for k in range(len(poles)):
        if groups:
            gap = poles[k].imag - poles[k - 1].imag
            if gap < -CLOSE * (poles[k].real + poles[k - 1].real) / 2:
                groups[-1].append(k)
                continue
        groups.append([k])
    return [part for group in groups for part in _split(group, poles)]


def shared_windows(
    groups: list[list[int]], about: Callable[[list[int]], SpectralWindow]
) -> list[tuple[list[int], SpectralWindow]]:
    """Windows of the groups; neighbours with nearly the same window share one."""
    shared: list[tuple[list[int], SpectralWindow]] = []
    for group in groups:
        window = about(group)
        if shared:
            both = about(shared[-1][0] + group)
            parts = (shared[-1][1], window)
            needed = {mode for part in parts for mode in part.modes}
            widest = max(part.last - part.first for part in parts)
            if both.last - both.first <= JOINT * widest and needed <= set(both.modes):
                shared[-1] = (shared[-1][0] + group, both)
                continue
        shared.append((group, window))
    return shared


def _split(group: list[int], poles: np.ndarray) -> list[list[int]]:
    if len(group) <= MOST_TOGETHER // 2 + 1:
        return [group]
    at = 1 + int(np.argmax(np.diff(poles[group].imag)))
    return _split(group[:at], poles) + _split(group[at:], poles)
