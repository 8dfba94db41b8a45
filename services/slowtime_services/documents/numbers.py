"""Numbers of a document, as far as a floating-point number can hold them."""

import math

MOST_DIGITS = 400
"""Characters of an integer [1]: the largest double has 309 digits."""


def whole_number(text: str) -> int:
    """Read an integer of YAML 1.2 or JSON.

    Raises
    ------
    OverflowError
        Where it is more than a floating-point number holds.

    Examples
    --------
    >>> [whole_number(text) for text in ("010", "0o10", "0x1F", "-7")]
    [10, 8, 31, -7]
    """
    if len(text) > MOST_DIGITS:
        raise OverflowError(f"it has {len(text):,} digits, more than a number may have")
    base = {"0o": 8, "0x": 16}.get(text[:2], 10)
    number = int(text if base == 10 else text[2:], base)
    try:
        float(number)
    except OverflowError:
        raise OverflowError("it is larger than 1.8e308, the largest number") from None
    return number


def finite_number(text: str) -> float:
    """Read a floating-point number of JSON or TOML.

    Raises
    ------
    OverflowError
        Where it is more than a floating-point number holds.

    Examples
    --------
    >>> finite_number("1e-400")
    0.0
    """
    number = float(text)
    if math.isinf(number) and "inf" not in text.casefold():
        raise OverflowError("it is larger than 1.8e308, the largest number")
    return number
