"""Automatic identification of all modes in a multichannel record.

Lines of machines are found and taken out; subspace models of many orders, in bands of a few
tens of percent, name the candidates; the likelihood of the spectra decides which of them are
modes, and says how well each is known. Bands, rates, lags and orders follow from the record.
"""

import dataclasses
import itertools

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from slowtime.identification import checks
from slowtime.identification.estimates import Measured
from slowtime.identification.harmonics.beside_lines import FLAG as BESIDE_A_LINE
from slowtime.identification.harmonics.beside_lines import MachineLines
from slowtime.identification.harmonics.detection import (
    PeakClass,
    classify_in_spectra,
    find_harmonics,
)
from slowtime.identification.harmonics.narrowband import FourierSpectra
from slowtime.identification.harmonics.periodic_force import FLAG, without_periodic_force
from slowtime.identification.harmonics.tones import remove_lines
from slowtime.identification.mode_shapes.criteria import normalised
from slowtime.identification.modes import Mode
from slowtime.identification.options import Selection
from slowtime.identification.spectral_likelihood.mode_selection import (
    FittedMode,
    InitialMode,
    fit_modes,
    select_modes,
    widen_for_windows,
)
from slowtime.identification.spectral_likelihood.windows import Spectrum
from slowtime.identification.subspace.bands import EDGE, Passband, demodulate, plan_bands
from slowtime.identification.subspace.correlations import correlation_matrices
from slowtime.identification.subspace.poles import PoleLimits, Poles, combine_poles
from slowtime.identification.subspace.ssi import identify_poles
from slowtime.identification.subspace.stabilisation import StablePole, find_stable_poles
from slowtime.signals.spectra import detrended

from .acceptance import ALIKE as ALIKE
from .acceptance import CLEAR_PEAK as CLEAR_PEAK
from .acceptance import FLANKS as FLANKS
from .acceptance import MOST_DAMPING as MOST_DAMPING
from .acceptance import MOST_DOUBT as MOST_DOUBT
from .acceptance import MOVED as MOVED
from .acceptance import PEAK as PEAK
from .acceptance import is_mode, without_duplicates
from .by_hand import Chosen, edited
from .modal_result import ModalResult as ModalResult
from .modal_result import join_stabilisation, singular_values
from .roll_off import roll_off_hz

FEWEST_CYCLES = 20
"""Nothing is looked for below so many cycles in the record."""

MOST_ROWS = 16
MOST_ORDER = 30
MOST_DIRECTIONS = 8
"""Block rows, model order and combinations of channels of the subspace models, at most."""

LEAST_POWER = 1e-12
"""Least power of a combination, relative to the strongest [1]: below is rounding."""

SAMPLES_PER_UNKNOWN = 6
"""A short band gets smaller models: so many instants for each row of the Hankel matrix."""


