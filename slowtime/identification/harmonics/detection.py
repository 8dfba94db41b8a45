r"""Detection of harmonics of machines among the peaks of a record.

A mode under random force is Gaussian and as wide as its damping; a machine's line keeps its
amplitude, and is narrow or wanders. The null hypothesis is *a mode damped by at least*
`least_damping`; a peak is called a harmonic where such a mode would look so steady with
probability below `false_alarm`. Where the record is too short to tell a tone from a mode of so
little damping (least damping × frequency × duration well under 1) nothing can be rejected
however strong the line: then the peak stays structural, and `decidable` says so.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification import checks
from slowtime.identification.estimates import Measured
from slowtime.identification.modes import Kind
from slowtime.signals.spectra import detrended

from .families import HarmonicFamily, group_into_families
from .narrowband import FourierSpectra, NarrowBand, fourier_spectra, narrow_band
from .sharp_peaks import sharp_peaks
from .sidebands import group_into_sidebands
from .steadiness_test import noise_p_value, steadiness_p_value, tone_p_value
from .tones import (
    SEARCH_BINS,
    line_amplitude,
    line_frequency,
    line_shape,
    remove_lines,
    strongest_bin,
)

LEAST_DAMPING = 5e-4
"""Least damping ratio of a structural mode [1]."""

FALSE_ALARM = 1e-3
"""Probability of classifying a structural mode as harmonic."""


FALSE_ALARM_AT_A_MULTIPLE = 0.05
"""The same at a multiple of a machine speed that is known or detected."""

MULTIPLE_BINS = 1.5
"""Distance from a multiple, beyond the error of the speed [bins]."""

TONE_HALF_WIDTHS = (3, 8)
"""Half-widths of the bands of the tone test [bins]: beside close modes, and in noise."""

HALF_WIDTHS = (8, 32, 128)
"""Half-widths of the bands of the steadiness test [bins]."""

WIDEST = 0.05
"""Largest half-width of the steadiness test, relative to frequency [1]."""

DECIDABLE = 0.1
"""Half-bandwidth of the least damped mode below which a record cannot decide [bins]."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeakClass:
    r"""What one peak is.

    Parameters
    ----------
    frequency_hz
        Of the best tone in the band; of a wandering line, its middle and how far it goes [Hz].
    kind
        `harmonic` where `p_structural` is below the false-alarm rate that holds there.
    p_structural
        Probability that a mode damped by `least_damping` or more looks so steady, or noise
        stands so high: an upper limit over all such modes, all tests counted.
    amplitude
        Root mean square in the channel that moves most, in the unit of the samples.
    shape
        Complex deflection of the channels, of unit norm; 0 in channels that do not move.
    decidable
        Whether the record is long enough to tell.
    sideband
        Whether it was told by its distance from the multiples of a speed.
    """

    frequency_hz: Measured
    kind: Kind
    p_structural: float
    snr_db: float
    amplitude: float
    shape: Complex[np.ndarray, " channel"]
    decidable: bool
    sideband: bool = False


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class DecisionLimits:
    """When a peak is called a harmonic; see `classify_peaks`."""

    least_damping: float = LEAST_DAMPING
    false_alarm: float = FALSE_ALARM

    def __post_init__(self) -> None:
        if not 0 < self.least_damping < 0.1:
            raise ValueError(
                f"least_damping={self.least_damping} is outside (0, 0.1). Give the least "
                "damping ratio that a mode may have, such as 0.0005, not a percentage."
            )
        if not 1e-6 <= self.false_alarm <= 0.1:
            raise ValueError(
                f"false_alarm={self.false_alarm} is outside [1e-6, 0.1]. Give the probability "
                "of calling a mode a harmonic that you can bear."
            )


def classify_peaks(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    frequency_hz: Float[np.ndarray, " peak"],
    *,
    known_hz: tuple[float, ...] = (),
    least_damping: float = LEAST_DAMPING,
    false_alarm: float = FALSE_ALARM,
) -> tuple[PeakClass, ...]:
    r"""Classify the peak at each frequency as harmonic or structural.

    Bands about the peak are looked at for the share that one tone leaves and for steadiness of
    the envelope, against modes drawn with the noise, band and length of the record. The share
    is compared with the least damped mode, for which it is smallest; steadiness with the least
    damping, at or above the limit, that the width of the peak does not contradict [2]_.

    Parameters
    ----------
    frequency_hz
        Where to look, such as the frequencies of identified modes [Hz]. The strongest
        ordinate within 4 bins or 0.1 % is meant.
    known_hz
        Speeds of machines near by, or the mains [Hz]: at their multiples less evidence is asked
        for (a false-alarm rate of 5 %), but evidence it is, for a mode may sit there too.
    least_damping
        Damping ratio below which nothing is taken for a structure [1].
    false_alarm
        Probability of calling a mode of that damping, or more, a harmonic, for each peak.

    References
    ----------
    .. [1] R. Brincker, P. Andersen, N. Møller, "An indicator for separation of structural and
       harmonic modes in output-only modal testing", IMAC 18 (2000): kurtosis and amplitude
       density of band-passed signals, here with a distribution.
    .. [2] R. L. Berger, D. D. Boos, "P values maximized over a confidence set for the nuisance
       parameter", JASA 89 (1994).

    Examples
    --------
    >>> seconds = np.arange(20_000) / 100.0
    >>> noise = np.random.default_rng(1).standard_normal(20_000)
    >>> fan = np.sin(2 * np.pi * 12.34 * seconds)
    >>> [verdict.kind for verdict in classify_peaks(fan + noise, 100.0, np.array([12.34]))]
    ['harmonic']
    """
    doubt = DecisionLimits(least_damping=least_damping, false_alarm=false_alarm)
    spectra, moving = _prepared(samples, rate_hz)
    speeds = tuple(Measured(float(f), 0.0) for f in known_hz)
    return tuple(_verdict(spectra, moving, float(f), doubt, speeds) for f in frequency_hz)


