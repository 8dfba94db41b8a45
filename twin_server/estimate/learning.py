"""The nominal model of a twin, learnt from the first epochs in which its mode was found."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from slowtime.evolution import Nominal, learn_nominal

from .checkpoint import Checkpoint, Epoch, Known

MOST_UNCERTAIN = 0.2
"""Relative sd of a nominal frequency above which learning goes on with newer epochs."""


@dataclasses.dataclass(frozen=True, slots=True)
class Lesson:
    """What some epochs have taught.

    Parameters
    ----------
    checkpoint
        The one to go on with.
    used
        How many of the epochs were needed, or all of them while learning goes on.
    nominal
        What was learnt, once it was.
    """

    checkpoint: Checkpoint
    used: int
    nominal: Nominal | None = None


def learn(checkpoint: Checkpoint, epochs: Sequence[Epoch], wanted: int) -> Lesson:
    """Add epochs to those learnt from, until `wanted` of them with a mode make a model."""
    gathered = list(checkpoint.learning)
    for number, epoch in enumerate(epochs, start=1):
        if not (epoch[0] > 0.0 and epoch[1] >= 0.0):
            continue
        gathered.append(epoch)
        if len(gathered) < wanted:
            continue
        nominal = _nominal(gathered)
        if nominal.frequency_relative_sd <= MOST_UNCERTAIN:
            known = Known(
                nominal.frequency,
                nominal.frequency_relative_sd,
                nominal.damping_ratio,
                nominal.damping_relative_sd,
            )
            done = dataclasses.replace(checkpoint, known=known, learning=())
            return Lesson(done, number, nominal)
        gathered = gathered[wanted // 2 :]
    going_on = dataclasses.replace(checkpoint, learning=tuple(gathered))
    return Lesson(going_on, len(epochs))


def _nominal(epochs: Sequence[Epoch]) -> Nominal:
    frequency, sd, damping, damping_sd = np.array(epochs, dtype=np.float64).T.copy()
    return learn_nominal(frequency, sd, damping, damping_sd)
