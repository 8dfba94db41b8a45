"""Arrays within model files, as base64."""

import base64
import binascii


def checked_base64(value: str) -> str:
    """Return a text that is base64.

    Raises
    ------
    ValueError
        If it is not; says how to make one.
    """
    try:
        base64.b64decode(value, validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(
            f"This is no base64 ({error}). Write the file by `slowtime model reduce --out`."
        ) from None
    return value
