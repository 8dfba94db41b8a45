"""Reasons to doubt a mode: its flags, lines of machines near it, and shapes of others."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.harmonics.beside_lines import FLAG as BESIDE_A_LINE
from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.modes import Mode
from slowtime_services.reports.words import Words

ALIKE = 0.9
"""MAC [1] from which two shapes are taken for one. Source: the customary level at which shapes
of two measurements count as those of one mode."""

ALIKE_BEYOND = 0.5
"""MAC [1] from which two shapes are not told apart where there are more modes than channels.
Source: from there on, more of a shape is the other's than its own."""

SDS_OF_LINE = 3.0
"""Distance of a mode from a machine line [standard deviations] up to which it may be that
line. Source: chance exceeds it in 0.3 %."""


@dataclasses.dataclass(frozen=True, slots=True)
class Doubt:
    """A reason to doubt a mode.

    Parameters
    ----------
    cause
        `alike`, `beyond`, `beside_line`, or a flag of the mode.
    short
        The reason in a few words, the same for all modes of that cause.
    told
        The reason with its numbers.
    """

    cause: str
    short: str
    told: str


def doubts_of(result: ModalResult, words: Words) -> list[list[Doubt]]:
    """List the reasons to doubt each structural mode; empty where it can be used."""
    modes = result.structural
    alike = {row for group in alike_groups(modes) for row in group}
    beyond = _beyond_the_channels(modes)
    found: list[list[Doubt]] = []
    for row, mode in enumerate(modes):
        doubts = list(_line_doubts(mode, result, words))
        known = {doubt.cause for doubt in doubts}
        flags = [f for f in mode.flags if f != BESIDE_A_LINE or "beside_line" not in known]
        doubts += [_flag_doubt(flag, words) for flag in dict.fromkeys(flags)]
        if row in alike or row in beyond:
            doubts.append(
                _shape_doubt(row, modes, "alike" if row in alike else "beyond", words)
            )
        found.append(doubts)
    return found


def alike_groups(modes: Sequence[Mode]) -> list[list[int]]:
    """Group modes that the channels do not tell apart: each is like another of its group."""
    group = list(range(len(modes)))
    for row, mode in enumerate(modes):
        for other in range(row):
            if len(mode.shape) > 1 and mac(mode.shape, modes[other].shape) > ALIKE:
                old, new = group[row], group[other]
                group = [new if one == old else one for one in group]
    found = [[row for row, one in enumerate(group) if one == name] for name in set(group)]
    return sorted(rows for rows in found if len(rows) > 1)


def _beyond_the_channels(modes: Sequence[Mode]) -> set[int]:
    """Find modes of a shape like another's, beyond as many as there are channels.

    Of n channels at most n shapes are independent. As long as there are more modes, the worse
    one of the two most alike is dropped: that of lower quality, then of wider frequency.
    """
    left, dropped = list(range(len(modes))), set[int]()
    if not modes or len(modes[0].shape) < 2:
        return dropped
    while len(left) > len(modes[0].shape):
        pairs = [(a, b) for k, a in enumerate(left) for b in left[:k]]
        macs = [mac(modes[a].shape, modes[b].shape) for a, b in pairs]
        most = int(np.argmax(macs))
        if macs[most] < ALIKE_BEYOND:
            break
        worse = max(pairs[most], key=lambda row: _badness(modes[row]))
        dropped.add(worse)
        left.remove(worse)
    return dropped


def _badness(mode: Mode) -> tuple[float, float]:
    return -mode.quality, mode.frequency_hz.sd / mode.frequency_hz.value


def _shape_doubt(row: int, modes: Sequence[Mode], cause: str, words: Words) -> Doubt:
    others = [other for other in range(len(modes)) if other != row]
    macs = [float(mac(modes[row].shape, modes[other].shape)) for other in others]
    most = int(np.argmax(macs))
    hz = words.number(modes[others[most]].frequency_hz.value, 4)
    numbers = {"hz": hz, "mac": words.localised(f"{macs[most]:.2f}")}
    told = words(f"modes.doubt_{cause}", n=len(modes[row].shape), **numbers)
    return Doubt(cause, words(f"modes.why_{cause}"), told)


def _line_doubts(mode: Mode, result: ModalResult, words: Words) -> Iterator[Doubt]:
    """Give the line of a machine nearest to a mode, where the mode may be that line."""
    own = mode.frequency_hz
    lines = [one.frequency_hz for one in result.modes if one.kind != "structural"]
    if not lines:
        return
    line = min(lines, key=lambda one: abs(own.value - one.value))
    width = float(np.nan_to_num(mode.damping_ratio.value * own.value))
    if abs(own.value - line.value) <= max(SDS_OF_LINE * np.hypot(own.sd, line.sd), width):
        told = words("modes.beside_line", hz=words.number(line.value, 4))
        yield Doubt("beside_line", words("modes.why_beside_line"), told)


def _flag_doubt(flag: str, words: Words) -> Doubt:
    told = words.known(f"modes.flag_{flag}") or flag.replace("_", " ")
    return Doubt("beside_line" if flag == BESIDE_A_LINE else flag, told, told)
