"""Conversion of samples from units of a file to SI, once, with a note.

A unit travels with its channel, so that what was turned into m/s^2 says so and is not turned
again. Volts and counts need a sensitivity; without one they stay what they are.
"""

import dataclasses
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slowtime_services.files.record import (
    NAMES_ACCELERATION,
    Record,
    RecordError,
    Values,
    find_column,
)
from slowtime_services.files.units import (
    COUNTS,
    SI,
    VOLTS,
    Sensitivity,
    sensitivity_of,
    unit_of,
)

_MOTION = re.compile(r"(?<![a-z])(?:[mµu]?g|gal|m?m\s*/\s*s)(?![a-z])", re.I)
MOST_NAMES = 8
"""Channels that a note names."""


def in_si(
    record: Record, units: Sequence[str] = (), sensitivities: Sequence[str] = ()
) -> Record:
    """Turn accelerations into m/s^2, velocities into m/s and displacements into m.

    Parameters
    ----------
    units
        ``UNIT`` of all channels, or ``CHANNEL=UNIT``; they overrule the file.
    sensitivities
        ``100mV/g`` of all channels in volts, or ``CHANNEL=100mV/g``; ``256LSB/g`` of counts.

    Raises
    ------
    RecordError
        Where a channel is not there, or its unit and its sensitivity do not go together.
    """
    scaling = scaling_of(record.channels, record.units, units, sensitivities)
    return dataclasses.replace(
        record,
        samples=_scaled(record.samples, scaling.factors),
        units=scaling.units,
        notes=(*record.notes, *scaling.notes),
    )


class Scaling(NamedTuple):
    """For each channel the factor on its numbers, and the resulting unit."""

    factors: tuple[float, ...]
    units: tuple[str, ...]
    notes: tuple[str, ...]


def scaling_of(
    channels: tuple[str, ...],
    stated: Sequence[str],
    units: Sequence[str] = (),
    sensitivities: Sequence[str] = (),
) -> Scaling:
    """Return the factors from stated units to SI; see `in_si`.

    Raises
    ------
    RecordError
        As `in_si` does.

    Examples
    --------
    >>> scaling_of(("a", "b"), ("mm/s", ""), ["b=V"])[:2]
    ((0.001, 1.0), ('m/s', 'V'))
    """
    given = _by_channel(units, channels, "unit")
    scales = _by_channel(sensitivities, channels, "sensitivity")
    said = list(stated)
    notes: list[str] = []
    for column, unit in given.items():
        if said[column] and said[column] != unit.value:
            notes.append(
                f"By file or layout {channels[column]} is in {said[column]}; {unit.value} "
                "was given and is used."
            )
        said[column] = unit.value
    factors, targets = _factors(channels, said, scales)
    notes += _conversion_notes(channels, said, factors, targets, scales)
    return Scaling(tuple(factors), tuple(targets), tuple(notes))


def mixed_units(channels: Sequence[str], units: Sequence[str]) -> str:
    """List channels by unit, if there are several units; empty otherwise.

    Examples
    --------
    >>> mixed_units(("a", "b", "c"), ("m/s^2", "", "m/s^2"))
    'a, c in m/s^2; b without a unit'
    """
    groups: dict[str, list[str]] = {}
    for name, unit in zip(channels, units, strict=True):
        groups.setdefault(unit, []).append(name)
    if len(groups) < 2:
        return ""
    return "; ".join(
        f"{_listed(names)} {f'in {unit}' if unit else 'without a unit'}"
        for unit, names in groups.items()
    )


class _Given(NamedTuple):
    """An option for a channel, by its name or for all."""

    value: str
    named: bool


def _by_channel(
    texts: Sequence[str], channels: tuple[str, ...], what: str
) -> dict[int, _Given]:
    """Return the option for each column: the general one, then the named ones."""
    found: dict[int, _Given] = {}
    for text in sorted(texts, key=lambda one: "=" in one):
        name, equals, value = text.rpartition("=")
        if not value.strip() or (equals and not name.strip()):
            raise RecordError(
                f"{text!r} gives no {what}. Give one of all channels, or "
                f"CHANNEL={what.upper()}."
            )
        columns = [find_column(name.strip(), channels)] if equals else range(len(channels))
        found.update(dict.fromkeys(columns, _Given(value.strip(), bool(equals))))
    return found


