"""Text formats whose headings fix what their numbers mean: lines in, a `Sheet` out."""

from collections.abc import Sequence
from typing import Protocol, cast

from slowtime_services.files.sheet import Sheet

from . import fixed_fields, knet, labview, timeseries, universal


class Format(Protocol):
    """A module that reads one format."""

    def recognise(self, lines: Sequence[str]) -> bool:
        """Whether the first lines are of this format."""

    def read(self, lines: Sequence[str], name: str) -> Sheet:
        """Read all lines of a file of that name."""


FORMATS: Sequence[Format] = tuple(
    cast(Format, module) for module in (labview, universal, timeseries, knet, fixed_fields)
)

__all__ = ["FORMATS", "Format"]
