r"""Best linear approximation of a nonlinear structure, its noise and its distortion.

Under random-phase multisines the response of a nonlinear structure is

.. math:: Y(k) = G(k) U(k) + Y_S(k) + N(k) ,

with the best linear approximation :math:`G`, stochastic nonlinear distortion :math:`Y_S`, which
repeats with the period but not with the phases, and noise :math:`N`, which does neither. Of M
realisations of P periods, the scatter over periods is of the noise, and that over realisations
of both (robust method):

.. math:: \hat\sigma_n^2 = \frac{1}{M^2} \sum_m \hat\sigma_m^2, \qquad
    \hat\sigma^2 = \frac{1}{M (M - 1)} \sum_m |\hat G_m - \hat G|^2, \qquad
    \hat\sigma_S^2 = M (\hat\sigma^2 - \hat\sigma_n^2) .

What is read at lines that the input leaves out tells the symmetry: an odd input through an odd
nonlinearity has odd lines only, an even nonlinearity makes even ones.

References
----------
.. [1] R. Pintelon and J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd
   ed. (2012), sections 4.3.1 (robust method) and 4.3.2 (fast method).
.. [2] J. Schoukens, M. Vaes and R. Pintelon, "Linear system identification in a nonlinear
   setting", IEEE Control Systems Magazine 36 (2016) 38-69.
"""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.special import fdtrc

from .periods import Realisation

EXCITED_SHARE = 0.01
"""[power of the strong lines] Above which a line counts as excited. Source: generators leave
60 dB between these and others; amplifiers and structures that act back 20 dB at least."""
STRONG_QUANTILE = 0.9
"""[1] Of the power of all lines up to the last excited one that counts as strong. Source:
judgement."""
LEAKED_SHARE = 0.02
"""[1] Share of even lines among the excited up to which they are leakage of an odd multisine.
Source: judgement."""
SAME_LEVEL = 0.05
"""[1] Relative difference of levels that count as one. Source: judgement; multisines of one
amplitude spectrum have equal root mean squares."""
FALSE_ALARM = 1e-3
"""[1] p-value below which distortion is reported. Source: a decision of the interface."""
MIN_DETECTION_LINES = 4
"""[lines] From which the power at lines that were left out is judged. Source: judgement."""

