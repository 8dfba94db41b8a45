"""Notices of members that comparisons with the reference period have found to have changed."""

from collections.abc import Sequence
from typing import Any

from .elements import EpochEstimate
from .elements.memory import ChangeSuspicion
from .notices import Notice

UNDECIDED = "member not told"
"""Stands in memory for a change whose members are not told."""


def follow_assessments(
    suspicions: Sequence[ChangeSuspicion], readings: Sequence[EpochEstimate]
) -> tuple[tuple[ChangeSuspicion, ...], list[Notice]]:
    """Make a notice of each change that begins or ends.

    A change is new where none of the members that may have made it was named in the comparison
    before, so that a set that grows or shrinks from one comparison to the next raises no new
    notice.

    Parameters
    ----------
    suspicions
        What was told before.
    readings
        With the latest comparison of each.

    Returns
    -------
    What is told now, and the notices.
    """
    held, notices = [one.word for one in suspicions], []
    before: dict[str, Any] | None = None
    for row, reading in enumerate(readings):
        told = reading.assessed
        if told is None or told is before:
            continue
        before = told
        words = [one.word for one in reading.suspects]
        if told["verdict"] == "undecided":
            words = [UNDECIDED]
        elif told["verdict"] == "not comparable":
            words = held
        notices += [
            _changed(row, reading, word, told)
            for word in words
            if not any(_overlap(word, known) for known in held)
        ]
        notices += [_gone(row, word, told) for word in held if not words]
        held = words
    return tuple(ChangeSuspicion(word, holds=True) for word in held), notices


def _overlap(word: str, other: str) -> bool:
    return bool({*word.split(" or ")} & {*other.split(" or ")})


def _changed(row: int, reading: EpochEstimate, word: str, told: dict[str, Any]) -> Notice:
    details: dict[str, Any] = {"suspect": word, "assessment": told}
    if word == UNDECIDED:
        said = "The modes have changed, but it cannot be told in which member."
        return Notice(row, "element_changed", "warning", said, details)
    (suspect,) = (one for one in reading.suspects if one.word == word)
    details |= {"sizes": list(suspect.sizes)}
    return Notice(row, "element_changed", "warning", suspect.sentence, details)


def _gone(row: int, word: str, told: dict[str, Any]) -> Notice:
    named = "modes" if word == UNDECIDED else word
    details: dict[str, Any] = {"suspect": word, "assessment": told}
    said = f"{named}: no change is seen any more."
    return Notice(row, "element_restored", "info", said, details)
