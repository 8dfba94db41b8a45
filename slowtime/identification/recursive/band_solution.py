"""Modes of one band from its sums of products.

Subspace models of many orders, from the correlations, name the candidates; the likelihood of
the spectral matrices decides which of them are modes, and says how well each is known.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex

from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.criteria import normalised
from slowtime.identification.modes import Mode
from slowtime.identification.subspace.bands import Passband
from slowtime.identification.subspace.correlations import Correlations
from slowtime.identification.subspace.ssi import Poles, identify_poles
from slowtime.identification.subspace.stabilisation import StablePole, find_stable_poles

from .mode_fit import fit_band_modes, is_same
from .window_data import FadingSpectra

STEADY = 5e-4
"""Damping ratio below which, with 95 % probability, a pole is a machine line [1]."""

BIASED = 0.05
"""Least error of a pole between model orders [half-bandwidths]: models of low order are
biased."""

SHARED = 0.05
"""Overlap of neighbouring bands, relative to the edge frequency [1]."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ModelSizes:
    """Block rows, highest order and combinations of channels of the subspace models."""

    rows: int
    order: int
    most_directions: int

    @property
    def lags(self) -> int:
        """Of the correlations that they take."""
        return 2 * self.rows


def strongest_directions(
    series: Complex[np.ndarray, "instant channel"], most: int
) -> Complex[np.ndarray, "channel direction"]:
    """Leading combinations of channels scaled to equal power."""
    scale = np.sqrt(np.mean(np.abs(series) ** 2, axis=0))
    moving = scale > 0
    inverse = np.where(moving, 1.0 / np.where(moving, scale, 1.0), 0.0)
    _, strength, turned = np.linalg.svd(series * inverse, full_matrices=False)
    number = max(1, min(most, int(np.count_nonzero(strength > 1e-6 * strength[0]))))
    return np.asarray(inverse[:, None] * turned[:number].conj().T)


def solve_band(
    correlations: Correlations, seen: FadingSpectra, band: Passband, models: ModelSizes
) -> tuple[Mode, ...]:
    """Modes in and about the core of a band."""
    poles = identify_poles(
        correlations,
        block_rows=models.rows,
        orders=range(1, models.order + 1),
        weighting="both",
    )
    first, last = seen.frequency_hz[[0, -1]]
    lines, found = _told_apart(poles, (0.5 * first, 2.0 * last))
    lines = [line for line in lines if first < line.frequency_hz < last]
    modes = [_line(line, seen) for line in lines]
    for line in lines:
        seen = seen.without_line(line.frequency_hz)
    inside = [candidate for candidate in found if first < candidate.frequency_hz < last]
    below = [candidate for candidate in found if candidate.frequency_hz <= first]
    above = [candidate for candidate in found if candidate.frequency_hz >= last]
    modes.extend(fit_band_modes(seen, inside, [*below[-1:], *above[:1]]))
    low, high = band.low_hz * (1 - SHARED), band.high_hz * (1 + SHARED)
    return tuple(mode for mode in modes if low < mode.frequency_hz.value < high)


def _told_apart(
    poles: Poles, edges_hz: tuple[float, float]
) -> tuple[list[StablePole], list[StablePole]]:
    """Lines of machines, and the other candidates."""
    # A line has no damping: half of its estimates are below zero, where no candidate is looked
    # for. So all poles are looked at with a little more damping than they have. And poles of
    # different orders are never so much alike as the errors of an endless stream would have it:
    # models that are too small are biased.
    sd_f, sd_z, _ = poles.standard_deviations()
    more = STEADY * np.abs(poles.pole)
    half_hz = (more - poles.pole.real) / (2 * np.pi)
    wider = np.maximum(BIASED * half_hz / np.maximum(sd_f, np.finfo(float).tiny), 1.0)
    looked_at = dataclasses.replace(poles, pole=poles.pole - more, draws=poles.draws * wider)
    found = [
        dataclasses.replace(
            candidate,
            pole=complex(poles.pole[candidate.index]),
            frequency_sd_hz=float(sd_f[candidate.index]),
            damping_sd=float(sd_z[candidate.index]),
        )
        for candidate in find_stable_poles(looked_at, low_hz=edges_hz[0], high_hz=edges_hz[1])
    ]
    lines = [candidate for candidate in found if _is_steady(candidate)]
    others = [c for c in found if c.damping_ratio > 0 and not _is_steady(c)]
    return lines, others


def join_bands(bands: list[tuple[Passband, tuple[Mode, ...]]]) -> tuple[Mode, ...]:
    """Join the modes of all bands; of duplicates, the one further from an edge remains."""
    found = [(_inside(band, mode), mode) for band, modes in bands for mode in modes]
    kept: list[Mode] = []
    for _, mode in sorted(found, key=lambda pair: -pair[0]):
        if not any(is_same(mode, other) for other in kept):
            kept.append(mode)
    return tuple(sorted(kept, key=lambda mode: mode.frequency_hz.value))


def _inside(band: Passband, mode: Mode) -> float:
    """Distance from the nearer edge of the core, as a share of the frequency."""
    frequency = mode.frequency_hz.value
    return float(np.log(min(frequency / band.low_hz, band.high_hz / frequency)))


def _is_steady(candidate: StablePole) -> bool:
    return candidate.damping_ratio + 1.64 * candidate.damping_sd < STEADY


def _line(line: StablePole, seen: FadingSpectra) -> Mode:
    """Line of a machine, as the subspace models have it: it is narrower than the ordinates."""
    at = int(np.argmin(np.abs(seen.frequency_hz - line.frequency_hz)))
    shared = seen.cross[at] @ line.shape
    strength = float((line.shape.conj() @ seen.density[at] @ line.shape).real)
    size = float(np.linalg.norm(shared))
    rest = np.maximum(seen.power[at] - np.abs(shared) ** 2 / strength, 0.0)
    return Mode(
        frequency_hz=Measured(line.frequency_hz, line.frequency_sd_hz),
        damping_ratio=Measured(max(line.damping_ratio, 0.0), line.damping_sd),
        correlation=0.0,
        shape=normalised(shared),
        shape_sd=np.sqrt(rest * strength / max(seen.number, 1.0)) / size,
        kind="harmonic",
        quality=min(line.share, 1.0),
    )
