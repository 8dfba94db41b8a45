"""The first page of a report on modes of vibration."""

from collections.abc import Iterator, Sequence

import numpy as np

from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.modes import Mode
from slowtime_services.reports.first_page import (
    Alternative,
    Confidence,
    FirstPage,
    Sketch,
    level_of,
)
from slowtime_services.reports.words import Words


def modes_page(
    name: str,
    result: ModalResult,
    channels: Sequence[str],
    words: Words,
    *,
    rate_hz: float | None = None,
    duration_s: float | None = None,
    sketch: Sketch | None = None,
) -> FirstPage:
    """Give the first page of a report on modes.

    Parameters
    ----------
    name
        Name of the record.
    rate_hz, duration_s
        Of the record; None where it is made of frequency responses.
    sketch
        Structure; None where no geometry is known.
    """
    modes = result.structural
    clean = [mode for mode in modes if not mode.flags]
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
        subject=name,
        question=words("modes.question", name=name),
        answer=_answer(modes, words),
        confidence=confidence,
        actions=list(_actions(modes, clean, words)),
        alternatives=list(_alternatives(result, words)),
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


def _alternatives(result: ModalResult, words: Words) -> Iterator[Alternative]:
    for mode in result.modes:
        hz = f"{words.number(mode.frequency_hz.value, 4)} Hz"
        if mode.kind != "structural":
            yield Alternative(hz, words("modes.machine"))
        elif mode.flags:
            yield Alternative(hz, ", ".join(flag.replace("_", " ") for flag in mode.flags))
