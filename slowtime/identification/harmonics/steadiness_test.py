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
"""Steadiness above which no test is needed: Gaussian envelopes exceed it almost always."""

LEAST_SNR = 1.0
"""Least signal-to-noise ratio of a peak [1]."""

DRAWS = 1.5
"""Largest number of draws, times the significance level."""

FEWEST, MOST = 64, 1024
"""Draws at a time, least and most."""

ENOUGH = 10
"""Draws at or below the statistic after which the test stops (Besag and Clifford)."""

NOISE_DOUBT = 1.5
"""Factor by which the noise density may be underestimated, as it is estimated from few bins."""

WIDER = 1.4
"""Step ratio of the search for the narrowest compatible mode."""


def monte_carlo_p_value(
    seen: NarrowBand,
    value: float,
    statistic: Callable[[np.ndarray], np.ndarray],
    half_widths: float,
    level: float,
    rng: np.random.Generator,
) -> float:
    """Sequential Monte Carlo p-value of a statistic of a mode's envelope.

    The half-bandwidth of the mode is in bins; `level` is what the p-value is compared with.
    """
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
    """p-value of the residual share of one tone for the least damped mode."""
    if seen.snr < LEAST_SNR:
        return 1.0
    value = float(residual_share(seen.envelope[None])[0])
    return monte_carlo_p_value(seen, value, residual_share, least, level, rng)


def noise_p_value(seen: NarrowBand, channels: int, searched: int) -> float:
    r"""Probability that noise alone stands so high in one of the bands searched."""
    # The energy of the band over the noise density has a gamma law; its weighting of the
    # channels was chosen to show the peak, which is worth one degree of freedom a channel.
    count = len(seen.envelope)
    energy = (1.0 + seen.snr) * count
    return min(1.0, searched * float(gammaincc(count + channels - 1, energy / NOISE_DOUBT)))


def steadiness_p_value(
    seen: NarrowBand, least: float, level: float, rng: np.random.Generator
) -> float:
    """p-value of the steadiness, over all modes that are as wide as the peak.

    It is an upper limit over the compatible widths.
    """
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