def _factors(
    channels: Sequence[str], units: Sequence[str], scales: dict[int, _Given]
) -> tuple[list[float], list[str]]:
    """Return for each column the factor, and the resulting unit."""
    factors, targets = [1.0] * len(units), list(units)
    unused = dict(scales)
    for column, unit in enumerate(units):
        if column in scales:
            scale = _sensitivity(scales[column].value)
            worth = _signal_worth(unit, scale)
            if worth is not None:
                named = scales[column].named
                unused = {c: g for c, g in unused.items() if c != column and (named or g.named)}
                factors[column] = worth / scale.per_si
                targets[column] = SI[scale.quantity]
                continue
        known = unit_of(unit, channels[column])
        if known is not None:
            factors[column], targets[column] = known.factor, SI[known.quantity]
    for column, given in unused.items():
        raise _no_signal(channels[column], units[column], given.value)
    return factors, targets


def _sensitivity(text: str) -> Sensitivity:
    try:
        return sensitivity_of(text)
    except ValueError as error:
        raise RecordError(str(error)) from None


def _signal_worth(unit: str, scale: Sensitivity) -> float | None:
    """Volts, or counts, of a number in a unit; None where it is in something else."""
    if scale.of == "V":
        return VOLTS.get(unit.strip("[]() ").casefold())
    plain = unit.strip("[]() ").casefold()
    return 1.0 if plain in COUNTS or plain.partition("/")[2].strip() in COUNTS - {""} else None


def _no_signal(channel: str, unit: str, text: str) -> RecordError:
    scale = _sensitivity(text)
    wants = "volts" if scale.of == "V" else "counts"
    cure = "say in which with --unit, such as" if not unit else "if that is wrong, give"
    return RecordError(
        f"{channel} is in {unit or 'no stated unit'}; the sensitivity {text} is of {wants}. "
        f"Name the channels it is of (CHANNEL={text}), or {cure} --unit "
        f"{channel}={'mV' if scale.of == 'V' else 'counts'}."
    )


def _scaled(samples: Values, factors: Sequence[float]) -> Values:
    """Multiply columns, in the smallest type that holds the result."""
    if all(factor == 1.0 for factor in factors):
        return samples
    kind = np.float32 if samples.dtype in (np.float32, np.int16) else np.float64
    return np.asarray(samples.astype(kind) * np.array(factors, dtype=kind))


def _conversion_notes(
    channels: Sequence[str],
    units: Sequence[str],
    factors: Sequence[float],
    targets: Sequence[str],
    scales: dict[int, _Given],
) -> list[str]:
    """Describe the conversions, and volts and g that were not converted."""
    groups: dict[tuple[str, str, float], list[str]] = {}
    volts, contradicted, others = [], [], []
    for column, (name, unit) in enumerate(zip(channels, units, strict=True)):
        if factors[column] != 1.0:
            by_scale = column in scales and unit_of(unit, name) is None
            of = f"{unit or 'counts'} by {scales[column].value}" if by_scale else unit
            groups.setdefault((targets[column], of, factors[column]), []).append(name)
        elif unit.strip("[]() ").casefold() in VOLTS:
            volts.append(name)
        elif unit_of(unit) is not None and unit_of(unit, name) is None:
            contradicted.append(f"{name} in {unit}")
        elif _is_unknown_motion(name, unit):
            others.append(f"{name} in {unit}")
    notes = [
        f"Converted to {target}: {_listed(names)} from {unit} (times {factor:.9g})."
        for (target, unit, factor), names in groups.items()
    ]
    if volts:
        notes.append(
            f"Left in volts, because no sensitivity is known: {_listed(volts)}. "
            "Frequencies do not depend on it; for accelerations, give --reading sensitivity, "
            "such as 100mV/g."
        )
    if contradicted:
        notes.append(
            "Left as they are, because their names tell of no acceleration: "
            f"{_listed(contradicted)}. If they are accelerations, say so in their names, such "
            "as acc_1, with --reading columns."
        )
    if others:
        notes.append(
            f"Left as they are, because their unit is not understood: {_listed(others)}. Give "
            "it with --unit, such as g, or for counts a --reading sensitivity, such as "
            "0.061mg/LSB."
        )
    return notes


def _is_unknown_motion(name: str, unit: str) -> bool:
    """Whether a unit seems to be one of motion, or is of an acceleration, and is not known."""
    if unit_of(unit) is not None or unit.strip("[]() ").casefold() in COUNTS:
        return False
    return bool(_MOTION.search(unit) or NAMES_ACCELERATION.search(name))


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more
