"""Former names of the Python interface, which warn."""

import warnings
from collections.abc import Callable
from typing import Any


def renamed(former: str, name: str) -> Callable[..., Any]:
    """Make a method that warns and calls another one of the same object.

    Parameters
    ----------
    former
        Class and former name, for the warning.
    name
        Present name of the method.

    Returns
    -------
    The method.
    """
    message = f"{former} is deprecated and ends with version 0.3. Write {name} instead."

    def called(self: Any, *given: Any, **named: Any) -> Any:
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return getattr(self, name)(*given, **named)

    called.__name__ = called.__qualname__ = former.rpartition(".")[2]
    called.__doc__ = f"Do the same as `{name}`; deprecated."
    called.__deprecated__ = message  # type: ignore[attr-defined]  # as PEP 702 has it
    return called
