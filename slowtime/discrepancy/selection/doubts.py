"""Doubt that what was named is a law near it that the catalogue does not hold."""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.diagnosis import Rival
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.dynamics.effects import Kind

from .many_laws import pieces_of_one

DOUBTED_PROBABILITY = 0.5
"""[probability] Of a law that need do nothing of its own, or that fails elsewhere. Source:
indifference between it and a law near it that is not known."""
MAX_CORRECTION_SHARE = 0.01
"""[share of what was missing] Up to which the second of two curves over one variable only
corrects the first. Source: docs/what_decides.md: half and double change no answer."""


def doubt(hypothesis: Hypothesis, number: int) -> Hypothesis:
    """Hold a law for no likelier than one that is not known."""
    effects = list(hypothesis.effects)
    named = effects[number]
    effects[number] = dataclasses.replace(named, probability=DOUBTED_PROBABILITY)
    rival = Rival(named.effect.kind, named.effect.place, DOUBTED_PROBABILITY)
    return dataclasses.replace(
        hypothesis,
        effects=tuple(effects),
        undecided=(*hypothesis.undecided, rival),
        near_unknown=True,
    )


def doubt_pieces(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> Hypothesis:
    """Hold two curves that share what one place does for no likelier than one unknown curve."""
    missing = hypothesis.first.chi2_in_band - 1
    doubted = hypothesis
    for place in pieces_of_one(hypothesis.effects, kinds):
        there = [n for n, named in enumerate(hypothesis.effects) if named.effect.place == place]
        before = hypothesis.fits[there[-1]].chi2_in_band - 1
        if before > MAX_CORRECTION_SHARE * missing:
            for number in there:
                doubted = doubt(doubted, number)
    return doubted


def doubt_laws(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> Hypothesis:
    """Hold no law for likelier than one that is not known; faults of sensors stand."""
    doubted = hypothesis
    for number, named in enumerate(hypothesis.effects):
        if kinds[named.effect.kind].where in ("element", "node"):
            doubted = doubt(doubted, number)
    return doubted
