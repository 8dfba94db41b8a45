r"""Frequency and damping of a free decay against its amplitude.

The amplitude of one mode falls per half cycle n by

.. math:: -\frac{dA}{dn} = a_0 + a_1 A + a_2 A^2 ,

by dry friction (:math:`a_0 = 2 F / k`), viscous damping (:math:`a_1 = \pi \zeta`) and drag with
the square of the velocity (:math:`a_2 = 4 c_2 / 3 m`), so that the damping ratio is

.. math:: \zeta(A) = (a_0 / A + a_1 + a_2 A) / \pi .

References
----------
.. [1] B. F. Feeny and J. W. Liang, "A decrement method for the simultaneous estimation of
   Coulomb and viscous friction", Journal of Sound and Vibration 195 (1996) 149-154.
.. [2] A. H. Nayfeh and D. T. Mook, "Nonlinear Oscillations" (1979), section 3.3: averaging.
"""

import dataclasses
import math

import numpy as np
import scipy.optimize
import scipy.signal
from jaxtyping import Float

NAMES = ("dry friction", "viscous", "quadratic")
"""What makes the amplitude fall by a constant, in proportion, and by its square."""
MIN_EXTREMES = 6
"""[half cycles] Of a decay, at least. Source: three coefficients, a start, and two to spare."""
FLOOR = 4.0
"""[standard deviations of the noise] Amplitude to which a decay is followed. Source: below,
noise makes extremes of its own."""
MANY_REPEATS = 0.1
"""[1] Share of equal neighbours from which samples are steps of a converter or an encoder."""
SAME_SAMPLE = 1e-6
"""[1] Share of the largest step up to which neighbours are equal. Source: rounding of files."""
MAX_UNEVENNESS = 0.25
"""[1] Relative change of a half cycle from one to the next, at which a decay has ended. Source:
judgement; frequencies change by less from one half cycle to the next."""
SUBSTEPS = 4
"""[1] Runge-Kutta steps in a half cycle. Source: error below 1e-6 up to a decrement of half."""
CLEAR = 2.0
"""[1] Difference of the Bayesian information criterion that counts. Source: Kass and Raftery,
Journal of the American Statistical Association 90 (1995) 773-795: positive evidence."""
MAX_DECREMENT = 2.0
"""[1] Of a half cycle, in amplitudes: more is no oscillation."""

