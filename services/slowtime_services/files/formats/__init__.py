"""Text formats whose headings define the numbers: lines in, a `Sheet` out."""

import dataclasses
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


@dataclasses.dataclass(frozen=True, slots=True)
class TextFormat:
    """A text format: its name, usual endings, contents, and reader."""

    name: str
    suffixes: tuple[str, ...]
    gives: str
    reader: Format


FORMATS: tuple[TextFormat, ...] = tuple(
    TextFormat(name, suffixes, gives, cast(Format, module))
    for name, suffixes, gives, module in (
        ("a LabVIEW measurement", (".lvm",),
         "channels of the first segment, units, Delta_X, start", labview),
        ("a universal file (UFF 58)", (".uff", ".unv"),
         "evenly spaced time responses, their units, interval and start", universal),
        ("a listing of time series (SLIST, TSPAIR)", (".ascii", ".txt"),
         "one channel, its segments, rate, unit and start", timeseries),
        ("a K-NET or KiK-net file", (".NS", ".EW", ".UD"),
         "one channel by its scale factor, rate and start", knet),
        ("a strong-motion listing (CSMIP, COSMOS V1, V2)", (".v1", ".v2"),
         "accelerations by their Fortran format, interval and unit", fixed_fields),
    )
)  # fmt: skip
"""The first that recognises a file reads it."""

__all__ = ["FORMATS", "Format", "TextFormat"]
