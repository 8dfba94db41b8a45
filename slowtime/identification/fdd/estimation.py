r"""Frequency domain decomposition, plain (FDD) and enhanced (EFDD).

Plain (FDD): a peak of the first singular value is a mode, the first vector there its shape.
Enhanced (EFDD): the part of the spectrum that has this shape, the bell, is turned back into a
correlation, whose decay gives frequency and damping.

What differs from the literature: peaks are found by how far they stand out of the scatter; the
bell is projected on the shape (as in [3]_) with the resolution of the whole record; what
truncation, floor and leakage do to the regression is worked out on the spectrum that was found
and taken off; and everything has a standard deviation. All estimates are smooth functions of
ordinates :math:`I_k` that are nearly independent and exponential, so that their covariance is
:math:`\sum_k g_k g_k^T \, \mathrm{var}\, I_k`, g the derivatives, and :math:`I_k^2 / 2` is an
unbiased estimate of the variance. No bootstrap, no segments are needed.

References
----------
.. [1] R. Brincker, L. Zhang, P. Andersen, "Modal identification of output-only systems using
   frequency domain decomposition", Smart Materials and Structures 10 (2001).
.. [2] R. Brincker, C. Ventura, P. Andersen, "Damping estimation by frequency domain
   decomposition", IMAC 19 (2001).
.. [3] L. Zhang, T. Wang, Y. Tamura, "A frequency-spatial domain decomposition (FSDD) method for
   operational modal analysis", Mechanical Systems and Signal Processing 24 (2010).
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification import checks
from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.criteria import mac_matrix
from slowtime.identification.modes import Mode

from .correlation_decay import fit_correlation_decay
from .spectral_decomposition import (
    PLACES,
    RESOLUTION,
    ScaledCoefficients,
    SpectralDecomposition,
    decompose_spectrum,
    ordinates_about,
    scaled_coefficients,
)

ALIKE = 0.8
"""Least MAC with the mode's shape within its bell [1]."""

REACH = 24
"""Largest half-width of a bell [half-widths of the average]."""

WIDE = 4.0
"""Width of the average that locates the peak [half-bandwidths]."""

NOTHING = Measured(float("nan"), float("nan"))


def fdd(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
    resolution: float = RESOLUTION,
    lines: tuple[Measured, ...] = (),
    derivatives: int = 2,
) -> tuple[Mode, ...]:
    r"""Modes at the peaks of the first singular value; quick, and without damping.

    Parameters
    ----------
    samples, rate_hz
        Record in any unit, channels in columns.
    band_hz
        Of the modes that are reported [Hz]; by default from 20 cycles in the record to nearly
        half the rate.
    resolution
        Half-width over which ordinates are averaged, relative to the frequency. Modes nearer
        to each other than about twice that are seen as one.
    lines
        Lines of machines, to be taken out; see `find_harmonics`.
    derivatives
        What the samples are: 2 for accelerations, 1 velocities, 0 displacements; of little
        consequence but for modes of high damping.

    Returns
    -------
    Ascending in frequency. Damping and its correlation are NaN, flagged `no_damping`. Quality
    is the share of the first singular value in their sum.

    Examples
    --------
    >>> from slowtime.dynamics.sdof.oscillator import Oscillator
    >>> from slowtime.dynamics.sdof.simulation import ambient_acceleration
    >>> rng = np.random.default_rng(2)
    >>> ringing = ambient_acceleration(Oscillator.from_modal(5.0, 0.01), 20_000, 50.0, rng)
    >>> both = ringing[:, None] * [1.0, -0.5] + 0.1 * rng.standard_normal((20_000, 2))
    >>> mode, = fdd(both, 50.0)
    >>> low, high = mode.frequency_hz.interval()
    >>> low < 5.0 < high, mode.shape.real.round(2)
    (True, array([ 0.89, -0.45]))
    """
    data = scaled_coefficients(samples, rate_hz, lines)
    found = decompose_spectrum(data, band_hz=band_hz, resolution=resolution)
    modes = []
    for peak in found.peaks:
        top = _top(data, found, peak, resolution)
        crest = _crest(data, top, _bell(data, found, peak, top), derivatives)
        modes.append(_mode(data, top, crest, NOTHING, float("nan"), ("no_damping",)))
    return _ascending(modes, band_hz)


