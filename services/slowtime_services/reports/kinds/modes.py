"""The first page of a report on modes of vibration."""

from collections.abc import Iterator, Sequence

import numpy as np

from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.modes import Mode
from slowtime_services.reports.first_page import (
    Alternative,
    Confidence,
    FirstPage,
    Sketch,
    level_of,
    measured_on,
    subject_of,
)
from slowtime_services.reports.words import Words

ALIKE = 0.9
"""MAC [1] from which two shapes are taken for one. Source: the customary level at which shapes
of two measurements count as those of one mode."""
MOST_DOUBTS = 2
"""Doubts about one mode that the first page tells [1]: the table below has flags and shapes."""
MOST_LISTED = 10
"""Frequencies that a first page lists [1]: two lines."""
Compared = tuple[float, float, float | None]
SDS_OF_LINE = 3.0
"""Distance of a mode from a machine line [standard deviations] up to which it may be that
line. Source: chance exceeds it in 0.3 %."""


def modes_page(
    name: str,
    result: ModalResult,
    channels: Sequence[str],
    words: Words,
    *,
    rate_hz: float | None = None,
    duration_s: float | None = None,
    start_ns: int | None = None,
    structure: str = "",
    compared: Sequence[Compared] = (),
    sketch: Sketch | None = None,
) -> FirstPage:
    """Give the first page of a report on modes.

    Parameters
    ----------
    name
        Name of the file of the record.
    start_ns
        Time of its first sample [ns since 1970]; None where it does not say.
    structure
        Name of the structure; empty where none is known.
    rate_hz, duration_s
        Of the record; None where it is made of frequency responses.
    compared
        Of each mode that a model has as well: both frequencies [Hz], and the MAC where the
        model has shapes.
    sketch
        Structure; None where no geometry is known.
    """
    modes, subject = result.structural, subject_of(structure, name, words)
    groups = _groups(modes)
    grouped = {row for group in groups for row in group}
    doubts = [
        _doubts(mode, result, words) + [words("modes.alike")] * (row in grouped)
        for row, mode in enumerate(modes)
    ]
    clean = [mode for mode, told in zip(modes, doubts, strict=True) if not told]
    facts = [(words("facts.data"), name), (words("facts.channels"), ", ".join(channels))]
    facts += _sampling(rate_hz, duration_s, words)
    if modes:
        relative = [mode.frequency_hz.sd / mode.frequency_hz.value for mode in modes]
        told = words(
            "modes.confidence",
            clean=len(clean),
            n=len(modes),
            sd=words.percent(float(np.median(relative)), 2),
        )
        confidence = Confidence(level_of(len(clean) / len(modes)), told)
    else:
        confidence = Confidence("low", words("modes.no_confidence"))
    return FirstPage(
        kind="modes",
        subject=subject,
        question=words("modes.question", name=subject),
        measured=measured_on([(start_ns, duration_s)], words),
        answer=_answer(modes, words),
        confidence=confidence,
        actions=list(_actions(modes, clean, words, compared=bool(compared))),
        alternatives=list(_alternatives(result, groups, doubts, words)),
        definition=_definition(clean, compared, words),
        facts=facts,
        sketch=sketch,
    )


def _sampling(
    rate_hz: float | None, duration_s: float | None, words: Words
) -> Iterator[tuple[str, str]]:
    if rate_hz is not None:
        yield words("facts.rate"), f"{words.number(rate_hz, 5)} Hz"
    if duration_s is not None:
        yield words("facts.duration"), f"{words.number(duration_s, 4)} s"


def _estimate(mode: Mode, words: Words) -> dict[str, str]:
    f, sd = words.measured(mode.frequency_hz.value, mode.frequency_hz.sd)
    found = {"f": f, "sd": sd}
    damping = mode.damping_ratio
    if np.isfinite(damping.value):
        z, sd = words.measured(100 * damping.value, 100 * damping.sd)
        return found | {"damping": words("modes.damping", z=z, sd=sd)}
    return found | {"damping": words("modes.undamped")}


