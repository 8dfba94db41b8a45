"""A bounded number of training readings, from which normal behaviour is learnt."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from twin_server.registration.nominal import Covariates

from .array_text import pack, unpack

MOST = 1_000
"""Readings that are kept; of a longer span every second, every fourth and so on."""


@dataclasses.dataclass(frozen=True, slots=True)
class Training:
    """Training readings of one frequency.

    Parameters
    ----------
    rows
        Slow time, frequency [Hz] and its sd, damping ratio and its sd, covariates; packed.
    every
        Which of the readings offered are kept: every so many.
    offered
        How many were offered.
    first, last
        Least and greatest slow time of those offered.
    """

    rows: tuple[str, ...] = ()
    every: int = 1
    offered: int = 0
    first: float = np.inf
    last: float = -np.inf

    def added(self, row: Float[np.ndarray, " number"]) -> "Training":
        """Add a reading with all covariates known.

        Parameters
        ----------
        row
            Slow time, then the other numbers of the reading.

        Returns
        -------
        The training with it; beyond `MOST` rows every other one is dropped.
        """
        time = float(row[0])
        first, last = min(self.first, time), max(self.last, time)
        rows, every = self.rows, self.every
        if self.offered % every == 0:
            rows = (*rows, pack(row))
            if len(rows) > MOST:
                rows, every = rows[::2], 2 * every
        return Training(rows, every, self.offered + 1, first, last)

    def is_enough(self, wanted: Covariates) -> bool:
        """Whether the span and the number of readings asked for are there."""
        span = self.last - self.first
        return self.offered >= wanted.train_epochs and 0.0 < span >= wanted.train_span

    def table(self) -> Float[np.ndarray, "reading number"]:
        """Rows as an array."""
        return np.array([unpack(row, -1) for row in self.rows])


def training_of(content: dict[str, Any] | None) -> Training | None:
    """Read a training from the JSON of `dataclasses.asdict`."""
    return None if content is None else Training(**{**content, "rows": tuple(content["rows"])})
