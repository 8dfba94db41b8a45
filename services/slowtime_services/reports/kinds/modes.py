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
    sketch
        Structure; None where no geometry is known.
    """
    modes, subject = result.structural, subject_of(structure, name, words)
    doubts = [_doubts(mode, result, words) for mode in modes]
    clean = [mode for mode, told in zip(modes, doubts, strict=True) if not told]
    facts = [(words("facts.data"), name), (words("facts.channels"), ", ".join(channels))]
    if rate_hz is not None:
        facts.append((words("facts.rate"), f"{words.number(rate_hz, 5)} Hz"))
    if duration_s is not None:
        facts.append((words("facts.duration"), f"{words.number(duration_s, 4)} s"))
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
        actions=list(_actions(modes, clean, words)),
        alternatives=list(_alternatives(result, doubts, words)),
        facts=facts,
        sketch=sketch,
    )


def _estimate(mode: Mode, words: Words) -> dict[str, str]:
    found = {
        "f": words.number(mode.frequency_hz.value, 5),
        "sd": words.number(mode.frequency_hz.sd, 2),
    }
    damping = mode.damping_ratio
    if np.isfinite(damping.value):
        z, sd = words.number(100 * damping.value, 3), words.number(100 * damping.sd, 2)
        return found | {"damping": words("modes.damping", z=z, sd=sd)}
    return found | {"damping": words("modes.undamped")}


def _answer(modes: Sequence[Mode], words: Words) -> str:
    if not modes:
        return words("modes.none")
    if len(modes) == 1:
        return words("modes.one", **_estimate(modes[0], words))
    low, high = (words.number(modes[k].frequency_hz.value, 4) for k in (0, -1))
    return words("modes.answer", n=len(modes), low=low, high=high, **_estimate(modes[0], words))


def _actions(modes: Sequence[Mode], clean: Sequence[Mode], words: Words) -> Iterator[str]:
    if not modes:
        yield words("modes.do_longer")
        return
    if len(clean) < len(modes):
        yield words("modes.do_choose")
    yield words("modes.do_use")


def _doubts(mode: Mode, result: ModalResult, words: Words) -> list[str]:
    """Say what a mode is flagged for, and why it may be another mode or no mode."""
    told = [flag.replace("_", " ") for flag in mode.flags]
    own = mode.frequency_hz
    for other in result.modes:
        away, sd = abs(own.value - other.frequency_hz.value), other.frequency_hz.sd
        if other.kind != "structural":
            width = mode.damping_ratio.value * own.value
            near = max(SDS_OF_LINE * np.hypot(own.sd, sd), np.nan_to_num(width))
            told += [words("modes.beside_line")] if away <= near else []
        elif other is not mode and len(mode.shape) > 1 and mac(mode.shape, other.shape) > ALIKE:
            hz = f"{words.number(other.frequency_hz.value, 4)} Hz"
            told.append(words("modes.alike", other=hz))
    return list(dict.fromkeys(told))


def _alternatives(
    result: ModalResult, doubts: Sequence[list[str]], words: Words
) -> Iterator[Alternative]:
    """Give modes that may be something else, then lines of machines."""
    lines = [mode for mode in result.modes if mode.kind != "structural"]
    for mode, told in zip(result.structural, doubts, strict=True):
        if told:
            hz = f"{words.number(mode.frequency_hz.value, 4)} Hz"
            yield Alternative(hz, ", ".join(told[:MOST_DOUBTS]))
    for line in lines:
        hz = f"{words.number(line.frequency_hz.value, 4)} Hz"
        yield Alternative(hz, words("modes.machine"))