def _answer(modes: Sequence[Mode], words: Words) -> str:
    if not modes:
        return words("modes.none")
    if len(modes) == 1:
        return words("modes.one", **_estimate(modes[0], words))
    low, high = (words.number(modes[k].frequency_hz.value, 4) for k in (0, -1))
    return words("modes.answer", n=len(modes), low=low, high=high, **_estimate(modes[0], words))


def _actions(
    modes: Sequence[Mode], clean: Sequence[Mode], words: Words, *, compared: bool
) -> Iterator[str]:
    if not modes:
        yield words("modes.do_longer")
        return
    if len(clean) < len(modes):
        yield words("modes.do_choose")
        if level_of(len(clean) / len(modes)) == "low":
            yield words("modes.do_better")
    if compared:
        yield words("modes.do_refit")
    elif clean:
        yield words("modes.do_use" if len(clean) == len(modes) else "modes.do_use_clean")


def _doubts(mode: Mode, result: ModalResult, words: Words) -> list[str]:
    """Say what a mode is flagged for, and why it may be no mode."""
    told = [flag.replace("_", " ") for flag in mode.flags]
    own = mode.frequency_hz
    for other in result.modes:
        away, sd = abs(own.value - other.frequency_hz.value), other.frequency_hz.sd
        if other.kind != "structural":
            width = mode.damping_ratio.value * own.value
            near = max(SDS_OF_LINE * np.hypot(own.sd, sd), np.nan_to_num(width))
            told += [words("modes.beside_line")] if away <= near else []
    return list(dict.fromkeys(told))


def _groups(modes: Sequence[Mode]) -> list[list[int]]:
    """Group modes that the channels do not tell apart: each is like another of its group."""
    group = list(range(len(modes)))
    for row, mode in enumerate(modes):
        for other in range(row):
            if len(mode.shape) > 1 and mac(mode.shape, modes[other].shape) > ALIKE:
                old, new = group[row], group[other]
                group = [new if one == old else one for one in group]
    found = [[row for row, one in enumerate(group) if one == name] for name in set(group)]
    return sorted(rows for rows in found if len(rows) > 1)


def _listed(modes: Sequence[Mode], words: Words) -> str:
    """List frequencies; of many the first, and how many more there are."""
    shown = [words.number(mode.frequency_hz.value, 4) for mode in modes[:MOST_LISTED]]
    more = len(modes) - len(shown)
    rest = f" {words('modes.more', n=more)}" if more else ""
    return f"{'; '.join(shown)} Hz{rest}"


def _definition(clean: Sequence[Mode], compared: Sequence[Compared], words: Words) -> str:
    said = [words("modes.clean", listed=_listed(clean, words))] if clean else []
    if compared:
        hz, own, _ = max(compared, key=lambda one: abs(np.log(one[0] / one[1])))
        told = words.percent(abs(hz / own - 1.0), 2)
        at = words.number(hz, 4)
        said.append(words("modes.compared", n=len(compared), most=told, at=at))
        alike = [one[2] for one in compared if one[2] is not None]
        if alike:
            said.append(words("modes.least_mac", mac=words.number(min(alike), 2)))
    return " ".join([*said, words("sd")])


def _alternatives(
    result: ModalResult, groups: Sequence[list[int]], doubts: Sequence[list[str]], words: Words
) -> Iterator[Alternative]:
    """Give modes that may be something else, then lines of machines."""
    lines = [mode for mode in result.modes if mode.kind != "structural"]
    for rows in groups:
        of_group = [result.structural[row] for row in rows]
        yield Alternative(_listed(of_group, words), words("modes.alike"))
    alike = words("modes.alike")
    for mode, every in zip(result.structural, doubts, strict=True):
        told = [one for one in every if one != alike]
        if told:
            hz = f"{words.number(mode.frequency_hz.value, 4)} Hz"
            yield Alternative(hz, ", ".join(told[:MOST_DOUBTS]))
    if lines:
        yield Alternative(_listed(lines, words), words("modes.machine"))