Real = Float[np.ndarray, " line"]
Mask = Bool[np.ndarray, " line"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DetectionLines:
    """Output power at lines that the input leaves out.

    Parameters
    ----------
    amplitude
        Root mean square amplitude of a line, in the unit of the output.
    noise
        The same of the noise; nan where only one period was measured.
    lines
        How many there are.
    p_value
        Of an F test against the noise; nan where the noise is not known.
    """

    amplitude: float
    noise: float
    lines: int
    p_value: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Distortion:
    """Result at one level.

    Parameters
    ----------
    level
        Root mean square of the input.
    realisations, periods
        How many were averaged.
    frequency_hz, response
        Excited lines, and the best linear approximation at them.
    noise_sd
        Standard deviation of the response by noise; nan for a single period.
    total_sd
        By noise and distortion; nan for a single realisation.
    nonlinear_sd
        Of the distortion of one realisation; nan where either of the others is.
    p_value
        Of distortion at the excited lines against noise; nan where not known.
    odd, even
        Lines that the input leaves out; None where there are too few.
    symmetry
        Of the nonlinearity that was detected.
    """

    level: float
    realisations: int
    periods: int
    frequency_hz: Real
    response: Complex[np.ndarray, " line"]
    noise_sd: Real
    total_sd: Real
    nonlinear_sd: Real
    p_value: float
    odd: DetectionLines | None
    even: DetectionLines | None
    symmetry: Literal["none", "odd", "even", "odd and even", "unknown"]


def sort_by_level(given: Sequence[Realisation]) -> list[list[Realisation]]:
    """Group realisations of equal level, the weakest first."""
    groups: list[list[Realisation]] = []
    for one in sorted(given, key=lambda r: r.level):
        if groups and one.level <= (1 + SAME_LEVEL) * groups[-1][0].level:
            groups[-1].append(one)
        else:
            groups.append([one])
    return groups


def distortion_of(
    given: Sequence[Realisation], band_hz: tuple[float, float] | None = None
) -> Distortion:
    """Analyse realisations of one level.

    Parameters
    ----------
    given
        Realisations of one period.
    band_hz
        Lines to use; all that are excited where not given.

    Raises
    ------
    ValueError
        Where periods differ, or nothing is excited.
    """
    if len({len(one.frequency_hz) for one in given}) != 1:
        raise ValueError(
            "The realisations have periods of different lengths. Give records of one period, "
            "or say with `period` how long it is."
        )
    excited, top = _excited(given, band_hz)
    means = [(one.input.mean(axis=0), one.output.mean(axis=0)) for one in given]
    responses = np.stack([y[excited] / u[excited] for u, y in means])
    noise = np.stack([_noise_variance(one, excited) for one in given])
    count = len(given)
    response = responses.mean(axis=0)
    noise_variance = noise.sum(axis=0) / count**2
    total = np.full(len(response), np.nan)
    if count > 1:
        total = np.sum(np.abs(responses - response) ** 2, axis=0) / (count * (count - 1))
    nonlinear = np.maximum(count * (total - noise_variance), 0.0)
    odd, even = (_detection(given, excited, top, response, parity) for parity in (1, 0))
    frequency = given[0].frequency_hz[excited]
    p_value = _distortion_p_value(total, noise_variance, count, [one.periods for one in given])
    return Distortion(
        level=float(np.mean([one.level for one in given])),
        realisations=count,
        periods=min(one.periods for one in given),
        frequency_hz=frequency,
        response=response,
        noise_sd=np.sqrt(noise_variance),
        total_sd=np.sqrt(total),
        nonlinear_sd=np.sqrt(nonlinear),
        p_value=p_value,
        odd=odd,
        even=even,
        symmetry=_symmetry(odd, even, p_value, response, total, given, excited),
    )


def _excited(
    given: Sequence[Realisation], band_hz: tuple[float, float] | None
) -> tuple[Mask, int]:
    """Mask of the excited lines, and the number of the last."""
    power = np.mean([np.abs(one.input.mean(axis=0)) ** 2 for one in given], axis=0)
    power[0] = 0.0
    strong = power > EXCITED_SHARE * power.max(initial=0.0)
    if strong.any():
        last = int(np.flatnonzero(strong)[-1])
        size = np.quantile(power[power > 1e-3 * power.max()], STRONG_QUANTILE)
        strong = power > EXCITED_SHARE * size
        strong[last + 1 :] = False
    evenly = strong & (np.arange(len(strong)) % 2 == 0)
    if evenly.sum() < LEAKED_SHARE * strong.sum():
        strong &= ~evenly
    if band_hz is not None:
        frequency = given[0].frequency_hz
        strong &= (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    if not strong.any():
        raise ValueError("No line is excited. Is --input the channel of the excitation?")
    return strong, int(np.flatnonzero(strong)[-1])


def _noise_variance(one: Realisation, excited: Mask) -> Float[np.ndarray, " excited"]:
    """Variance of the response of one realisation by noise of input and output."""
    u, y = one.input[:, excited], one.output[:, excited]
    if one.periods < 2:
        return np.full(u.shape[1], np.nan)
    # Errors of input and output together: of y - G u, whatever their correlation.
    response = y.mean(axis=0) / u.mean(axis=0)
    left = y - response * u
    variance = np.sum(np.abs(left - left.mean(axis=0)) ** 2, axis=0) / (one.periods - 1)
    return np.asarray(variance / one.periods / np.abs(u.mean(axis=0)) ** 2)


def _distortion_p_value(total: Real, noise: Real, count: int, periods: Sequence[int]) -> float:
    """F test of the scatter over realisations against that over periods."""
    if not (np.isfinite(total).all() and np.isfinite(noise).all()) or not noise.any():
        return float("nan")
    lines = len(total)
    ratio = float(np.mean(total / np.maximum(noise, np.finfo(float).tiny)))
    within = sum(number - 1 for number in periods)
    return float(fdtrc(2 * lines * (count - 1), 2 * lines * max(within, 1), ratio))


def _detection(
    given: Sequence[Realisation],
    excited: Mask,
    top: int,
    response: Complex[np.ndarray, " excited"],
    parity: int,
) -> DetectionLines | None:
    """Power of the output at lines of one parity that the input leaves out."""
    lines = np.arange(len(excited))
    first = int(np.flatnonzero(excited)[0])
    chosen = ~excited & (lines % 2 == parity) & (lines > max(first - 1, 0)) & (lines <= top)
    if chosen.sum() < MIN_DETECTION_LINES:
        return None
    # What the input holds there, by errors of the drive, is no distortion of the structure.
    at = np.flatnonzero(excited)
    linear = np.interp(lines[chosen], at, response.real) + 1j * np.interp(
        lines[chosen], at, response.imag
    )
    power, noise = [], []
    for one in given:
        left = one.output[:, chosen] - linear * one.input[:, chosen]
        power.append(np.abs(left.mean(axis=0)) ** 2)
        if one.periods > 1:
            spread = np.sum(np.abs(left - left.mean(axis=0)) ** 2, axis=0)
            noise.append(spread / (one.periods - 1) / one.periods)
    seen = np.mean(power, axis=0)
    p_value, floor = float("nan"), float("nan")
    if len(noise) == len(given):
        known = np.mean(noise, axis=0)
        floor = float(np.sqrt(known.mean()))
        within = sum(one.periods - 1 for one in given)
        ratio = float(np.mean(seen / np.maximum(known, np.finfo(float).tiny)))
        number = int(chosen.sum())
        p_value = float(fdtrc(2 * number * len(given), 2 * number * within, ratio))
    return DetectionLines(
        amplitude=2 * float(np.sqrt(seen.mean())),
        noise=2 * floor,
        lines=int(chosen.sum()),
        p_value=p_value,
    )


def _symmetry(
    odd: DetectionLines | None,
    even: DetectionLines | None,
    p_value: float,
    response: Complex[np.ndarray, " excited"],
    total: Float[np.ndarray, " excited"],
    given: Sequence[Realisation],
    excited: Mask,
) -> Literal["none", "odd", "even", "odd and even", "unknown"]:
    """Say what kind of nonlinearity was detected, and none where nothing is known."""
    if even is None:
        return "none" if p_value >= FALSE_ALARM else "unknown"
    is_odd_input = not excited[np.arange(len(excited)) % 2 == 0].any()
    evenly = even.p_value < FALSE_ALARM
    if not is_odd_input:
        return "none" if p_value >= FALSE_ALARM and not evenly else "unknown"
    if odd is not None and np.isfinite(odd.p_value):
        oddly = odd.p_value < FALSE_ALARM
    elif np.isfinite(p_value):
        oddly = p_value < FALSE_ALARM
    elif np.isfinite(total).all():
        # Of single periods, noise at excited lines is at most what is read at even ones.
        power = np.mean([np.abs(one.input.mean(axis=0)) ** 2 for one in given], axis=0)
        scatter = len(given) * float(np.mean(total * power[excited]))
        ratio = scatter / max((even.amplitude / 2) ** 2, np.finfo(float).tiny)
        lines, count = len(response), len(given)
        tail = fdtrc(2 * lines * (count - 1), 2 * even.lines * count, ratio)
        oddly = bool(tail < FALSE_ALARM)
    else:
        return "unknown"
    if oddly and evenly:
        return "odd and even"
    return "odd" if oddly else "even" if evenly else "none"
