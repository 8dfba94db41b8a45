"""Record of many channels in; every mode it shows, with honest errors, and nothing else, out.

Lines of machines are found and taken out; subspace models of many orders, in bands of a few
tens of percent, name the candidates; the likelihood of the spectra decides which of them are
modes, and says how well each is known. Bands, rates, lags and orders follow from the record.
"""

import dataclasses

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from slowtime.signals.spectra import detrended

from . import checks
from .bands import EDGE, Band, moved_to_zero, plan
from .correlations import correlate
from .harmonics import Verdict, find_harmonics, judge
from .identified import Measured
from .modes import Mode
from .shapes import mac, normalised
from .sharpen import WIDEST, Sharp, Spectrum, Start, select, sharpen
from .ssi import Poles, identify, mixed
from .stabilisation import Candidate, Stabilisation, candidates
from .tones import without_lines

FEWEST_CYCLES = 20
"""Nothing is looked for below so many cycles in the record."""

MOST_ROWS = 16
MOST_ORDER = 30
MOST_DIRECTIONS = 8
"""Block rows, model order and combinations of channels of the subspace models, at most."""

SAMPLES_PER_UNKNOWN = 6
"""A short band gets smaller models: so many instants for each row of the Hankel matrix."""

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

SPECTRUM_POINTS = 2000


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalResult:
    """All that identification says of a record.

    Parameters
    ----------
    modes
        Ascending in frequency, lines of machines among them.
    stabilisation
        Poles of all bands and orders, for a diagram.
    spectrum_hz, singular_values
        Singular values of the averaged spectral matrices of channels of unit variance.
    """

    modes: tuple[Mode, ...]
    stabilisation: Stabilisation
    spectrum_hz: Float[np.ndarray, " frequency"]
    singular_values: Float[np.ndarray, "frequency value"]

    @property
    def structural(self) -> tuple[Mode, ...]:
        """Modes that are no machine's."""
        return tuple(mode for mode in self.modes if mode.kind == "structural")


def identify_modes(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
    order: int = MOST_ORDER,
    most: int | None = None,
) -> ModalResult:
    """Identify every mode that a record shows.

    Parameters
    ----------
    samples
        Equally spaced; accelerations, velocities, displacements or strains, each channel in
        any unit. Channels that do not move are left out.
    rate_hz
        Samples per second [Hz].
    band_hz
        Where modes are looked for [Hz]; by default from 20 cycles in the record to nearly half
        the rate.
    order
        Highest order of the subspace model of one band; a band spans about half an octave.
    most
        Keep so many structural modes, those of most evidence.
    """
    columns = checks.series(samples, rate_hz)
    given = samples[:, None] if samples.ndim == 1 else samples
    moving = checks.moving(given)
    edges = _band(band_hz, rate_hz, len(columns))
    columns = detrended(columns)
    scale = columns.std(axis=0)
    columns = columns / scale
    # A line leaks everywhere: those beyond the band are taken out, too.
    everywhere, _ = find_harmonics(
        columns, rate_hz, band_hz=_widest(edges, rate_hz, len(columns))
    )
    tones = tuple(line.frequency_hz for line in everywhere)
    lines = [line for line in everywhere if edges[0] <= line.frequency_hz.value <= edges[1]]
    cleaned = without_lines(columns, rate_hz, tones) if tones else columns
    transform = fft.rfft(cleaned, axis=0)
    poles, found, members = _candidates(transform, len(columns), rate_hz, edges, order)
    spectrum = _spectrum(transform, len(columns), rate_hz, tones)
    sharp = _sharp(spectrum, found, edges, EDGE * rate_hz / 2)
    if most is not None:
        strongest = sorted(sharp, key=lambda pair: -pair[1].evidence)[:most]
        sharp = [pair for pair in sharp if pair in strongest]
    units = _Units(scale, moving)
    modes = [_mode(found[k], s, units) for k, s in sharp]
    modes = _judged(modes, cleaned, rate_hz)
    whole = sorted([*modes, *(_line(v, units) for v in lines)], key=_frequency)
    members = [members[k] for k, _ in sharp]
    places = [next(i for i, m in enumerate(whole) if m is mode) for mode in modes]
    frequency, values = _singular_values(transform, len(columns), rate_hz)
    return ModalResult(
        modes=tuple(whole),
        stabilisation=_diagram(poles, members, places),
        spectrum_hz=frequency,
        singular_values=values,
    )


