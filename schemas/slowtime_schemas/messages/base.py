"""The base of all messages, and the kinds of clocks."""

from typing import ClassVar, Literal

from slowtime_schemas.quantities import (
    BootId,
    Frozen,
    Name,
    Nanoseconds,
    Sequence,
)

TimeBase = Literal["live", "recorded", "simulated"]
"""Whose clock `t_ns` is: a device's now, a recording's then, or a simulator's own."""


class Message(Frozen):
    """What every message says of itself."""

    MESSAGE: ClassVar[str]
    VERSION: ClassVar[int]

    version: int
    site: Name
    asset: Name
    boot: BootId
    sequence: Sequence
    t_ns: Nanoseconds

    @property
    def twin_id(self) -> str:
        """The twin this message is about."""
        return f"{self.site}.{self.asset}"