Values = Float[np.ndarray, " extreme"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Extremes:
    """Half cycles of a free decay.

    Parameters
    ----------
    times_s
        Of the extremes [s].
    amplitude
        Half the distance to the mean of both neighbours, in the unit of the record.
    noise
        Standard deviation of an amplitude.
    """

    times_s: Values
    amplitude: Values
    noise: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class DecayLaw:
    """Frequency and damping against amplitude.

    Parameters
    ----------
    amplitude
        From the largest to the smallest.
    frequency_hz, frequency_sd_hz
        Of the half cycles about each amplitude.
    damping, damping_sd
        Damping ratio, by the law.
    coefficients, coefficients_sd
        :math:`a_0, a_1, a_2`; 0 for those that are not needed.
    terms
        Names of those that are.
    residual
        Root mean square of what the law leaves of the amplitudes.
    """

    amplitude: Values
    frequency_hz: Values
    frequency_sd_hz: Values
    damping: Values
    damping_sd: Values
    coefficients: tuple[float, float, float]
    coefficients_sd: tuple[float, float, float]
    terms: tuple[str, ...]
    residual: float

    @property
    def trend(self) -> str:
        """What the damping ratio does as the amplitude grows."""
        first, last = float(self.damping[0]), float(self.damping[-1])
        apart = 2 * math.hypot(float(self.damping_sd[0]), float(self.damping_sd[-1]))
        if abs(first - last) <= apart:
            return "does not depend on amplitude"
        return "grows with amplitude" if first > last else "falls with amplitude"


def free_decay_extremes(
    series: Float[np.ndarray, " time"], rate_hz: float, start_s: float = 0.0
) -> Extremes:
    """Find the extremes of a decay from its largest on.

    Parameters
    ----------
    series
        A free decay of one mode, with whatever came before its release.
    rate_hz
        Sampling rate [Hz].
    start_s
        Before which nothing is used [s].

    Raises
    ------
    ValueError
        Where there are too few half cycles.
    """
    moved = np.asarray(series[int(start_s * rate_hz) :], dtype=float)
    middle = float(np.median(moved[len(moved) // 2 :]))
    moved = moved - middle
    # Before its largest value a structure is not yet free.
    begun = int(np.argmax(np.abs(moved)))
    if begun > len(moved) - 2 * MIN_EXTREMES:
        raise ValueError(_too_few(0))
    moved = moved[begun:]
    start_s += begun / rate_hz
    spectrum = np.abs(np.fft.rfft(moved * np.hanning(len(moved))))
    spectrum[:2] = 0.0
    period = len(moved) / max(int(np.argmax(spectrum)), 1)
    window = max(int(period / 6) | 1, 5)
    smooth = scipy.signal.savgol_filter(moved, window, 2) if window < len(moved) else moved
    noise = float(np.std(moved - smooth)) * math.sqrt(1 / max(1 - 9 / (4 * window), 0.3))
    steps = np.abs(np.diff(moved))
    moving = steps > SAME_SAMPLE * steps.max(initial=0.0)
    if moving.any() and not moving.all() and np.mean(~moving) > MANY_REPEATS:
        noise = max(noise, float(steps[moving].min()) / math.sqrt(12))
    apart = max(int(0.3 * period), 1)
    rough: list[tuple[float, float]] = []
    for sign in (1.0, -1.0):
        peaks, _ = scipy.signal.find_peaks(sign * smooth, distance=apart)
        rough += [(float(peak), float(smooth[peak])) for peak in peaks]
    rough = _alternating(sorted(rough))
    if len(rough) < MIN_EXTREMES + 2:
        raise ValueError(_too_few(len(rough)))
    places, values, share = _arcs(moved, np.array([place for place, _ in rough]))
    sd = noise * share
    if len(values) < MIN_EXTREMES + 2:
        raise ValueError(_too_few(len(values)))
    # A quarter, a half and a quarter: the rest position and its drift drop out.
    size = np.abs(values[1:-1] - (values[:-2] + values[2:]) / 2) / 2
    times = places[1:-1] / rate_hz + start_s
    low = np.flatnonzero(size < FLOOR * max(sd, 1e-12 * size.max()))
    count = int(low[0]) if len(low) else len(size)
    spacing = np.diff(times)
    uneven = np.flatnonzero(np.abs(spacing[1:] / spacing[:-1] - 1) > MAX_UNEVENNESS)
    count = min(count, int(uneven[0]) + 2 if len(uneven) else count)
    # Friction that takes more than is left of an amplitude holds it: that is no half cycle.
    held = np.flatnonzero(size[1:] < size[:-1] - size[1:])
    count = min(count, int(held[0]) + 1 if len(held) else count)
    if count < MIN_EXTREMES:
        raise ValueError(_too_few(count))
    return Extremes(times[:count], size[:count], sd * math.sqrt(3 / 8))


def _too_few(count: int) -> str:
    return (
        f"There are {count} half cycles above the noise, fewer than {MIN_EXTREMES}: too few "
        "for a law of damping. Give a longer decay, or a stronger one."
    )


def _arcs(moved: Float[np.ndarray, " time"], rough: Values) -> tuple[Values, Values, float]:
    """Extremes of arcs of half a period, fitted to the samples about rough extremes.

    Returns
    -------
    Place [samples] and value of each, and the standard deviation of a value over that of a
    sample.
    """
    half = np.gradient(rough)
    places, values, share = rough.copy(), np.zeros(len(rough)), 1.0
    for i, (place, length) in enumerate(zip(rough.tolist(), half.tolist(), strict=True)):
        first = max(math.ceil(place - length / 2), 0)
        at = np.arange(first, min(int(place + length / 2) + 1, len(moved)))
        turn = np.pi * (at - place) / length
        columns = np.stack([np.ones(len(at)), np.cos(turn), np.sin(turn)], axis=1)
        if len(at) < columns.shape[1] + 1:
            values[i] = moved[round(place)]
            continue
        inverse = np.linalg.pinv(columns)
        level, cosine, sine = (inverse @ moved[at]).tolist()
        # On the side of its rough extreme: an arc that is turned over is none.
        angle = math.atan2(sine, cosine)
        angle -= math.pi * round(angle / math.pi)
        places[i] = place + angle * length / math.pi
        values[i] = level + math.cos(angle) * cosine + math.sin(angle) * sine
        if i == len(rough) // 2:
            share = float(np.linalg.norm(np.array([1.0, 1.0, 0.0]) @ inverse))
    return places, values, share


def _alternating(found: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Keep the largest of neighbours on one side."""
    kept: list[tuple[float, float]] = []
    for one in found:
        if kept and (one[1] > 0) == (kept[-1][1] > 0):
            if abs(one[1]) > abs(kept[-1][1]):
                kept[-1] = one
        else:
            kept.append(one)
    return kept


def decay_law(extremes: Extremes) -> DecayLaw:
    """Fit the law of the amplitude, with as few terms as the record asks for.

    Parameters
    ----------
    extremes
        Of a decay.

    Returns
    -------
    The law of the least Bayesian information criterion among all sets of terms.
    """
    size = extremes.amplitude
    count = len(size)
    # Viscous damping comes first, and what needs fewer terms: others must be better.
    sets = [(1,), (0,), (2,), (0, 1), (1, 2), (0, 2), (0, 1, 2)]
    fits = [_fit(size, terms) for terms in sets]
    independent = _independent(fits[-1].fun)
    best, least = 0, math.inf
    for number, (terms, fit) in enumerate(zip(sets, fits, strict=True)):
        square = max(2 * fit.cost / count, extremes.noise**2, np.finfo(float).tiny)
        criterion = independent * math.log(square)
        criterion += (1 + len(terms)) * math.log(count)
        if criterion < least - CLEAR:
            best, least = number, criterion
    terms, found = sets[best], fits[best]
    spare = max(count - 1 - len(terms), 1)
    square = max(2 * found.cost / spare, extremes.noise**2)
    square *= count / _independent(found.fun)
    covariance = square * np.linalg.pinv(found.jac.T @ found.jac)
    values, errors = np.zeros(3), np.zeros(3)
    values[list(terms)] = found.x[1:]
    errors[list(terms)] = np.sqrt(np.diag(covariance)[1:])
    shape = np.stack([1 / size, np.ones(count), size], axis=1)
    spread = shape[:, list(terms)] @ covariance[1:, 1:]
    sd = np.sqrt(np.maximum(np.sum(spread * shape[:, list(terms)], axis=1), 0.0)) / np.pi
    frequency, frequency_sd = _frequencies(extremes.times_s)
    return DecayLaw(
        amplitude=size,
        frequency_hz=frequency,
        frequency_sd_hz=frequency_sd,
        damping=shape @ values / np.pi,
        damping_sd=sd,
        coefficients=(float(values[0]), float(values[1]), float(values[2])),
        coefficients_sd=(float(errors[0]), float(errors[1]), float(errors[2])),
        terms=tuple(NAMES[i] for i in terms),
        residual=float(np.sqrt(2 * found.cost / count)),
    )


def _independent(left: Values) -> float:
    """Return the number of amplitudes that correlated residuals count for."""
    power = float(left @ left)
    near = float(left[1:] @ left[:-1]) / power if power > 0 else 0.0
    near = min(max(near, 0.0), 0.9)
    return len(left) * (1 - near) / (1 + near)


def _fit(size: Values, terms: tuple[int, ...]) -> scipy.optimize.OptimizeResult:
    """Fit start and coefficients, all non-negative, to the amplitudes."""
    scale = np.array([size[0], *(size[0] ** (1 - i) for i in terms)])
    start = np.array([1.0, *(0.1 / len(terms) for _ in terms)])

    def residual(parameters: Float[np.ndarray, " parameter"]) -> Values:
        given = parameters * scale
        coefficients = np.zeros(3)
        coefficients[list(terms)] = given[1:]
        return np.asarray(_followed(given[0], coefficients, len(size)) - size)

    found = scipy.optimize.least_squares(
        residual, start, bounds=(0.0, [np.inf] + [MAX_DECREMENT] * len(terms))
    )
    found.x = found.x * scale
    found.jac = np.asarray(found.jac) / scale
    return found


def _followed(first: float, coefficients: Float[np.ndarray, "3"], count: int) -> Values:
    """Amplitudes at each half cycle, by Runge-Kutta steps; never below zero."""
    friction, viscous, drag = coefficients.tolist()

    def fall(size: float) -> float:
        return -(friction + viscous * size + drag * size * size) if size > 0 else 0.0

    step, size, found = 1 / SUBSTEPS, first, [first]
    for _ in range(count - 1):
        for _ in range(SUBSTEPS):
            one = fall(size)
            two = fall(size + step / 2 * one)
            three = fall(size + step / 2 * two)
            four = fall(size + step * three)
            size = max(size + step / 6 * (one + 2 * two + 2 * three + four), 0.0)
        found.append(size)
    return np.array(found)


def _frequencies(times: Values) -> tuple[Values, Values]:
    """Frequency about each extreme, and its standard deviation by the scatter of the times."""
    count = len(times)
    reach = min(max(count // 6, 2), 6)
    frequency, sd = np.zeros(count), np.zeros(count)
    whole = np.polyfit(np.arange(count), times, min(3, count - 2))
    scatter = float(np.std(times - np.polyval(whole, np.arange(count)))) or 0.0
    for i in range(count):
        first = min(max(i - reach, 0), max(count - 2 * reach - 1, 0))
        numbers = np.arange(first, min(first + 2 * reach + 1, count))
        slope = float(np.polyfit(numbers, times[numbers], 1)[0])
        frequency[i] = 1 / (2 * slope)
        spread = math.sqrt(float(np.sum((numbers - numbers.mean()) ** 2)))
        sd[i] = frequency[i] * scatter / spread / slope
    return frequency, sd
