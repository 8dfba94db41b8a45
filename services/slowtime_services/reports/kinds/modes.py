"""The first page of a report on modes of vibration."""

import itertools
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.estimates import Measured
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

from .mode_doubts import ALIKE, ALIKE_BEYOND, Doubt, alike_groups, doubts_of

MOST_DOUBTS = 2
"""Doubts about one mode that the first page tells [1]: the table below has flags and shapes."""
MOST_LISTED = 10
"""Frequencies that a first page lists [1]: two lines."""
MOST_REASONS = 3
"""Reasons for doubts that the headline names [1]: the table has all."""

LIKENESS = {0.1: "completely", ALIKE_BEYOND: "clearly", 1.0: "partly"}
"""MAC [1] up to which shapes are said to differ so. Source: at 0.1 nine tenths of a shape are
not the other's; from `ALIKE_BEYOND` on, more of it is the other's than its own."""

SAME_SDS, SAME_SHARE = 2.0, 0.01
"""Differences of a model's frequency up to which the model is kept: in combined standard
deviations [1] (chance exceeds it in 5 %), and relative [1] (less than boundary conditions and
temperature change of a structure from day to day)."""


class Compared(NamedTuple):
    """A mode beside that of a model: frequencies [Hz]; MAC, None without shapes."""

    frequency_hz: Measured
    model_hz: float
    mac: float | None

    @property
    def share(self) -> float:
        """Difference over the model's frequency [1]."""
        return abs(self.frequency_hz.value / self.model_hz - 1.0)

    @property
    def sds(self) -> float:
        """Difference in standard deviations of the measured frequency; a model has none."""
        away = abs(self.frequency_hz.value - self.model_hz)
        return away / self.frequency_hz.sd if self.frequency_hz.sd > 0.0 else float("inf")

    @property
    def same(self) -> bool:
        """Whether the model is as good as the measurement, or as such models are."""
        return self.sds <= SAME_SDS or self.share <= SAME_SHARE


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
        Each mode that a model has as well, beside the model's.
    sketch
        Structure; None where no geometry is known.
    """
    modes, subject = result.structural, subject_of(structure, name, words)
    doubts = doubts_of(result, words)
    clean = [mode for mode, told in zip(modes, doubts, strict=True) if not told]
    usable = {mode.frequency_hz.value for mode in clean}
    sound = [one for one in compared if one.frequency_hz.value in usable]
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
        level = level_of(len(clean) / len(modes))
        confidence = Confidence(level, told, words(f"modes.sure_{level}"))
    else:
        confidence = Confidence("low", words("modes.no_confidence"))
    return FirstPage(
        kind="modes",
        subject=subject,
        question=words("modes.question", name=subject),
        measured=measured_on([(start_ns, duration_s)], words),
        answer=" ".join(_answer(clean, doubts, sound, words)),
        confidence=confidence,
        actions=list(_actions(modes, clean, sound, words)),
        alternatives=list(_alternatives(result, doubts, words)),
        weighed=" ".join(_weighed(result, clean, words, ambient=rate_hz is not None)),
        definition=_definition(modes, clean, compared, words),
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


def _answer(
    clean: Sequence[Mode],
    doubts: Sequence[Sequence[Doubt]],
    compared: Sequence[Compared],
    words: Words,
) -> Iterator[str]:
    """Count the modes, then say whether a model, or nothing, is beside them."""
    if not doubts:
        yield words("modes.none")
        return
    yield _count(clean, doubts, words)
    if compared:
        worst = _worst(compared)
        hz, share = words.number(worst.frequency_hz.value, 4), words.percent(worst.share, 2)
        yield words(f"modes.verdict_{_verdict(worst)}", hz=hz, share=share)
    elif clean:
        yield words("modes.verdict_alone")


def _worst(compared: Sequence[Compared]) -> Compared:
    """Pick the mode that speaks most against a model: by its frequency, else by its shape."""
    apart = max(compared, key=lambda one: (not one.same, one.share))
    unlike = [one for one in compared if one.mac is not None and one.mac < ALIKE]
    return min(unlike, key=lambda one: one.mac or 0.0) if apart.same and unlike else apart


def _verdict(worst: Compared) -> Literal["refit", "shapes", "keep"]:
    if not worst.same:
        return "refit"
    return "shapes" if worst.mac is not None and worst.mac < ALIKE else "keep"


def _count(clean: Sequence[Mode], doubts: Sequence[Sequence[Doubt]], words: Words) -> str:
    """Count the modes that can be used, then those that are doubtful and why."""
    if len(clean) == 1:
        said = words("modes.one", **_estimate(clean[0], words))
    elif clean:
        said = words("modes.answer", n=len(clean), listed=_listed(clean, words, sd=True))
    else:
        said = words("modes.none_usable")
    doubtful = len(doubts) - len(clean)
    if not doubtful:
        return f"{said}."
    reasons = list(dict.fromkeys(one.short for every in doubts for one in every))
    why = "; ".join(reasons[:MOST_REASONS])
    why += " …" * (len(reasons) > MOST_REASONS)
    key = "modes.doubtful_one" if doubtful == 1 else "modes.doubtful"
    return f"{said}; {words(key, n=doubtful, why=why)}."


def _actions(
    modes: Sequence[Mode], clean: Sequence[Mode], compared: Sequence[Compared], words: Words
) -> Iterator[str]:
    """Say what to do; `compared` holds the usable modes that a model has as well."""
    if not modes:
        yield words("modes.do_longer")
        return
    if compared:
        yield _model_action(compared, words)
    if len(clean) < len(modes):
        yield words("modes.do_choose")
        if level_of(len(clean) / len(modes)) == "low":
            yield words("modes.do_better")
    if clean and not compared:
        yield words("modes.do_use" if len(clean) == len(modes) else "modes.do_use_clean")


def _model_action(compared: Sequence[Compared], words: Words) -> str:
    """Decide whether a model is kept, by the differences of its frequencies and shapes."""
    worst = _worst(compared)
    share, hz = words.percent(worst.share, 2), words.number(worst.frequency_hz.value, 4)
    match _verdict(worst):
        case "refit":
            return words("modes.do_refit", hz=hz, share=share, sds=words.number(worst.sds, 2))
        case "shapes":
            return words("modes.do_shapes", hz=hz, mac=words.number(worst.mac or 0.0, 2))
    sds = max(one.sds for one in compared)
    if sds <= SAME_SDS:
        return words("modes.do_keep", share=share, sds=words.number(sds, 2))
    return words("modes.do_keep_share", share=share, limit=words.percent(SAME_SHARE))


def _listed(modes: Sequence[Mode], words: Words, *, sd: bool = False) -> str:
    """List frequencies; of many the first, and how many more there are.

    `sd` sets its standard deviation beside each.
    """
    shown = [
        " ± ".join(words.measured(mode.frequency_hz.value, mode.frequency_hz.sd))
        if sd
        else words.digits(mode.frequency_hz.value, 4)
        for mode in modes[:MOST_LISTED]
    ]
    more = len(modes) - len(shown)
    rest = f" {words('modes.more', n=more)}" if more else ""
    return f"{'; '.join(shown)} Hz{rest}"


def _definition(
    modes: Sequence[Mode], clean: Sequence[Mode], compared: Sequence[Compared], words: Words
) -> str:
    said = []
    if len(clean) > 1:
        said.append(words("modes.lowest", **_estimate(clean[0], words)))
    elif not clean and modes:
        said.append(words("modes.all_doubtful", listed=_listed(modes, words)))
    if compared:
        most = max(compared, key=lambda one: one.share)
        told, at = words.percent(most.share, 2), words.number(most.frequency_hz.value, 4)
        said.append(words("modes.compared", n=len(compared), most=told, at=at))
        alike = [one.mac for one in compared if one.mac is not None]
        if alike:
            said.append(words("modes.least_mac", mac=words.number(min(alike), 2)))
    return " ".join([*said, words("sd")])


def _alternatives(
    result: ModalResult, doubts: Sequence[Sequence[Doubt]], words: Words
) -> Iterator[Alternative]:
    """Give modes that may be something else, then lines of machines."""
    lines = [mode for mode in result.modes if mode.kind != "structural"]
    for rows in alike_groups(result.structural):
        of_group = [result.structural[row] for row in rows]
        yield Alternative(_listed(of_group, words), words("modes.alike"))
    for mode, every in zip(result.structural, doubts, strict=True):
        told = [one.told for one in every if one.cause != "alike"]
        if told:
            hz = f"{words.number(mode.frequency_hz.value, 4)} Hz"
            yield Alternative(hz, ", ".join(told[:MOST_DOUBTS]))
    if lines:
        yield Alternative(_listed(lines, words), words("modes.machine"))


def _weighed(
    result: ModalResult, clean: Sequence[Mode], words: Words, *, ambient: bool
) -> Iterator[str]:
    """Say what speaks against other readings of the usable modes."""
    if not clean:
        return
    # Lines of machines are told from modes in ambient records alone.
    if ambient and len(result.structural) == len(result.modes):
        yield words("modes.weighed_lines")
    if len(clean) > 1 and len(clean[0].shape) > 1:
        pairs = itertools.combinations(clean, 2)
        first, second = max(pairs, key=lambda pair: mac(pair[0].shape, pair[1].shape))
        a, b = (words.number(one.frequency_hz.value, 4) for one in (first, second))
        alike = mac(first.shape, second.shape)
        told = words.localised(f"{alike:.2f}")
        key = next(name for most, name in LIKENESS.items() if alike <= most)
        likeness = words(f"modes.differ_{key}")
        yield words("modes.weighed_shapes", a=a, b=b, likeness=likeness, mac=told)
    # Without models of rising order, quality means something else.
    if len(result.stabilisation.order):
        least = min(clean, key=lambda one: one.quality)
        hz = words.number(least.frequency_hz.value, 4)
        yield words("modes.weighed_seen", hz=hz, share=words.percent(least.quality, 2))
