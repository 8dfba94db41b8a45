r"""Law of the damping and of the stiffness of a mode along a free decay.

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
from typing import Literal

import numpy as np
import scipy.optimize
from jaxtyping import Float

from .envelope import Envelope, local_slopes
from .two_modes import PARAMETERS, misfit_of_two_modes

NAMES = ("dry friction", "viscous", "quadratic")
"""What makes the amplitude fall by a constant, in proportion, and by its square."""
SUBSTEPS = 4
"""[1] Runge-Kutta steps in a half cycle. Source: error below 1e-6 up to a decrement of half."""
MOST_SUBSTEPS = 8
"""[1] The same between two points, over which an amplitude falls by an eighth at most."""
CLEAR = 2.0
"""[1] Difference of the Bayesian information criterion that counts. Source: Kass and Raftery,
Journal of the American Statistical Association 90 (1995) 773-795: positive evidence."""
DECISIVE = 3.0
"""[standard deviations] From which the frequency depends on amplitude. Source: once in 370
decays of linear structures."""
SAME_DAMPING = 0.05
"""[1] Relative difference of damping up to which a viscous law is enough. Source: judgement;
a stiffness that hardens by a tenth changes the damping of a viscous damper by 3 %."""
LEAST_FALL = 0.2
"""[1] Of the logarithm of the amplitude along a decay: damping of less is taken for as much
where a difference is judged. Source: judgement; a law cannot be seen in a fall of a fifth."""
SAME_FREQUENCY = 0.1
"""[half-bandwidths] Change of the frequency along a decay up to which it is one. Source:
judgement; damping by a resonance curve changes by less than a hundredth."""
STRONG = 0.1
"""[1] Amplitude over the largest from which that is looked at: below, a trace of friction is
all of the damping."""
MISFIT = 4.0
"""[1] Mean square of what a law leaves of the damping, over its variance, beyond which the law
does not hold. Source: two standard deviations everywhere."""
MAX_DECREMENT = 2.0
"""[1] Of a half cycle, in amplitudes: more is no oscillation."""

Values = Float[np.ndarray, " point"]
Stiffness = Literal["constant", "hardening", "softening"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class DecayLaw:
    """Frequency and damping against amplitude.

    Parameters
    ----------
    amplitude
        From the largest to the smallest, in the unit of `channel` [amplitude].
    frequency_hz, frequency_sd_hz
        Of the half cycles about each amplitude, and its standard deviation [Hz].
    damping, damping_sd
        Damping ratio there, and its standard deviation [1].
    coefficients, coefficients_sd
        :math:`a_0, a_1, a_2`; 0 for those that are not needed.
    terms
        Names of those that are.
    residual
        Root mean square of what the law leaves of the amplitudes.
    adequate
        Whether the law leaves no more than chance; else `damping` is corrected by what it
        leaves about each amplitude.
    stiffness
        Whether the frequency rises or falls with amplitude.
    beats
        Whether another mode is so near that its beat imitates a change of damping.
    channel
        Number of the channel that amplitudes are of.
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
    adequate: bool = True
    stiffness: Stiffness = "constant"
    beats: bool = False
    channel: int = 0

    @property
    def one_number(self) -> bool:
        """Whether one frequency and one damping ratio hold along the whole decay."""
        viscous = self.terms == (NAMES[1],) and self.adequate
        return viscous and self.stiffness == "constant" and not self.beats

    @property
    def trend(self) -> str:
        """What the damping ratio does as the amplitude grows."""
        first, last = float(self.damping[0]), float(self.damping[-1])
        apart = 2 * math.hypot(float(self.damping_sd[0]), float(self.damping_sd[-1]))
        if abs(first - last) <= apart:
            return "does not depend on amplitude"
        return "grows with amplitude" if first > last else "falls with amplitude"

    @property
    def sentence(self) -> str:
        """What the decay tells: one number, both ends of the table, or why it is undecided."""
        first, last = float(self.amplitude[0]), float(self.amplitude[-1])
        zeta, hz = 100 * self.damping, self.frequency_hz
        if self.beats:
            return (
                "another mode is so near that their beat imitates a change of damping: whether "
                "it depends on amplitude is undecided. Give a longer record, or channels that "
                "tell the modes apart."
            )
        if self.one_number:
            return (
                f"the damping ratio is {zeta[0]:.4g} ± {100 * self.damping_sd[0]:.2g} % along "
                f"the whole decay, from amplitude {first:.3g} to {last:.3g}."
            )
        stiffness = "" if self.stiffness == "constant" else f" and {self.stiffness} stiffness"
        return (
            f"the damping ratio {self.trend} ({zeta[0]:.3g} % at {first:.3g}, {zeta[-1]:.3g} % "
            f"at {last:.3g}), by {' and '.join(self.terms)} damping{stiffness}; frequency "
            f"{hz[0]:.5g} to {hz[-1]:.5g} Hz."
        )


