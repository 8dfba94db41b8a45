"""Access by key to objects that the Python client returned as dictionaries before."""

import warnings
from typing import Any


class KeyedAccess:
    """Has each attribute by its name as a key too, with a warning."""

    def __getitem__(self, key: str) -> Any:
        warnings.warn(
            f"Access by key, [{key!r}], is deprecated. Write .{key} instead; keys end with "
            "version 0.3.",
            DeprecationWarning,
            stacklevel=2,
        )
        return getattr(self, key)
