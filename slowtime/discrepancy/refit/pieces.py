"""Records cut into pieces, each with a first state of its own: shooting several times.

The error of a long free run has a minimum for every beat by which it may be out of step, and
where motion is chaotic it has countless. Over a few periods there is one. So a law that is not
yet well known is fitted to pieces (Bock's multiple shooting, the pieces left apart), and from
there to the whole.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.floor import Noise
from slowtime.discrepancy.records import FEWEST, Trial
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.plant import Plant

from .fit import Fit, refit

PERIODS = 3.0
"""Longest periods that a piece lasts."""
RIGID = 1e-6
"""Share of the highest natural frequency below which a motion is no vibration."""

State = Float[np.ndarray, " state"]


def shot(
    plant: Plant,
    trials: Sequence[Trial],
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    late: Callable[[], bool] | None = None,
) -> tuple[Fit, list[State]]:
    """Fit pieces of records; give that fit, and the first state of each record.

    Parameters
    ----------
    noise
        Of the records.
    values
        To start from.
    late
        Once true, `GivenUp` is raised.
    """
    cut, origin = pieces(plant, trials)
    own = Noise(
        colours=tuple(noise.colours[i] for i in origin),
        relative_sd=tuple(noise.relative_sd[i] for i in origin),
    )
    starts = _followed(plant, cut, origin, own, values)
    found = refit(
        plant, cut, noise=own, values=values, states=starts, horizons=(1.0,), late=late
    )
    return found, [found.states[origin.index(i)] for i in range(len(trials))]


def pieces(plant: Plant, trials: Sequence[Trial]) -> tuple[tuple[Trial, ...], tuple[int, ...]]:
    """Cut records into parts of a few periods, and tell which record each is of."""
    lowest = slowest_hz(plant)
    cut, origin = [], []
    for number, trial in enumerate(trials):
        samples = len(trial.outputs)
        least = max(int(PERIODS / lowest * trial.rate_hz), FEWEST) if lowest else samples
        edges = np.linspace(0, samples, max(samples // least, 1) + 1).astype(int).tolist()
        for first, last in itertools.pairwise(edges):
            cut.append(trial.part(first, last))
            origin.append(number)
    return tuple(cut), tuple(origin)


def slowest_hz(plant: Plant) -> float:
    """Lowest frequency of a vibration; 0 of a structure that floats and has none."""
    frequency = undamped_modes(assemble(plant.description)).frequency_hz
    own = frequency[frequency > RIGID * frequency[-1]]
    return float(own[0]) if len(own) else 0.0


def _followed(
    plant: Plant,
    cut: Sequence[Trial],
    origin: Sequence[int],
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
) -> list[State]:
    """Go through each record piece by piece: each starts where the last, corrected, has led."""
    found: list[State] = []
    for number, piece in enumerate(cut):
        new = number == 0 or origin[number] != origin[number - 1]
        state = np.zeros(0) if new else found[-1]
        if not new:
            before = cut[number - 1]
            state = plant.run(
                values,
                np.concatenate([before.inputs, piece.inputs[:1]]),
                before.rate_hz,
                state0=state,
                start_s=before.start_s,
            ).states[-1]
        own = Noise(colours=(noise.colours[number],), relative_sd=(noise.relative_sd[number],))
        if not np.isfinite(state).all():
            state = np.zeros(0)
        told = refit(
            plant, (piece,), free=[], noise=own, values=values, states=(state,),
            horizons=(1.0,),
        )  # fmt: skip
        found.append(told.states[0])
    return found