def decay_law(envelope: Envelope) -> DecayLaw:
    """Fit the law of the amplitude, with as few terms as the record asks for.

    It has the least Bayesian information criterion among all sets of terms.
    """
    size, count = envelope.amplitude, len(envelope.amplitude)
    # Viscous damping comes first, and what needs fewer terms: others must be better.
    sets = [(1,), (0,), (2,), (0, 1), (1, 2), (0, 2), (0, 1, 2)]
    fits = [_fit(envelope, terms) for terms in sets]
    independent = min(_independent(fits[-1].fun), count / envelope.overlap)
    best, least = 0, math.inf
    for number, (terms, fit) in enumerate(zip(sets, fits, strict=True)):
        criterion = independent * math.log(max(2 * fit.cost / count, 1.0))
        criterion += (1 + len(terms)) * math.log(independent)
        if criterion < least - CLEAR:
            best, least = number, criterion
    best = 0 if _alike(fits[best], sets[best], fits[0], size) else best
    terms, found = sets[best], fits[best]
    square = max(2 * found.cost / max(count - 1 - len(terms), 1), 1.0)
    square *= count / min(_independent(found.fun), count / envelope.overlap)
    covariance = square * np.linalg.pinv(found.jac.T @ found.jac)
    values, errors = np.zeros(3), np.zeros(3)
    values[list(terms)] = found.x[1:]
    errors[list(terms)] = np.sqrt(np.diag(covariance)[1:])
    shape = np.stack([1 / size, np.ones(count), size], axis=1)
    spread = shape[:, list(terms)] @ covariance[1:, 1:]
    sd = np.sqrt(np.maximum(np.sum(spread * shape[:, list(terms)], axis=1), 0.0))
    fall, sd, adequate = _corrected(envelope, found.fun, shape @ values, sd)
    # Of the logarithm of the amplitude in half a damped cycle.
    damping = fall / np.hypot(np.pi, fall)
    sd = sd * np.pi**2 / np.hypot(np.pi, fall) ** 3
    law = DecayLaw(
        amplitude=size,
        frequency_hz=envelope.frequency_hz,
        frequency_sd_hz=envelope.frequency_sd_hz,
        damping=damping,
        damping_sd=sd,
        coefficients=(float(values[0]), float(values[1]), float(values[2])),
        coefficients_sd=(float(errors[0]), float(errors[1]), float(errors[2])),
        terms=tuple(NAMES[i] for i in terms),
        residual=float(np.sqrt(np.mean((found.fun * envelope.amplitude_sd) ** 2))),
        adequate=adequate,
        stiffness=_stiffness(envelope),
        beats=envelope.beats,
        channel=envelope.channel,
    )
    if law.one_number or law.beats or not _beats(envelope, found, terms):
        return law
    return dataclasses.replace(law, beats=True)


def _corrected(
    envelope: Envelope, left: Values, fall: Values, sd: Values
) -> tuple[Values, Values, bool]:
    """Add to the fall of the logarithm in half a cycle what the law leaves, beyond chance."""
    relative = envelope.amplitude_sd / envelope.amplitude
    # `left` is the law less the amplitude, over its error.
    slope, error = local_slopes(envelope.half_cycles, left * relative, relative)
    strong = envelope.amplitude > STRONG * envelope.amplitude[0]
    misfit = float(np.mean((slope[strong] / error[strong]) ** 2))
    told = np.maximum(fall[strong], LEAST_FALL / float(envelope.half_cycles[-1]))
    material = float(np.abs(slope[strong] / told).max()) > SAME_DAMPING
    if misfit < MISFIT or not material:
        return (
            fall,
            np.hypot(sd, np.sqrt(np.mean(slope[strong] ** 2)) * (misfit > MISFIT)),
            True,
        )
    return np.maximum(fall + slope, 0.0), np.hypot(sd, error), False


def _beats(
    envelope: Envelope, found: scipy.optimize.OptimizeResult, terms: tuple[int, ...]
) -> bool:
    """Whether two viscous modes explain amplitude and phase better than the law does."""
    count = len(envelope.amplitude)
    of_law = 2 * found.cost + min(_frequency_move(envelope, power)[1] for power in (1, 2))
    independent = 2 * count / envelope.overlap
    criteria = [
        independent * math.log(max(misfit / (2 * count), 1.0)) + number * math.log(independent)
        # A start, a phase, and three parameters of the phase beside the terms.
        for misfit, number in (
            (of_law, 4 + len(terms)),
            (misfit_of_two_modes(envelope), PARAMETERS),
        )
        if math.isfinite(misfit)
    ]
    return len(criteria) == 2 and criteria[1] < criteria[0] - CLEAR