def identify_modes(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
    order: int = MOST_ORDER,
    most: int | None = None,
    selection: Selection | None = None,
) -> ModalResult:
    """Identify every mode that a record shows.

    A mode does not depend on where the edges of the band are, because the band selects what is
    reported only: candidates, neighbours and noise come from the whole record.

    Parameters
    ----------
    samples
        Equally spaced; accelerations, velocities, displacements or strains, each channel in
        any unit. Channels that do not move are left out.
    band_hz
        Of the modes that are reported [Hz]; by default from 20 cycles in the record to nearly
        half the rate.
    order
        Highest order of the subspace model of one band; a band spans about half an octave.
    most
        Keep so many structural modes, those of most evidence.
    selection
        A person's edits of the automatic choice; None for none.

    Returns
    -------
    The modes, with their errors.

    Raises
    ------
    ValueError
        Where an edit names no mode or pole.
    """
    columns = checks.series(samples, rate_hz)
    given = samples[:, None] if samples.ndim == 1 else samples
    moving = checks.moving(given)
    edges = modelled_band(band_hz, rate_hz, len(columns))
    columns = detrended(columns)
    scale = columns.std(axis=0)
    columns /= scale
    # A line leaks everywhere: those beyond the band are taken out, too.
    usual = checks.band(None, rate_hz, len(columns))
    found_lines, families = find_harmonics(
        columns, rate_hz, band_hz=checks.modelled_band(edges, usual)
    )
    everywhere, periods = without_periodic_force(found_lines, rate_hz / len(columns))
    tones = tuple(line.frequency_hz for line in everywhere)
    lines = [line for line in everywhere if edges[0] <= line.frequency_hz.value <= edges[1]]
    count = len(columns)
    if tones:
        columns = remove_lines(columns, rate_hz, tones)
    transform = fft.rfft(columns, axis=0)
    del columns
    frequency, values = singular_values(transform, count, rate_hz)
    highest = min(EDGE * rate_hz / 2, roll_off_hz(transform, rate_hz / 2))
    poles, found, members = _candidates(transform, count, rate_hz, edges, order)
    edges = edges[0], min(edges[1], highest)
    found, members = _below(highest, found, members)
    # In its place: from here on, densities are asked for.
    transform *= np.sqrt(2.0 / (rate_hz * count))
    spectrum = _spectrum(transform, rate_hz / count, tones, periods)
    sharp, others = _sharp(spectrum, found, edges, highest)
    chosen = [Chosen(found[k], members[k], fit) for k, fit in sharp]
    if most is not None:
        asked = [o for o in chosen if checks.is_inside(abs(o.fit.pole) / (2 * np.pi), band_hz)]
        chosen = sorted(asked, key=lambda one: -one.fit.evidence)[:most]
    if selection is not None:
        chosen = edited(spectrum, chosen, others, poles, selection, (edges[0], highest))
    units = _Units(scale, moving)
    modes = [_mode(one, units) for one in chosen]
    if periods > 1:
        modes = [dataclasses.replace(mode, flags=(*mode.flags, FLAG)) for mode in modes]
    else:
        modes = _judged(
            modes,
            FourierSpectra(spectrum.coefficients, spectrum.spacing_hz),
            MachineLines(tones, families, count / rate_hz),
        )
    whole = sorted([*modes, *(_line(v, units) for v in lines)], key=_frequency)
    places = [next(i for i, m in enumerate(whole) if m is mode) for mode in modes]
    return ModalResult(
        modes=tuple(whole),
        stabilisation=join_stabilisation(poles, [one.members for one in chosen], places),
        spectrum_hz=frequency,
        singular_values=values,
        notes=() if selection is None else selection.notes,
    ).within(band_hz)


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


def modelled_band(
    band_hz: tuple[float, float] | None, rate_hz: float, count: int
) -> tuple[float, float]:
    """Band in which modes are modelled, whatever part of it is reported."""
    low, high = _default_band(rate_hz, count)
    if band_hz is not None:
        return checks.modelled_band(checks.band(band_hz, rate_hz, count), (low, high))
    if low >= high:
        raise ValueError(
            f"{count} samples at {rate_hz:g} Hz hold {FEWEST_CYCLES} cycles of nothing below "
            "half the rate. Give a longer record."
        )
    return low, high


def _default_band(rate_hz: float, count: int) -> tuple[float, float]:
    return FEWEST_CYCLES * rate_hz / count, 0.95 * EDGE * rate_hz / 2


def _planned(edges: tuple[float, float], count: int, rate_hz: float) -> list[Passband]:
    """Bands of the subspace models: where edges are wider, others are added to the usual."""
    low, high = edges
    usual = _default_band(rate_hz, count)
    ends = [low, *(edge for edge in usual if low < edge < high), high]
    planned: list[Passband] = []
    for lower, upper in itertools.pairwise(ends):
        planned.extend(plan_bands(lower, upper, rate_hz, resolution_hz=rate_hz / count))
    return planned


def _candidates(
    transform: Complex[np.ndarray, "frequency channel"],
    count: int,
    rate_hz: float,
    edges: tuple[float, float],
    order: int,
) -> tuple[list[Poles], list[StablePole], list[np.ndarray]]:
    """Poles of every band, those that stay over orders, and where all their poles are."""
    poles: list[Poles] = []
    found: list[StablePole] = []
    members: list[np.ndarray] = []
    before = 0
    for band in _planned(edges, count, rate_hz):
        of_band = _poles(transform, count, rate_hz, band, order)
        if of_band is None:
            continue
        staying = find_stable_poles(of_band, low_hz=band.low_hz, high_hz=band.high_hz)
        poles.append(of_band)
        found.extend(staying)
        members.extend(candidate.members + before for candidate in staying)
        before += len(of_band.order)
    return poles, found, members