def classify_in_spectra(
    spectra: FourierSpectra, frequency_hz: Float[np.ndarray, " peak"]
) -> tuple[PeakClass, ...]:
    """Classify peaks as `classify_peaks` does, from spectra whose channels all move."""
    moving = np.ones(spectra.coefficients.shape[1], dtype=bool)
    return tuple(
        _verdict(spectra, moving, float(f), DecisionLimits(), ()) for f in frequency_hz
    )


def find_harmonics(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
) -> tuple[tuple[PeakClass, ...], tuple[HarmonicFamily, ...]]:
    """Find the lines of machines in a record, and the base frequencies of their harmonics.

    Every sharp peak is judged as `classify_peaks` would; where the lines found are multiples
    of a base, the other peaks on its multiples are judged again as at a known speed, and peaks
    at one distance from many of its multiples are sidebands (`group_into_sidebands`).

    Harmonics ascend in frequency; `members` of a family counts them from 0.

    Examples
    --------
    >>> seconds = np.arange(20_000) / 100.0
    >>> noise = np.random.default_rng(1).standard_normal(20_000)
    >>> fan = sum(np.sin(2 * np.pi * k * 7.13 * seconds) for k in (1, 2, 4))
    >>> lines, speeds = find_harmonics(fan + noise, 100.0)
    >>> [round(line.frequency_hz.value, 2) for line in lines], speeds[0].orders
    ([7.13, 14.26, 28.52], (1, 2, 4))
    """
    doubt = DecisionLimits()
    spectra, moving = _prepared(samples, rate_hz)
    low, high = checks.band(band_hz, rate_hz, len(samples))
    peaks = sharp_peaks(spectra, low, high)
    searched = round((high - low) / spectra.spacing_hz)
    found = [_verdict(spectra, moving, f, doubt, (), searched) for f in peaks]
    lines = _harmonics(found, spectra.spacing_hz)
    bases = group_into_families(
        tuple(v.frequency_hz for v in lines), resolution_hz=spectra.spacing_hz
    )
    if bases:
        speeds = tuple(family.base_hz for family in bases)
        again = [
            _verdict(spectra, moving, f, doubt, speeds)
            for f, verdict in zip(peaks, found, strict=True)
            if verdict.kind == "structural" and _is_multiple(spectra, f, speeds)
        ]
        lines = _harmonics([*lines, *again], spectra.spacing_hz)
        bases = group_into_families(
            tuple(v.frequency_hz for v in lines), resolution_hz=spectra.spacing_hz
        )
    beside = _sidebands(samples, rate_hz, (low, high), moving, lines, bases)
    return _joined(lines, beside, bases) if beside else (lines, bases)


def _sidebands(
    samples: np.ndarray,
    rate_hz: float,
    band_hz: tuple[float, float],
    moving: np.ndarray,
    lines: tuple[PeakClass, ...],
    bases: tuple[HarmonicFamily, ...],
) -> list[PeakClass]:
    """Sidebands of families, among the peaks of a record without the lines found so far."""
    if not bases:
        return []
    columns = detrended(checks.series(samples, rate_hz))
    tones = tuple(line.frequency_hz for line in lines)
    spectra = fourier_spectra(remove_lines(columns, rate_hz, tones), rate_hz)
    peaks = sharp_peaks(spectra, *band_hz)
    apart = 2.0 * spectra.spacing_hz
    peaks = [f for f in peaks if all(abs(f - tone.value) > apart for tone in tones)]
    places = np.array([*peaks, *(tone.value for tone in tones)])
    found: dict[int, PeakClass] = {}
    for base in bases:
        for group in group_into_sidebands(
            places, base_hz=base.base_hz.value, resolution_hz=spectra.spacing_hz
        ):
            for member in group.members:
                if member < len(peaks) and member not in found:
                    centre = round(peaks[member] / spectra.spacing_hz)
                    line = narrow_band(spectra, centre, TONE_HALF_WIDTHS[0])
                    told = _peak_class(spectra, moving, line, group.p_chance, True)
                    found[member] = dataclasses.replace(told, sideband=True)
    return list(found.values())