def efdd(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
    resolution: float = RESOLUTION,
    lines: tuple[Measured, ...] = (),
    derivatives: int = 2,
) -> tuple[Mode, ...]:
    r"""Modes at the peaks of the first singular value, damping by the decay of their bells.

    Parameters
    ----------
    samples, rate_hz, band_hz, resolution, lines, derivatives
        As for `fdd`.

    Returns
    -------
    Ascending in frequency. Flags: `narrow_bell` (little of the resonance could be seen, because
    of a neighbour or the edge of the band), `no_damping` (its correlation did not decay like a
    mode's; the frequency is that of the peak).

    Examples
    --------
    >>> from slowtime.dynamics.sdof.oscillator import Oscillator
    >>> from slowtime.dynamics.sdof.simulation import ambient_acceleration
    >>> rng = np.random.default_rng(1)
    >>> ringing = ambient_acceleration(Oscillator.from_modal(5.0, 0.01), 20_000, 50.0, rng)
    >>> both = ringing[:, None] * [1.0, -0.5] + 0.1 * rng.standard_normal((20_000, 2))
    >>> mode, = efdd(both, 50.0)
    >>> low, high = mode.damping_ratio.interval()
    >>> low < 0.01 < high
    True
    """
    data = scaled_coefficients(samples, rate_hz, lines)
    found = decompose_spectrum(data, band_hz=band_hz, resolution=resolution)
    modes = []
    for peak in found.peaks:
        top = _top(data, found, peak, resolution)
        use = _bell(data, found, peak, top)
        crest = _crest(data, top, use, derivatives)
        rung = fit_correlation_decay(
            data.frequency_hz[use],
            _projected(data, use, top.shape),
            centre_hz=crest.value,
            rate_hz=rate_hz,
            count=data.count,
            derivatives=derivatives,
        )
        if rung is None:
            modes.append(_mode(data, top, crest, NOTHING, float("nan"), ("no_damping",)))
        else:
            values = rung.frequency_hz, rung.damping_ratio, rung.correlation
            modes.append(_mode(data, top, *values, rung.flags))
    return _ascending(modes, band_hz)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Top:
    """A peak read closely: shape and covariance in the scale of the ordinates."""

    frequency_hz: float
    half_width_hz: float
    shape: Complex[np.ndarray, " channel"]
    moves: Complex[np.ndarray, "bin channel"]
    share: float


def _top(
    data: ScaledCoefficients, found: SpectralDecomposition, peak: int, resolution: float
) -> _Top:
    """Shape at a peak, and by how much each ordinate moved it there; the moves add up to 0."""
    place = float(found.frequency_hz[peak])
    half_width = data.half_width_hz(place, resolution)
    near, w = ordinates_about(data, place, half_width)
    part = data.coefficients[near]
    values, vectors = np.linalg.eigh((part.T * w) @ part.conj())
    shape, others = vectors[:, -1], vectors[:, :-1]
    gaps = np.maximum(values[-1] - values[:-1], 1e-12 * values[-1])
    along, across = part @ shape.conj(), part @ others.conj()
    moves = ((w * along.conj())[:, None] * across / gaps) @ others.T
    return _Top(place, half_width, shape, moves, float(values[-1] / values.sum()))


def _projected(
    data: ScaledCoefficients, use: slice, shape: np.ndarray
) -> Float[np.ndarray, " bin"]:
    return np.asarray(np.abs(data.coefficients[use] @ shape.conj()) ** 2)