def _alike(
    fit: scipy.optimize.OptimizeResult,
    terms: tuple[int, ...],
    viscous: scipy.optimize.OptimizeResult,
    size: Values,
) -> bool:
    """Whether a law tells the same damping as a viscous one, to `SAME_DAMPING`."""
    shape = np.stack([1 / size, np.ones(len(size)), size], axis=1)
    fall = shape[:, list(terms)] @ fit.x[1:]
    strong = size > STRONG * size[0]
    return bool(np.abs(fall[strong] / viscous.x[1] - 1).max() < SAME_DAMPING)


def _stiffness(envelope: Envelope) -> Stiffness:
    """Tell by the phase whether the frequency goes with the amplitude, or with its square."""
    moves = [_frequency_move(envelope, power) for power in (1, 2)]
    score, _ = min(moves, key=lambda move: move[1])
    if abs(score) <= DECISIVE:
        return "constant"
    return "hardening" if score > 0 else "softening"


def _frequency_move(envelope: Envelope, power: int) -> tuple[float, float]:
    """Change of the frequency with a power of the amplitude, over its error; misfit."""
    times, size = envelope.times_s - envelope.times_s[0], envelope.amplitude
    steps = np.diff(times) * (size[1:] ** power + size[:-1] ** power) / 2
    bent = np.concatenate([[0.0], np.cumsum(steps)]) / size[0] ** power
    weight = size / envelope.amplitude_sd
    basis = np.column_stack([np.ones(len(times)), times, bent]) * weight[:, None]
    target = np.pi * envelope.half_cycles * weight
    found = np.linalg.lstsq(basis, target, rcond=None)[0]
    left = target - basis @ found
    independent = min(_independent(left), len(left) / envelope.overlap)
    square = max(float(left @ left) / max(len(left) - 3, 1), 1.0) * len(left) / independent
    sd = math.sqrt(square * float(np.linalg.pinv(basis.T @ basis)[2, 2]))
    decay_rate = math.log(size[0] / float(size.min())) / float(times[-1])
    moved = abs(float(found[2])) * (1 - (float(size.min()) / size[0]) ** power)
    material = moved > SAME_FREQUENCY * decay_rate
    return float(found[2]) / sd if material else 0.0, float(left @ left)


def _independent(left: Values) -> float:
    """Return the number of values that correlated residuals count for."""
    power = float(left @ left)
    near = float(left[1:] @ left[:-1]) / power if power > 0 else 0.0
    near = min(max(near, 0.0), 0.9)
    return len(left) * (1 - near) / (1 + near)


def _fit(envelope: Envelope, terms: tuple[int, ...]) -> scipy.optimize.OptimizeResult:
    """Fit start and coefficients, all non-negative, to the amplitudes over their errors."""
    size, places = envelope.amplitude, envelope.half_cycles
    usual = max(float(np.log(size[0] / size.min())), 1e-6) / float(places[-1])
    scale = np.array([size[0], *(usual * size[0] ** (1 - i) for i in terms)])
    start = np.array([1.0, *(1 / len(terms) for _ in terms)])

    def residual(parameters: Float[np.ndarray, " parameter"]) -> Values:
        given = parameters * scale
        coefficients = np.zeros(3)
        coefficients[list(terms)] = given[1:]
        followed = _followed(given[0], coefficients, places)
        return np.asarray((followed - size) / envelope.amplitude_sd)

    most = MAX_DECREMENT / min(usual, MAX_DECREMENT / 2)
    found = scipy.optimize.least_squares(
        residual, start, bounds=(0.0, [np.inf] + [most] * len(terms))
    )
    found.x = found.x * scale
    found.jac = np.asarray(found.jac) / scale
    return found


def _followed(first: float, coefficients: Float[np.ndarray, "3"], places: Values) -> Values:
    """Amplitudes at counts of half cycles, by Runge-Kutta steps; never below zero."""
    friction, viscous, drag = coefficients.tolist()

    def fall(size: float) -> float:
        return -(friction + viscous * size + drag * size * size) if size > 0 else 0.0

    size, found = first, [first]
    for advance in np.diff(places).tolist():
        steps = min(max(math.ceil(advance * SUBSTEPS), 1), MOST_SUBSTEPS)
        step = advance / steps
        for _ in range(steps):
            one = fall(size)
            two = fall(size + step / 2 * one)
            three = fall(size + step / 2 * two)
            four = fall(size + step * three)
            size = max(size + step / 6 * (one + 2 * two + 2 * three + four), 0.0)
        found.append(size)
    return np.array(found)
