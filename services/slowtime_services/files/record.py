"""Records of measurements, independent of the format of their file."""

import dataclasses
import functools
import itertools
import re
from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Shaped

from slowtime.signals.block import Block

from .units import unit_of

Values = Shaped[np.ndarray, "..."]
NAMES_ACCELERATION = re.compile(
    r"acc|(low|high)[ _-]?g(?![a-z])|(?<![a-z])a[ _-]?[xyz](?![a-z])", re.IGNORECASE
)
NAMES_SLOW = re.compile(
    r"temp|humid|batt|(?<![a-z])(?:lat|lon|alt)(?![a-z])|latitude|longitude|rssi|satell|baro",
    re.IGNORECASE,
)
"""Names of what changes slowly beside a vibration, and is none."""
UNITS_SLOW = frozenset(("°c", "degc", "c", "°f", "k", "%", "%rh", "hpa", "mbar"))
SENSOR_DTYPES = ("<f8", "<f4", "<i4", "<i2")
"""Types of samples that stay what they are; any other becomes ``<f8``."""

UNDATED_NS = 946_684_800_000_000_000
"""2000-01-01 UTC: when a record begins, on a bus or in a recording, that does not say when."""


class RecordError(ValueError):
    """A file that cannot be read as a record; the text says what to do."""


@dataclasses.dataclass(frozen=True, slots=True)
class Gap:
    """Samples that the time column shows to be missing."""

    row: int
    """Row before which they are missing."""
    missing: int
    """How many."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """Channels sampled together at one rate.

    Parameters
    ----------
    samples
        One row per instant, one column per channel, in the unit that `units` states and,
        where it is one of `SENSOR_DTYPES` and nothing was converted, the file's own type.
    rate_hz
        Samples per second.
    channels, units
        Name and unit of each column; the unit is ``""`` where the file does not say.
    start_ns
        Time of the first row since 1970-01-01 UTC [ns]; None where the file does not say.
    gaps
        Missing samples that the time column shows.
    aux
        What else the file holds: the time column, columns not asked for, single numbers.
    notes
        What a person should know of how the file was read.
    assumptions
        What was taken for granted of it: which column is the clock, which are no channels,
        where the rate is from.
    """

    samples: Shaped[np.ndarray, "time channel"]
    rate_hz: float
    channels: tuple[str, ...]
    units: tuple[str, ...]
    start_ns: int | None = None
    gaps: tuple[Gap, ...] = ()
    aux: Mapping[str, Values] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()

    @property
    def duration_s(self) -> float:
        """From the first sample to the instant after the last, gaps included [s]."""
        return (len(self.samples) + sum(gap.missing for gap in self.gaps)) / self.rate_hz

    def channel(self, name: str) -> Shaped[np.ndarray, " time"]:
        """Look up the channel called `name`.

        Raises
        ------
        RecordError
            Where no channel has that name.
        """
        return np.asarray(self.samples[:, find_column(name, self.channels)])

    def blocks(self, block_s: float = 1.0, *, start_ns: int | None = None) -> Iterator[Block]:
        """Cut into blocks of at most `block_s`, none of which spans a gap.

        Parameters
        ----------
        start_ns
            Time of the first row, where the file does not say or shall not be believed.
        """
        begin = self.start_ns if start_ns is None else start_ns
        begin = 0 if begin is None else begin
        rows = max(1, round(block_s * self.rate_hz))
        starts = [0, *(gap.row for gap in self.gaps), len(self.samples)]
        lost = 0
        for number, (first, last) in enumerate(itertools.pairwise(starts)):
            lost += self.gaps[number - 1].missing if number else 0
            for row in range(first, last, rows):
                yield Block(
                    samples=self.samples[row : min(row + rows, last)],
                    rate_hz=self.rate_hz,
                    first_index=row + lost,
                    start_ns=begin + round((row + lost) * 1e9 / self.rate_hz),
                    channels=self.channels,
                    units=self.units,
                )


def find_column(name: str, names: tuple[str, ...]) -> int:
    """Index of `name` in `names`: exact, else regardless of case, else as a number from 0.

    Examples
    --------
    >>> find_column("acc", ("t", "Acc")), find_column("0", ("t", "Acc"))
    (1, 0)
    """
    if name in names:
        return names.index(name)
    folded = [other.casefold() for other in names]
    if folded.count(name.casefold()) == 1:
        return folded.index(name.casefold())
    if name.isascii() and name.isdigit() and int(name) < len(names):
        return int(name)
    raise RecordError(
        f"No column is called {name!r}. There are: {', '.join(map(repr, names))}; a number "
        f"from 0 to {len(names) - 1} will also do."
    )


def accelerations(channels: tuple[str, ...], units: tuple[str, ...]) -> tuple[str, ...]:
    """Return channels that are accelerations by unit or name; all possible ones if none is.

    A record may hold a position or a temperature beside its accelerometers, and what that does
    is no vibration of the structure.

    Examples
    --------
    >>> accelerations(("Low G Accel", "PinLoc"), ("V", "V"))
    ('Low G Accel',)
    >>> accelerations(("lowg", "acc_2", "load"), ("V", "V", "N"))
    ('lowg', 'acc_2')
    >>> accelerations(("x", "y"), ("in/s^2", "mm"))
    ('x',)
    >>> accelerations(("x", "y"), ("", ""))
    ('x', 'y')
    >>> accelerations(("x", "y", "temp_C"), ("", "", ""))
    ('x', 'y')
    """
    said = tuple(
        name
        for name, unit in zip(channels, units, strict=True)
        if _is_acceleration(unit, name) or NAMES_ACCELERATION.search(name)
    )
    if said:
        return said
    slow = {
        name
        for name, unit in zip(channels, units, strict=True)
        if unit.casefold() in UNITS_SLOW or NAMES_SLOW.search(name)
    }
    return tuple(name for name in channels if name not in slow) or channels


def _is_acceleration(unit: str, name: str) -> bool:
    known = unit_of(unit, name)
    return known is not None and known.quantity == "acceleration"


def in_sensor_type(values: Values) -> Values:
    """`values` as they are if a sensor could have sent them so, else as float64."""
    kind = values.dtype.newbyteorder("<")
    if kind.str in SENSOR_DTYPES:
        return values.astype(kind, copy=False)
    return values.astype("<f8")


@functools.lru_cache(maxsize=1)
def _unit_words() -> frozenset[str]:
    words = (
        "s sec secs second seconds ms us µs ns min v mv uv volt volts voltage g mg m mm cm um"
    )
    words += (
        " µm km n kn mn nm pa kpa mpa hz rad deg rpm kg a ma °c degc c m/s mm/s m/s2 m/s^2 "
    )
    words += (
        "m/s² m/s**2 mm/s2 mm/s^2 m·s-2 m.s-2 (unscaled) unscaled - 1 % [-] unit units strain"
    )
    return frozenset(words.split())


def looks_like_unit(text: str) -> bool:
    """Whether `text` is written as a unit is.

    Examples
    --------
    >>> [looks_like_unit(text) for text in ("m/s^2", "[V]", "Voltage (unscaled)", "acc_z")]
    [True, True, True, False]
    """
    words = text.strip().casefold().replace("[", "").replace("]", "").split()
    begins_plain = len(words) == 1 and "/" in words[0] and not words[0][0].isdigit()
    if begins_plain and unit_of(words[0]) is not None:
        return True
    return bool(words) and all(
        word in _unit_words() or word.strip("()") in _unit_words() for word in words
    )
