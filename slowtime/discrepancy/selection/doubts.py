"""What was found, in; the same, with the doubt that it may be a law near it, not known, out."""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.diagnosis import Rival
from slowtime.discrepancy.state import Found
from slowtime.dynamics.effects import Kind

from .many_laws import pieces_of_one

EITHER = 0.5
"""Chance of a law that need do nothing of its own, or that fails elsewhere: one near it, not
known, is as likely."""
SLIGHTLY = 0.01
"""Share of what was missing up to which the second of two curves over one variable does but
correct the first."""


def doubt(found: Found, number: int) -> None:
    """Hold a law for no likelier than one that is not known."""
    answer = found.answers[number]
    found.near = True
    found.answers[number] = dataclasses.replace(answer, probability=EITHER)
    rival = Rival(answer.effect.kind, answer.effect.place, EITHER)
    found.undecided = (*found.undecided, rival)


def doubt_pieces(found: Found, kinds: Mapping[str, Kind]) -> None:
    """Hold two curves that share what one place does for no likelier than one unknown."""
    first = found.fits[0].chi2_in_band - 1
    for place in pieces_of_one(found.answers, kinds):
        there = [n for n, answer in enumerate(found.answers) if answer.effect.place == place]
        before = found.fits[there[-1]].chi2_in_band - 1
        if before > SLIGHTLY * first:
            for number in there:
                doubt(found, number)


def doubt_laws(found: Found, kinds: Mapping[str, Kind]) -> None:
    """Hold no law for likelier than one that is not known; faults are what they are."""
    for number, answer in enumerate(found.answers):
        if kinds[answer.effect.kind].where in ("element", "node"):
            doubt(found, number)
