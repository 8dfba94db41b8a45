"""Monte Carlo p-values of narrow-band statistics under the hypothesis of a mode.

All probabilities come from drawn modes with the noise, band and length of the record; they are
exact for the number of draws, which stops growing once the answer is clear [1]_.

References
----------
.. [1] J. Besag, P. Clifford, "Sequential Monte Carlo p-values", Biometrika 78 (1991).
"""

from collections.abc import Callable

import numpy as np
from scipy.special import gammaincc

from .narrowband import NarrowBand, draw_envelopes, residual_share, steadiness

UNSTEADY = 1.7
"""Gaussian envelopes are rarely steadier than this, so that nothing is gained by drawing."""

LEAST_SNR = 1.0
"""What does not stand above the noise in its band is no peak to be judged."""

DRAWS = 1.5
"""Most that are drawn, times the probability that is to be told from zero."""

FEWEST, MOST = 64, 1024
ENOUGH = 10
"""Modes drawn at a time, and how many as steady as the peak settle the matter."""

NOISE_DOUBT = 1.5
"""The noise density is told from few bins, and may be so much higher."""

WIDER = 1.4
"""Step of the search for the narrowest mode that the peak may be."""


def monte_carlo_p_value(
    seen: NarrowBand,
    value: float,
    statistic: Callable[[np.ndarray], np.ndarray],
    half_widths: float,
    level: float,
    rng: np.random.Generator,
) -> float:
    """Probability that a drawn mode has a statistic as small; exact sequential Monte Carlo."""
    drawn = below = 0
    while drawn < DRAWS / level:
        chunk = max(FEWEST, min(drawn, MOST))
        drawn += chunk
        draw = draw_envelopes(half_widths, seen.snr, len(seen.envelope), chunk, rng)
        below += int(np.count_nonzero(statistic(draw) <= value))
        if below >= ENOUGH:
            break
    return (below + 1.0) / (drawn + 1.0)


def tone_p_value(
    seen: NarrowBand, least: float, level: float, rng: np.random.Generator
) -> float:
    """Rarity of so little beside one tone among the least damped modes."""
    if seen.snr < LEAST_SNR:
        return 1.0
    value = float(residual_share(seen.envelope[None])[0])
    return monte_carlo_p_value(seen, value, residual_share, least, level, rng)


def noise_p_value(seen: NarrowBand, channels: int, searched: int) -> float:
    r"""Probability that noise alone stands so high in one of the bands searched.

    The energy of the band over the noise density has a gamma law; its weighting of the channels
    was chosen to show the peak, which is worth one degree of freedom a channel.
    """
    count = len(seen.envelope)
    energy = (1.0 + seen.snr) * count
    return min(1.0, searched * float(gammaincc(count + channels - 1, energy / NOISE_DOUBT)))


def steadiness_p_value(
    seen: NarrowBand, least: float, level: float, rng: np.random.Generator
) -> float:
    """Rarity of such steadiness among the modes that are as wide as what is seen."""
    value = float(steadiness(seen.envelope[None])[0])
    if value > UNSTEADY or seen.snr < LEAST_SNR:
        return 1.0
    width, doubt = _narrowest(seen, least, level / 10.0, rng), level / 10.0
    return monte_carlo_p_value(seen, value, steadiness, width, level, rng) + doubt


def _narrowest(seen: NarrowBand, least: float, doubt: float, rng: np.random.Generator) -> float:
    """Least half-bandwidth [bins] of a mode that leaves a tone so little of its power."""
    value, width = float(residual_share(seen.envelope[None])[0]), least
    while width < len(seen.envelope) / 4:
        left = residual_share(
            draw_envelopes(width, seen.snr, len(seen.envelope), 4 * FEWEST, rng)
        )
        # Beyond what was drawn the upper tail of the share falls off faster than this line.
        mean, spread = float(np.mean(left)), float(np.std(left))
        reach = np.sqrt(-2.0 * np.log(doubt))
        if value <= max(float(left.max()), mean + reach * spread):
            break
        width *= WIDER
    return width
