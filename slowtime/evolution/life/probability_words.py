"""Probabilities in words, none smaller than what a forecast can know."""

import math

LEAST = 1e-4
"""Probability below which forecasts are not told apart [1]: that the law, the sensor or the
model is another one than those that were weighed is more probable than that. Source: of 2,000
sampled futures none resolves it, and docs/remaining_life.md tests no smaller one."""


def probability_in_words(probability: float) -> str:
    """Write a probability in percent, between the least that can be known and its complement.

    Parameters
    ----------
    probability
        From 0 to 1.

    Returns
    -------
    Words that follow "with probability".

    Examples
    --------
    >>> probability_in_words(0.8312), probability_in_words(0.0312)
    ('83.1 %', '3.1 %')
    >>> probability_in_words(1e-9), probability_in_words(1.0)
    ('below 1 in 10,000', 'above 99.99 %')
    """
    if probability < LEAST:
        return f"below 1 in {1.0 / LEAST:,.0f}"
    if probability > 1.0 - LEAST:
        return f"above {100.0 * (1.0 - LEAST):.2f} %"
    digits = 4 if probability > 0.99 else 3 if probability > 0.1 else 2
    return f"{100.0 * probability:.{digits}g} %"


def foretold(time: float, now: float) -> float:
    """Round a foretold time to about a hundredth of how far ahead it is.

    More digits would say more than is known of it.

    Examples
    --------
    >>> foretold(75.2719, 51.0), foretold(181.443, 81.0), foretold(3.0, 3.0)
    (75.3, 181.0, 3.0)
    """
    ahead = abs(time - now)
    if not math.isfinite(time) or ahead == 0:
        return time
    return round(time, 2 - math.floor(math.log10(ahead)))