def _below(
    highest_hz: float, found: list[StablePole], members: list[np.ndarray]
) -> tuple[list[StablePole], list[np.ndarray]]:
    """Candidates where the spectrum is not the filter's."""
    kept = [k for k, candidate in enumerate(found) if candidate.frequency_hz < highest_hz]
    return [found[k] for k in kept], [members[k] for k in kept]


def _poles(
    transform: np.ndarray, count: int, rate_hz: float, band: Passband, order: int
) -> Poles | None:
    """Subspace models of one band, in the strongest combinations of its channels."""
    series, rate, centre = demodulate(transform, count, rate_hz, band)
    scale = np.sqrt(np.mean(np.abs(series) ** 2, axis=0))
    if not (scale > 0).all():
        return None
    series = series / scale
    # Singular vectors of a long matrix, strongest first, by its small Gram matrix.
    power, turned = np.linalg.eigh(series.conj().T @ series)
    number = min(MOST_DIRECTIONS, int(np.count_nonzero(power > LEAST_POWER * power[-1])))
    directions = np.ascontiguousarray(turned[:, ::-1][:, :number])
    series = series @ directions
    rows = min(MOST_ROWS, len(series) // (SAMPLES_PER_UNKNOWN * number))
    if rows < 3:
        return None
    correlations = correlation_matrices(
        series, series, lags=2 * rows, rate_hz=rate, centre_hz=centre
    )
    orders = range(1, min(order, (rows - 1) * number) + 1)
    found = identify_poles(
        correlations,
        block_rows=rows,
        orders=orders,
        weighting="both",
        errors_within=PoleLimits(band.low_hz, band.high_hz),
    )
    return combine_poles(found, scale[:, None] * directions.conj())


def _spectrum(
    transform: np.ndarray, spacing: float, lines: tuple[Measured, ...], periods: float = 1.0
) -> Spectrum:
    """Spectrum of a record; under a periodic force, all periods are worth one."""
    spared = np.zeros(len(transform), dtype=bool)
    for line in lines:
        reach = max(1, int(np.ceil(2.0 * line.sd / spacing))) + 1
        at = round(line.value / spacing)
        spared[max(0, at - reach) : at + reach + 1] = True
    return Spectrum(transform, spacing, spared, 1.0 / periods)


def _sharp(
    spectrum: Spectrum, found: list[StablePole], edges: tuple[float, float], highest_hz: float
) -> tuple[list[tuple[int, FittedMode]], list[InitialMode]]:
    """Choose modes among candidates, then let the spectra say where they are.

    Gives modes, each with its candidate, and what else was modelled.
    """
    low, starts = edges[0], [InitialMode(c.pole, c.shape) for c in found]
    chosen = select_modes(spectrum, starts, low_hz=low, high_hz=highest_hz)
    chosen = without_duplicates([(k, s) for k, s in chosen if is_mode(found[k], s, edges)])
    again = [InitialMode(s.pole, s.shape) for _, s in chosen]
    final = fit_modes(spectrum, again, low_hz=low, high_hz=highest_hz)
    known = widen_for_windows(spectrum, [s for _, s in final], low_hz=low, high_hz=highest_hz)
    sharp = [(chosen[k][0], s) for (k, _), s in zip(final, known, strict=True)]
    kept = without_duplicates([(k, s) for k, s in sharp if is_mode(found[k], s, edges)])
    names = {k for k, _ in kept}
    return kept, [InitialMode(s.pole, s.shape) for k, s in sharp if k not in names]


def _mode(one: Chosen, units: _Units) -> Mode:
    sharp = one.fit
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
        quality=min(one.candidate.share, 1.0),
        flags=one.flags,
    )


def _judged(modes: list[Mode], spectra: FourierSpectra, machines: MachineLines) -> list[Mode]:
    """Call modes harmonics that are too steady for a structure or on a machine's multiple."""
    if not modes:
        return modes
    verdicts = classify_in_spectra(spectra, np.array([_frequency(mode) for mode in modes]))
    judged: list[Mode] = []
    for mode, verdict in zip(modes, verdicts, strict=True):
        place = machines.judge(mode.frequency_hz, mode.damping_ratio)
        kind = "harmonic" if place == "harmonic" else verdict.kind
        doubted = kind == "structural" and place == "doubtful"
        flags = (*mode.flags, BESIDE_A_LINE) if doubted else mode.flags
        judged.append(dataclasses.replace(mode, kind=kind, flags=flags))
    return judged


def _line(verdict: PeakClass, units: _Units) -> Mode:
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
