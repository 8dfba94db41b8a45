"""Learns the nominal model of a twin from the first epochs in which its mode was found."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from slowtime.evolution import NominalOscillator, learn_nominal
from twin_server.estimate.checkpoint import Checkpoint, Epoch, NominalInUse

MOST_UNCERTAIN = 0.2
"""Relative sd of a nominal frequency above which learning goes on with newer epochs."""


@dataclasses.dataclass(frozen=True, slots=True)
class LearntEpochs:
    """Epochs that were learnt from, and the nominal model where they suffice.

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
    nominal: NominalOscillator | None = None


def learn(checkpoint: Checkpoint, epochs: Sequence[Epoch], wanted: int) -> LearntEpochs:
    """Add epochs to those learnt from, until `wanted` of them with a mode make a model."""
    gathered = list(checkpoint.learning)
    for number, epoch in enumerate(epochs, start=1):
        if not is_sane(epoch[0], epoch[1]):
            continue
        damping = epoch[2:] if is_sane(epoch[2], epoch[3]) else (math.nan, math.nan)
        gathered.append((epoch[0], epoch[1], *damping))
        if len(gathered) < wanted:
            continue
        nominal = _nominal(gathered)
        if nominal.frequency_relative_sd <= MOST_UNCERTAIN:
            known = NominalInUse(
                nominal.frequency,
                nominal.frequency_relative_sd,
                nominal.damping_ratio,
                nominal.damping_relative_sd,
            )
            done = dataclasses.replace(checkpoint, known=known, learning=())
            return LearntEpochs(done, number, nominal)
        gathered = gathered[wanted // 2 :]
    going_on = dataclasses.replace(checkpoint, learning=tuple(gathered))
    return LearntEpochs(going_on, len(epochs))


def is_sane(value: float, sd: float) -> bool:
    """Whether squares and weights of these stay within the range of floats.

    Parameters
    ----------
    value
        A frequency [Hz] or a damping ratio [1].
    sd
        Its standard deviation, in the same unit.
    """
    return 1e-9 < value < 1e9 and 0.0 <= sd < 1e3 * value


def _nominal(epochs: Sequence[Epoch]) -> NominalOscillator:
    frequency, sd, damping, damping_sd = np.array(epochs, dtype=np.float64).T.copy()
    return learn_nominal(frequency, sd, damping, damping_sd)