@dataclasses.dataclass(frozen=True, slots=True)
class _Units:
    """Scale of the channels that move, and which do."""

    scale: np.ndarray
    moving: np.ndarray

    def shape(self, shape: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shape and its errors in the units and over all the channels that were given."""
        whole, errors = np.zeros(len(self.moving), dtype=complex), np.zeros(len(self.moving))
        raw = shape * self.scale
        whole[self.moving] = normalised(raw)
        errors[self.moving] = sd * self.scale / np.linalg.norm(raw)
        return whole, errors


def _frequency(mode: Mode) -> float:
    return mode.frequency_hz.value


def _band(
    band_hz: tuple[float, float] | None, rate_hz: float, count: int
) -> tuple[float, float]:
    if band_hz is not None:
        return checks.band(band_hz, rate_hz, count)
    low, high = FEWEST_CYCLES * rate_hz / count, 0.95 * EDGE * rate_hz / 2
    if low >= high:
        raise ValueError(
            f"{count} samples at {rate_hz:g} Hz hold {FEWEST_CYCLES} cycles of nothing below "
            "half the rate. Give a longer record."
        )
    return low, high


def _widest(edges: tuple[float, float], rate_hz: float, count: int) -> tuple[float, float]:
    """Widest band in which lines can be told, and no less than `edges`."""
    low, high = checks.band(None, rate_hz, count)
    return min(low, edges[0]), max(high, edges[1])


def _candidates(
    transform: Complex[np.ndarray, "frequency channel"],
    count: int,
    rate_hz: float,
    edges: tuple[float, float],
    order: int,
) -> tuple[list[Poles], list[Candidate], list[np.ndarray]]:
    """Poles of every band, those that stay over orders, and where all their poles are."""
    poles: list[Poles] = []
    found: list[Candidate] = []
    members: list[np.ndarray] = []
    before = 0
    for band in plan(*edges, rate_hz, resolution_hz=rate_hz / count):
        of_band = _poles(transform, count, rate_hz, band, order)
        if of_band is None:
            continue
        staying = candidates(of_band, low_hz=band.low_hz, high_hz=band.high_hz)
        poles.append(of_band)
        found.extend(staying)
        members.extend(candidate.members + before for candidate in staying)
        before += len(of_band.order)
    return poles, found, members


def _poles(
    transform: np.ndarray, count: int, rate_hz: float, band: Band, order: int
) -> Poles | None:
    """Subspace models of one band, in the strongest combinations of its channels."""
    series, rate, centre = moved_to_zero(transform, count, rate_hz, band)
    scale = np.sqrt(np.mean(np.abs(series) ** 2, axis=0))
    if not (scale > 0).all():
        return None
    series = series / scale
    _, strength, turned = np.linalg.svd(series, full_matrices=False)
    number = min(MOST_DIRECTIONS, int(np.count_nonzero(strength > 1e-6 * strength[0])))
    directions = turned[:number].conj().T
    series = series @ directions
    rows = min(MOST_ROWS, len(series) // (SAMPLES_PER_UNKNOWN * number))
    if rows < 3:
        return None
    correlations = correlate(series, series, lags=2 * rows, rate_hz=rate, centre_hz=centre)
    orders = range(1, min(order, (rows - 1) * number) + 1)
    found = identify(correlations, block_rows=rows, orders=orders, weighting="both")
    return mixed(found, scale[:, None] * directions.conj())


def _spectrum(
    transform: np.ndarray, count: int, rate_hz: float, lines: tuple[Measured, ...]
) -> Spectrum:
    spacing = rate_hz / count
    spared = np.zeros(len(transform), dtype=bool)
    for line in lines:
        reach = max(1, int(np.ceil(2.0 * line.sd / spacing))) + 1
        at = round(line.value / spacing)
        spared[max(0, at - reach) : at + reach + 1] = True
    return Spectrum(transform * np.sqrt(2.0 / (rate_hz * count)), spacing, spared)


def _sharp(
    spectrum: Spectrum, found: list[Candidate], edges: tuple[float, float], highest_hz: float
) -> list[tuple[int, Sharp]]:
    """Choose modes among candidates, then let the spectra say where they are."""
    low, starts = edges[0], [Start(c.pole, c.shape) for c in found]
    chosen = select(spectrum, starts, low_hz=low, high_hz=highest_hz)
    chosen = _distinct([(k, s) for k, s in chosen if _is_mode(found[k], s, edges)])
    again = [Start(s.pole, s.shape) for _, s in chosen]
    final = sharpen(spectrum, again, low_hz=low, high_hz=highest_hz)
    sharp = [(chosen[k][0], s) for k, s in final]
    return _distinct([(k, s) for k, s in sharp if _is_mode(found[k], s, edges)])


def _is_mode(start: Candidate, sharp: Sharp, edges: tuple[float, float]) -> bool:
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


def _distinct(sharp: list[tuple[int, Sharp]]) -> list[tuple[int, Sharp]]:
    """Without those that climbed to where a likelier one already was, and without satellites.

    A force that is not white leaves bumps on the skirt of a strong mode. They have its shape:
    what moves is that mode.
    """
    kept: list[tuple[int, Sharp]] = []
    for k, one in sorted(sharp, key=lambda pair: -pair[1].strength):
        if not any(_is_same(one, other) for _, other in kept):
            kept.append((k, one))
    return sorted(kept, key=lambda pair: abs(pair[1].pole))


def _is_same(weak: Sharp, strong: Sharp) -> bool:
    width = max(-weak.pole.real, -strong.pole.real)
    away = abs(weak.pole - strong.pole) / width
    alike = mac(weak.shape, strong.shape)
    if away < 1.0:
        return alike > ALIKE
    told_apart = len(weak.shape) >= FEWEST_TO_TELL and alike < SAME_SHAPE
    return away < SKIRT and weak.strength < FAINT * strong.strength and not told_apart


def _mode(candidate: Candidate, sharp: Sharp, units: _Units) -> Mode:
    size = abs(sharp.pole)
    damping = -sharp.pole.real / size
    turning = sharp.pole.imag / size
    # Of log decay and angular frequency: first on frequency [Hz], then on the damping ratio.
    onto = np.array(
        [
            [sharp.pole.real**2 / size, turning],
            [damping * (1 - damping**2), -damping * turning / size],
        ]
    )
    onto[0] /= 2 * np.pi
    covariance = onto @ sharp.covariance @ onto.T
    sd = np.sqrt(np.diag(covariance))
    shape, shape_sd = units.shape(sharp.shape, sharp.shape_sd)
    return Mode(
        frequency_hz=Measured(size / (2 * np.pi), float(sd[0])),
        damping_ratio=Measured(float(damping), float(sd[1])),
        correlation=float(covariance[0, 1] / (sd[0] * sd[1])),
        shape=shape,
        shape_sd=shape_sd,
        quality=min(candidate.share, 1.0),
    )


def _judged(modes: list[Mode], columns: np.ndarray, rate_hz: float) -> list[Mode]:
    """Modes too steady for a structure called harmonics."""
    if not modes:
        return modes
    verdicts = judge(columns, rate_hz, np.array([_frequency(mode) for mode in modes]))
    return [
        dataclasses.replace(mode, kind=verdict.kind)
        for mode, verdict in zip(modes, verdicts, strict=True)
    ]


def _line(verdict: Verdict, units: _Units) -> Mode:
    """Line of a machine as a mode without damping."""
    error = np.sqrt(1.0 / max(10.0 ** (verdict.snr_db / 10.0), 1e-12))
    sd = np.full(len(verdict.shape), min(error, 1.0))
    shape, shape_sd = units.shape(verdict.shape, sd)
    return Mode(
        frequency_hz=verdict.frequency_hz,
        damping_ratio=Measured(0.0, 0.0),
        correlation=0.0,
        shape=shape,
        shape_sd=shape_sd,
        kind="harmonic",
        quality=1.0 - verdict.p_structural,
    )


def _diagram(poles: list[Poles], members: list[np.ndarray], places: list[int]) -> Stabilisation:
    """All bands side by side."""
    sd = [p.standard_deviations() for p in poles]
    count = sum(len(p.order) for p in poles)
    mode = np.full(count, -1)
    for which, place in zip(members, places, strict=True):
        mode[which] = place
    empty = np.zeros(0)
    return Stabilisation(
        order=np.concatenate([np.zeros(0, dtype=int), *(p.order for p in poles)]),
        frequency_hz=np.concatenate([empty, *(p.frequency_hz for p in poles)]),
        frequency_sd_hz=np.concatenate([empty, *(s[0] for s in sd)]),
        damping_ratio=np.concatenate([empty, *(p.damping_ratio for p in poles)]),
        damping_sd=np.concatenate([empty, *(s[1] for s in sd)]),
        mode=mode,
    )


def _singular_values(
    transform: np.ndarray, count: int, rate_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Of spectral matrices averaged over neighbouring ordinates, descending."""
    group = max(transform.shape[1], len(transform) // SPECTRUM_POINTS)
    groups = (len(transform) - 1) // group
    parts = transform[1 : 1 + groups * group].reshape(groups, group, -1)
    density = parts.transpose(0, 2, 1) @ parts.conj() / group * (2.0 / (rate_hz * count))
    frequency = (np.arange(groups) * group + (group + 1) / 2) * rate_hz / count
    return frequency, np.linalg.eigvalsh(density)[:, ::-1]
