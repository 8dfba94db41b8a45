"""Residuals of all trials in, the noise of every sensor out, whatever else is in them."""

import dataclasses

import numpy as np
import scipy.optimize
from jaxtyping import Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description, assemble
from slowtime.dynamics.modes import undamped_modes

from .colour import Colour, Noise
from .incoherent import incoherent_power

ABOVE = 1.7
"""Times the highest natural frequency: beyond it a structure hardly answers."""

PAINT = 15.0
"""Gain of log likelihood that a colour must bring over white noise, for three more numbers."""

FEWEST_LINES, MOST_LINES = 8, 200
WIDTH = 1.1
"""Ends of a block of lines, last over first, unless that makes it too short or too long."""

SUSPECT, TRUSTED = 0.5, 1e-5
"""Probability that a block of lines holds more than noise, before it is looked at."""
INNOCENT = 1e-200

BOUNDS = ((-14.0, 6.0), (-14.0, 14.0), (-4.0, 4.0))
"""Of the logarithms of both strengths, and of the slope."""

GRID = np.linspace(-4.0, 4.0, 41)
"""Of the logarithm of a strength, about a first guess."""

Blocks = Float[np.ndarray, " block"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Means:
    """Mean density of blocks of lines, over how many lines, and how suspect each is."""

    frequency_hz: Blocks
    power: Blocks
    lines: Blocks
    suspect: Blocks

    def over(self, level: float) -> "Means":
        """Give the same in units of `level`."""
        return dataclasses.replace(self, power=self.power / level)

    def known(self, share: float) -> "Means":
        """Count lines that go together, since a share of the samples made them, as fewer."""
        return dataclasses.replace(self, lines=self.lines * share)


def silent_above(description: Description) -> float:
    """Frequency [Hz] above which a structure is taken to be silent."""
    modes = undamped_modes(assemble(description))
    return ABOVE * float(modes.frequency_hz[-1])


def noise_of_residual(
    trials: tuple[Trial, ...],
    residuals: tuple[Float[np.ndarray, "time sensor"], ...],
    *,
    silent_above_hz: float,
) -> Noise:
    r"""Noise of each sensor in each trial, from residuals that may hold more than noise.

    The mean :math:`m` of a block of :math:`n` lines of the periodogram is of noise alone, or
    of noise with something unknown on top, which can only add:

    .. math:: \log p = \log \left[ (1 - \pi) e^{-n (\log N + m / N)}
              + \pi e^{-n (\log \max(N, m) + m / \max(N, m))} \right] .

    With :math:`\pi = 1/2` where the structure answers, a residual may be as strong as it likes
    there without lifting the floor, but the floor cannot lie above it. The colour is common
    to all trials; its strength is each trial's own.

    Parameters
    ----------
    residuals
        Zero where a sample is not used.
    silent_above_hz
        Frequency above which the structure hardly answers; 0 to trust the residual throughout.
    """
    powers = [
        incoherent_power(residual, trial.inputs, trial.rate_hz)
        for trial, residual in zip(trials, residuals, strict=True)
    ]
    found = []
    for sensor in range(trials[0].outputs.shape[1]):
        kept = [max(float(trial.used[:, sensor].mean()), 0.05) for trial in trials]
        means = [
            block_means(frequency, power[:, sensor] / share, silent_above_hz).known(share)
            for (frequency, power), share in zip(powers, kept, strict=True)
        ]
        found.append(fit_colours(means))
    by_trial = tuple(zip(*found, strict=True))
    return Noise(
        colours=tuple(tuple(colour for colour, _ in row) for row in by_trial),
        relative_sd=tuple(tuple(error for _, error in row) for row in by_trial),
    )


def block_means(
    frequency_hz: Float[np.ndarray, " frequency"],
    power: Float[np.ndarray, " frequency"],
    silent_above_hz: float,
) -> Means:
    """Average lines over blocks of constant relative width."""
    edges = [0]
    while edges[-1] < len(power):
        first = edges[-1]
        wide = np.searchsorted(frequency_hz, frequency_hz[first] * WIDTH) - first
        edges.append(first + int(np.clip(wide, FEWEST_LINES, MOST_LINES)))
    edges[-1] = len(power)
    if len(edges) > 2 and edges[-1] - edges[-2] < FEWEST_LINES:
        del edges[-2]
    starts, lines = np.array(edges[:-1]), np.diff(edges).astype(float)
    centre = np.add.reduceat(frequency_hz, starts) / lines
    silent = centre > silent_above_hz
    if lines[silent].sum() < 4 * FEWEST_LINES:
        silent = centre > frequency_hz[-1] / 2
    return Means(
        centre,
        np.add.reduceat(power, starts) / lines,
        lines,
        np.where(silent, TRUSTED, SUSPECT),
    )


def fit_colours(means: list[Means]) -> list[tuple[Colour, float]]:
    """Colour of all trials together, at the strength of each, with its relative sd."""
    white = Colour(white=1.0)
    levels = [_strength(one, white)[0] for one in means]
    scaled = [one.over(level) for one, level in zip(means, levels, strict=True)]
    whole = Means(
        *(
            np.concatenate([getattr(one, field.name) for one in scaled])
            for field in dataclasses.fields(Means)
        )
    )
    colour = _colour(whole)
    found = []
    for one in means:
        level, error = _strength(one, colour)
        found.append((colour.scaled(level), error))
    return found


def _strength(means: Means, colour: Colour) -> tuple[float, float]:
    """Factor on a colour that fits the means, and its relative standard deviation."""
    relative = dataclasses.replace(
        means, power=np.maximum(means.power, 1e-300) / colour.density(means.frequency_hz)
    )
    trusted = relative.suspect < SUSPECT
    centre = float(np.log(np.median(relative.power[trusted])))

    one = np.ones(len(relative.power))

    def cost(log_level: float) -> float:
        return -float(_mixed(relative, np.exp(log_level) * one)[0].sum())

    grid = centre + GRID
    nearest = grid[int(np.argmin([cost(level) for level in grid]))]
    step = float(GRID[1] - GRID[0])
    found = scipy.optimize.minimize_scalar(
        cost,
        bounds=(nearest - step, nearest + step),
        method="bounded",
        options={"xatol": 1e-5},
    )
    level = float(np.exp(found.x))
    clean = _mixed(relative, level * one)[1]
    return level, float(1 / np.sqrt(max(clean @ relative.lines, 1.0)))


def _colour(means: Means) -> Colour:
    """White unless a colour is much better."""
    best = Colour(white=1.0)
    least = _score(means, best) + PAINT
    for slope, corner in ((2.0, 0.1), (1.0, 0.01), (4.0, 0.2), (-2.0, 0.5)):
        colour = _painted(means, slope, corner * float(means.frequency_hz[-1]))
        score = _score(means, colour)
        if score > least:
            best, least = colour, score
    return best


def _painted(means: Means, slope: float, corner_hz: float) -> Colour:
    """Climb to the colour of greatest likelihood."""
    span = (np.log(means.frequency_hz[0] / 2), np.log(4 * means.frequency_hz[-1]))
    at = np.array([-1.0, 0.0, np.log(corner_hz), slope])
    # First without suspicion of the silent band: a block dismissed there pulls no more.
    innocent = np.where(means.suspect < SUSPECT, INNOCENT, means.suspect)
    for seen in (dataclasses.replace(means, suspect=innocent), means):
        found = scipy.optimize.minimize(
            _misfit,
            at,
            (seen,),
            jac=True,
            method="L-BFGS-B",
            bounds=[BOUNDS[0], BOUNDS[1], span, BOUNDS[2]],
            options={"maxiter": 200},
        )
        at = found.x
    return _of(at)


def _of(at: Float[np.ndarray, "4"]) -> Colour:
    return Colour(
        white=float(np.exp(at[0])),
        low=float(np.exp(at[1])),
        corner_hz=float(np.exp(at[2])),
        slope=float(at[3]),
    )


def _score(means: Means, colour: Colour) -> float:
    return float(_mixed(means, colour.density(means.frequency_hz))[0].sum())


def _mixed(means: Means, density: Blocks) -> tuple[Blocks, Blocks]:
    """Log likelihood of each block, and its probability to be noise alone."""
    noise = -means.lines * (np.log(density) + means.power / density)
    more = np.maximum(density, means.power)
    above = -means.lines * (np.log(more) + means.power / more)
    one, other = np.log1p(-means.suspect) + noise, np.log(means.suspect) + above
    total = np.logaddexp(one, other)
    return total, np.exp(one - total)


def _misfit(at: Float[np.ndarray, "4"], means: Means) -> tuple[float, Float[np.ndarray, "4"]]:
    """Minus the log likelihood, and its gradient."""
    white, low, corner, slope = np.exp(at[0]), np.exp(at[1]), np.exp(at[2]), at[3]
    squared = (means.frequency_hz / corner) ** 2
    ratio = np.log1p(squared)
    part = low * np.exp(-slope / 2 * ratio)
    density = white + part
    value, clean = _mixed(means, density)
    held = np.where(means.power > density, clean, 1.0)
    pull = held * means.lines * (1 - means.power / density) / density
    gradient = np.array(
        [
            white * pull.sum(),
            pull @ part,
            pull @ (part * slope * squared / (1 + squared)),
            -pull @ (part * ratio) / 2,
        ]
    )
    return -float(value.sum()), gradient
