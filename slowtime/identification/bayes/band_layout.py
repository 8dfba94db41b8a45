"""Layout of frequency bands: modes that are fitted together, and nearby modes."""

import dataclasses

import numpy as np
from jaxtyping import Complex

from slowtime.identification.estimates import Measured

from .band import Band, band_from
from .initial_estimates import InitialEstimate, RecordSpectrum
from .model import BandModes
from .resonances import cross_periodograms

REACH = 16.0
"""Half-width of a mode's band [half-bandwidths], where no neighbour is nearer."""

TOGETHER = 14.0
"""Distance below which modes are fitted together [mean half-bandwidths]."""

FEWEST_BINS = 16
"""Half-width of a mode's band, at least [bins]."""

MOST_TOGETHER = 8
"""Largest number of modes in one band; larger groups are split at the widest gap."""

MOST_GUESTS = 6
"""Largest number of outside modes in the model of a band."""

FAINT_TAIL = 1e-3
"""Least amplitude of an outside mode's tail, relative to a mode of the band [1]."""

LINE_BINS = 2
"""Bins removed on either side of a machine line."""

LEAST_OWN = 0.05
"""Least independent share of a mode's force in the initial values [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ModeLayout:
    """All modes as far as they are known, ascending, and the coherence of their forces."""

    guesses: tuple[InitialEstimate, ...]
    coherence: Complex[np.ndarray, "mode mode"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandProblem:
    """One band: which modes of the picture it is for, its guests, and where to start."""

    group: tuple[int, ...]
    guests: tuple[int, ...]
    band: Band
    start: BandModes


def band_problems(
    record: RecordSpectrum, picture: ModeLayout, lines: tuple[Measured, ...], *, coherent: bool
) -> list[BandProblem]:
    """Fit problems of all bands, ascending in frequency."""
    return [
        band_problem(record, picture, group, lines, coherent=coherent)
        for group in group_modes(picture.guesses, record.duration_s, coherent=coherent)
    ]


def group_modes(
    found: tuple[InitialEstimate, ...], duration_s: float, *, coherent: bool = False
) -> list[tuple[int, ...]]:
    """Group the modes that are fitted together."""
    widths = np.array([guess.half_width_hz(duration_s) for guess in found])
    places = np.array([guess.frequency_hz for guess in found])
    gaps = np.diff(places) / (0.5 * (widths[1:] + widths[:-1]))
    # Modes with forces in common are fitted together however far apart they are.
    reach = np.inf if coherent else TOGETHER
    chains = np.split(np.arange(len(found)), 1 + np.flatnonzero(gaps >= reach))
    return [group for chain in chains for group in _parted(chain, gaps)]


def _parted(chain: np.ndarray, gaps: np.ndarray) -> list[tuple[int, ...]]:
    if len(chain) <= MOST_TOGETHER:
        return [tuple(chain.tolist())] if len(chain) else []
    cut = 1 + int(np.argmax(gaps[chain[0] : chain[-1]]))
    return _parted(chain[:cut], gaps) + _parted(chain[cut:], gaps)


def band_problem(
    record: RecordSpectrum,
    picture: ModeLayout,
    group: tuple[int, ...],
    lines: tuple[Measured, ...],
    *,
    coherent: bool,
) -> BandProblem:
    """Band, outside modes and initial values of one group of modes."""
    found = picture.guesses
    use = _use(record, found, group, lines)
    centres = np.array([guess.frequency_hz for guess in found])
    band = band_from(
        record.frequency_hz[use],
        record.coefficients[use],
        record.duration_s,
        record.derivatives,
        centres,
    )
    guests = _guests(band, found, group) if coherent else ()
    others = [guess for i, guess in enumerate(found) if i not in group + guests]
    band = dataclasses.replace(band, background=_tails(band, others))
    start = _start(band, picture, group, guests)
    return BandProblem(group, guests, band, dataclasses.replace(start, coherent=coherent))


def _use(
    record: RecordSpectrum,
    found: tuple[InitialEstimate, ...],
    group: tuple[int, ...],
    lines: tuple[Measured, ...],
) -> np.ndarray:
    """Bins as far as the modes reach, or to where a neighbour's reach begins."""
    duration = record.duration_s
    first, last = found[group[0]], found[group[-1]]
    least = FEWEST_BINS / duration
    low = first.frequency_hz - max(REACH * first.half_width_hz(duration), least)
    high = last.frequency_hz + max(REACH * last.half_width_hz(duration), least)
    if group[0] > 0:
        low = max(low, _border(found[group[0] - 1], first, duration))
    if group[-1] + 1 < len(found):
        high = min(high, _border(last, found[group[-1] + 1], duration))
    f = record.frequency_hz
    use = (f >= low) & (f <= high) & (f > 0) & (f < 0.98 * record.rate_hz / 2)
    for line in lines:
        use &= np.abs(f - line.value) > LINE_BINS / duration + 2.0 * line.sd
    return use