def _joined(
    lines: tuple[PeakClass, ...], beside: list[PeakClass], bases: tuple[HarmonicFamily, ...]
) -> tuple[tuple[PeakClass, ...], tuple[HarmonicFamily, ...]]:
    """Lines and their sidebands, ascending; members of families counted among all of them."""
    every = sorted([*lines, *beside], key=lambda line: line.frequency_hz.value)
    place = {id(line): k for k, line in enumerate(every)}
    moved = tuple(
        dataclasses.replace(base, members=tuple(place[id(lines[k])] for k in base.members))
        for base in bases
    )
    return tuple(every), moved


def _prepared(samples: np.ndarray, rate_hz: float) -> tuple[FourierSpectra, np.ndarray]:
    """Spectra of the channels that move, and which do."""
    columns = checks.series(samples, rate_hz)
    given = samples[:, None] if samples.ndim == 1 else samples
    return fourier_spectra(detrended(columns), rate_hz), checks.moving(given)


def _verdict(
    spectra: FourierSpectra,
    moving: np.ndarray,
    frequency_hz: float,
    doubt: DecisionLimits,
    speeds: tuple[Measured, ...],
    searched: int = 2 * SEARCH_BINS + 1,
) -> PeakClass:
    centre = strongest_bin(spectra, frequency_hz)
    expected = _is_multiple(spectra, centre * spectra.spacing_hz, speeds)
    level = max(doubt.false_alarm, FALSE_ALARM_AT_A_MULTIPLE if expected else 0.0)
    least = doubt.least_damping * centre
    # Each peak has the same draws, so that its class does not depend on the others.
    rng = np.random.default_rng(0)
    p, line = _least_likely(spectra, centre, least, level, searched, rng)
    harmonic = p < level
    decidable = least >= DECIDABLE or harmonic
    return _peak_class(spectra, moving, line, p, harmonic, decidable)


def _peak_class(
    spectra: FourierSpectra,
    moving: np.ndarray,
    line: NarrowBand,
    p: float,
    harmonic: bool,
    decidable: bool = True,
) -> PeakClass:
    """Statistics of a peak that was judged."""
    shape = np.zeros(len(moving), dtype=complex)
    shape[moving] = line_shape(spectra, line.centre)
    return PeakClass(
        frequency_hz=line_frequency(line, spectra.spacing_hz),
        kind="harmonic" if harmonic else "structural",
        p_structural=p,
        snr_db=10.0 * float(np.log10(max(line.snr, 1e-12))),
        amplitude=line_amplitude(spectra, line),
        shape=shape,
        decidable=decidable,
    )


def _least_likely(
    spectra: FourierSpectra,
    centre: int,
    least: float,
    level: float,
    searched: int,
    rng: np.random.Generator,
) -> tuple[float, NarrowBand]:
    """Smallest probability of all tests, each paid for, and the band in which it came out."""
    channels, found = spectra.coefficients.shape[1], []
    share = 2.0 * len(TONE_HALF_WIDTHS)
    for half_width in TONE_HALF_WIDTHS:
        line = narrow_band(spectra, centre, half_width)
        p = noise_p_value(line, channels, searched)
        if p < level:
            p = max(p, share * tone_p_value(line, least, level / share, rng))
        found.append((p, line))
    share = 2.0 * len(HALF_WIDTHS)
    for half_width in HALF_WIDTHS:
        settled = min(found, key=lambda pair: pair[0])[0] < level
        if settled or half_width > max(WIDEST * centre, HALF_WIDTHS[0]):
            break
        line = narrow_band(spectra, centre, half_width)
        p = noise_p_value(line, channels, searched)
        if p < level:
            p = max(p, share * steadiness_p_value(line, least, level / share, rng))
        found.append((p, line))
    p, line = min(found, key=lambda pair: pair[0])
    if p >= level:
        line = found[len(TONE_HALF_WIDTHS) - 1][1]
    return min(p, 1.0), line


def _is_multiple(
    spectra: FourierSpectra, frequency_hz: float, speeds: tuple[Measured, ...]
) -> bool:
    for speed in speeds:
        order = max(1, round(frequency_hz / speed.value))
        off = abs(frequency_hz - order * speed.value)
        if off < MULTIPLE_BINS * spectra.spacing_hz + 2.0 * order * speed.sd:
            return True
    return False


def _harmonics(found: list[PeakClass], spacing_hz: float) -> tuple[PeakClass, ...]:
    """Ascending, without those that two peaks led to."""
    kept: list[PeakClass] = []
    rarest_first = sorted(found, key=lambda v: (v.p_structural, -v.snr_db))
    for verdict in rarest_first:
        line = verdict.frequency_hz
        apart = all(
            abs(line.value - other.frequency_hz.value)
            > 2.0 * spacing_hz + 2.0 * max(line.sd, other.frequency_hz.sd)
            for other in kept
        )
        if verdict.kind == "harmonic" and apart:
            kept.append(verdict)
    return tuple(sorted(kept, key=lambda v: v.frequency_hz.value))