def _crest(data: ScaledCoefficients, top: _Top, bell: slice, derivatives: int) -> Measured:
    r"""Where the averaged projection is highest, :math:`\hat g'(f) = 0`, and how sure that is.

    :math:`\delta f = -\delta g' / g''`, where :math:`g'` has the variance
    :math:`\sum_k w_k'^2 I_k^2 / 2`. The likeliest place of a resonance weighs its ordinates by
    a parabola over all of it, so the average here is as wide as the resonance, and not
    narrower than that which found the peak. The projection is that of velocities, which is
    symmetric about the natural frequency.
    """
    density = _projected(data, bell, top.shape)
    equivalent = np.sum(density) ** 2 / np.sum(density**2) / (np.pi * data.duration_s)
    here, edges = top.frequency_hz, data.frequency_hz[bell][[0, -1]]
    room = max(float(np.min(np.abs(edges - here))), top.half_width_hz)
    half_width = float(np.clip(WIDE * equivalent, top.half_width_hz, room))
    velocity = data.coefficients * (data.frequency_hz[:, None] / here) ** (1 - derivatives)
    data = dataclasses.replace(data, coefficients=velocity)
    wide = dataclasses.replace(top, half_width_hz=half_width)
    step = top.half_width_hz / (4 * PLACES)
    places = here + step * np.arange(-4 * PLACES, 4 * PLACES + 1)
    place = float(places[np.argmax([_slopes(data, wide, place)[0] for place in places])])
    for _ in range(8):
        _, slope, curvature, variance = _slopes(data, wide, place)
        if curvature >= 0:
            return Measured(here, half_width)
        place -= float(np.clip(slope / curvature, -step, step))
    return Measured(place, min(float(np.sqrt(variance) / -curvature), half_width))


def _slopes(
    data: ScaledCoefficients, top: _Top, place: float
) -> tuple[float, float, float, float]:
    """Height, slope and curvature of the averaged projection, and the variance of the slope."""
    near, w = ordinates_about(data, place, top.half_width_hz)
    away = (data.frequency_hz[near] - place) / top.half_width_hz
    room = np.maximum(1 - away**2, 0.0)
    first = 6 * away * room**2 / top.half_width_hz
    second = (24 * away**2 * room - 6 * room**2) / top.half_width_hz**2
    density = _projected(data, near, top.shape)
    return (
        float(w @ density),
        float(first @ density),
        float(second @ density),
        float(0.5 * first**2 @ density**2),
    )


def _bell(
    data: ScaledCoefficients, found: SpectralDecomposition, peak: int, top: _Top
) -> slice:
    """Ordinates about a peak whose first vector is its shape, no further than the valleys."""
    alike = mac_matrix(found.vectors.T, top.shape[:, None])[:, 0] >= ALIKE
    left = max((other for other in found.peaks if other < peak), default=None)
    right = min((other for other in found.peaks if other > peak), default=None)
    low = 0 if left is None else found.valley(left, peak)
    high = len(alike) - 1 if right is None else found.valley(peak, right)
    low, high = max(low, peak - REACH * PLACES), min(high, peak + REACH * PLACES)
    first = last = peak
    while first > low and alike[first - 1]:
        first -= 1
    while last < high and alike[last + 1]:
        last += 1
    edges = found.frequency_hz[[first, last]] + np.array([-1, 1]) * 0.5 / data.duration_s
    return slice(*(int(edge) for edge in np.searchsorted(data.frequency_hz, edges)))


def _mode(
    data: ScaledCoefficients,
    top: _Top,
    frequency_hz: Measured,
    damping_ratio: Measured,
    correlation: float,
    flags: tuple[str, ...],
) -> Mode:
    """Shape in the units of all channels, of unit norm, its errors as it is turned."""
    raw = top.shape * data.scale
    norm, largest = np.linalg.norm(raw), int(np.argmax(np.abs(raw)))
    turn = np.conj(raw[largest]) / np.abs(raw[largest]) / norm
    seen, moved = raw * turn, top.moves * data.scale * turn
    moved = moved - np.outer((moved @ seen.conj()).real, seen)
    moved = moved - 1j * np.outer(moved[:, largest].imag / seen[largest].real, seen)
    shape, sd = np.zeros(len(data.moving), dtype=complex), np.zeros(len(data.moving))
    shape[data.moving] = seen
    sd[data.moving] = np.sqrt(np.sum(np.abs(moved) ** 2, axis=0))
    return Mode(
        frequency_hz=frequency_hz,
        damping_ratio=damping_ratio,
        correlation=correlation,
        shape=shape,
        shape_sd=sd,
        quality=top.share,
        flags=flags,
    )


def _ascending(modes: list[Mode], band_hz: tuple[float, float] | None) -> tuple[Mode, ...]:
    inside = [mode for mode in modes if checks.is_inside(mode.frequency_hz.value, band_hz)]
    return tuple(sorted(inside, key=lambda mode: mode.frequency_hz.value))
