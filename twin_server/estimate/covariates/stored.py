"""Stored forms of the learnt normal behaviour of a frequency, and of its watch."""

import dataclasses
import functools
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.evolution.covariates import Basis, NormalModel, WatchState
from slowtime.evolution.covariates.change_onset import Onsets
from slowtime.evolution.covariates.filter import CovariateBelief
from slowtime.evolution.covariates.monitor import HeldReading
from slowtime.evolution.covariates.residual_process import ResidualProcess

from .array_text import pack, unpack


@dataclasses.dataclass(frozen=True, slots=True)
class StoredNormal:
    """`slowtime.evolution.covariates.NormalModel` without its candidates; arrays are packed."""

    law: Any
    low: str
    high: str
    spread: float
    hinge: int
    bend: float
    length: float
    sd: float
    memory: float
    wander_sd: float
    noise: float
    centre: float
    time: float
    mean: str
    covariance: str
    rejected: int

    @classmethod
    def of(cls, normal: NormalModel) -> "StoredNormal":
        """Write it."""
        basis, wander, belief = normal.basis, normal.wander, normal.belief
        return cls(
            basis.law,
            pack(basis.low),
            pack(basis.high),
            basis.spread,
            basis.hinge,
            basis.bend,
            basis.length,
            basis.sd,
            wander.memory,
            wander.sd,
            wander.noise,
            normal.centre,
            belief.time,
            pack(belief.mean),
            pack(belief.covariance),
            normal.rejected,
        )

    def read(self) -> NormalModel:
        """Make it work again."""
        return _normal(self)


@functools.lru_cache(maxsize=256)
def _normal(kept: StoredNormal) -> NormalModel:
    basis = Basis(
        law=kept.law,
        low=unpack(kept.low, -1),
        high=unpack(kept.high, -1),
        spread=kept.spread,
        hinge=kept.hinge,
        bend=kept.bend,
        length=kept.length,
        sd=kept.sd,
    )
    belief = _belief(kept.time, kept.mean, kept.covariance)
    wander = ResidualProcess(kept.memory, kept.wander_sd, kept.noise)
    return NormalModel(basis, wander, kept.centre, belief, (), kept.rejected)


@dataclasses.dataclass(frozen=True, slots=True)
class StoredWatch:
    """`slowtime.evolution.covariates.WatchState`; arrays are packed.

    A watch goes on from here after each reading, so that it makes no difference whether it was
    written to disk in between.
    """

    time: float
    mean: str
    covariance: str
    onsets: str
    response: str
    held: tuple[str, ...] = ()

    @classmethod
    def of(cls, state: WatchState) -> "StoredWatch":
        """Write it."""
        belief, bets = state.belief, state.onsets
        numbers = np.array([bets.time, bets.log_capital, bets.score, bets.information])
        return cls(
            belief.time,
            pack(belief.mean),
            pack(belief.covariance),
            pack(numbers),
            pack(bets.response),
            tuple(
                pack(np.array([h.time, h.value, h.sd, h.side, *h.features])) for h in state.held
            ),
        )

    def read(self) -> WatchState:
        """Make it work again."""
        belief = _belief(self.time, self.mean, self.covariance)
        numbers = unpack(self.onsets, 4, -1)
        response = unpack(self.response, numbers.shape[1], len(belief.mean))
        rows = [unpack(row, -1) for row in self.held]
        return WatchState(
            belief,
            Onsets(numbers[0], numbers[1], numbers[2], numbers[3], response),
            tuple(
                HeldReading(float(row[0]), float(row[1]), float(row[2]), row[4:], float(row[3]))
                for row in rows
            ),
        )


def _belief(time: float, mean: str, covariance: str) -> CovariateBelief:
    numbers: Float[np.ndarray, " state"] = unpack(mean, -1)
    return CovariateBelief(time, numbers, unpack(covariance, len(numbers), len(numbers)))