def _border(one: InitialEstimate, other: InitialEstimate, duration_s: float) -> float:
    """Between two modes, nearer to the narrower."""
    left, right = one.half_width_hz(duration_s), other.half_width_hz(duration_s)
    gap = other.frequency_hz - one.frequency_hz
    return one.frequency_hz + gap * left / (left + right)


def _power(band: Band, guess: InitialEstimate) -> np.ndarray:
    """Periodogram of one mode of unit peak over the band."""
    poles = np.log([[guess.frequency_hz], [guess.damping_ratio]])
    return np.asarray(np.maximum(cross_periodograms(band, *poles)[:, 0, 0].real, 0.0))


def _guests(
    band: Band, found: tuple[InitialEstimate, ...], group: tuple[int, ...]
) -> tuple[int, ...]:
    """Modes outside that are loudest, in the band, against the faintest mode of it."""
    least = min(float(np.linalg.norm(found[i].shape)) for i in group)
    loudness = {
        i: float(np.sqrt(_power(band, guess).max()) * np.linalg.norm(guess.shape)) / least
        for i, guess in enumerate(found)
        if i not in group
    }
    loudest = sorted(loudness, key=lambda i: -loudness[i])[:MOST_GUESTS]
    return tuple(sorted(i for i in loudest if loudness[i] > FAINT_TAIL))


def _tails(band: Band, others: list[InitialEstimate]) -> np.ndarray | None:
    """Spectral matrices, in the band, of modes that are each driven by a force of its own."""
    if not others:
        return None
    shapes = np.stack([guess.shape for guess in others], axis=1)
    power = np.stack([_power(band, guess) for guess in others])
    return np.asarray(np.einsum("gk,cg,dg->kcd", power, shapes, shapes) + 0j)


def _start(
    band: Band, picture: ModeLayout, group: tuple[int, ...], guests: tuple[int, ...]
) -> BandModes:
    """Guests and first guesses as the start of a fit, noise told from the quiet bins."""
    order = list(guests + group)
    found = [picture.guesses[i] for i in order]
    coherence = picture.coherence[np.ix_(order, order)]
    root = np.linalg.cholesky((1 - LEAST_OWN) * coherence + LEAST_OWN * np.eye(len(order)))
    shapes = np.stack([guess.shape for guess in found], axis=1)
    shapes[:, len(guests) :] = _apart(shapes[:, len(guests) :])
    frequency = np.array([guess.frequency_hz for guess in found])
    frequency[len(guests) :] = np.clip(
        frequency[len(guests) :], band.frequency_hz[1], band.frequency_hz[-2]
    )
    power = np.einsum("kcc->kc", band.scatter).real / band.number[:, None]
    noise = np.quantile(power, 0.2, axis=0)
    return BandModes(
        log_frequency=np.log(frequency),
        log_damping=np.log(np.clip([guess.damping_ratio for guess in found], 1e-4, 0.2)),
        shapes=shapes,
        mixing=root,
        log_noise=np.log(np.maximum(noise, 1e-12 * power.mean())),
        noise_exponent=np.zeros(len(noise)),
        guests=len(guests),
    )


def _apart(shapes: np.ndarray) -> np.ndarray:
    """Shapes that are not all the same, for from there no fit would find its way."""
    moved = shapes.copy()
    channels, number = shapes.shape
    unit = shapes / np.linalg.norm(shapes, axis=0)
    for i in range(1, number):
        overlap = np.abs(unit[:, :i].T @ unit[:, i])
        if overlap.max() > 0.95 and channels > 1:
            tilt = np.cos(np.pi * (np.arange(channels) + 0.5) * i / channels)
            moved[:, i] += 0.3 * np.linalg.norm(shapes[:, i]) * tilt / np.linalg.norm(tilt)
    return np.asarray(moved)
