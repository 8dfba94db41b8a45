"""Residuals of all trials in, the noise of every sensor out, whatever else is in them."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.optimize
import scipy.stats
from jaxtyping import Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description, assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.signals.spectra import detrended, periodogram

from .colour import Colour, Noise
from .fisher_scoring import FALLING, HUMPED, WIDEST, climbed
from .incoherent import incoherent_power

ABOVE = 1.7
"""Times the highest natural frequency: beyond it a structure hardly answers."""

PAINT = 15.0
"""Gain of log likelihood that a colour must bring over white noise, for three more numbers."""

FEWEST_LINES, MOST_LINES = 8, 200
WIDTH = 1.1
"""Ends of a block of lines, last over first, unless that makes it too short or too long."""

SUSPECT, TRUSTED = 0.99, 1e-5
"""Probability that a block of lines holds more than noise, before it is looked at."""
INNOCENT = 1e-200

NO_NOISE = 1e-3
"""Chance at which a residual that is noise alone is still suspected of more."""

STRENGTHS, SLOPES = ((-14.0, 6.0), (-14.0, 14.0)), (-4.0, 4.0)
"""Bounds of the logarithms of both strengths, and of the slope."""
ODDS, ANGLES = (-1.0, 6.0), (0.01, 3.13)
"""The same of a hump: of the odds of its radius, and of its angle."""

GRID = np.linspace(-4.0, 4.0, 41)
"""Of the logarithm of a strength, about a first guess."""

FEWEST_PERIODS = 4.0
"""Periods of a mode in a record below which it is no vibration."""

MOST_POWER = 0.98

WHITER = np.logspace(0, -8, 81)
"""White parts tried of a colour that rises, against its density at the highest line."""
SPARED = 1.0
"""Log likelihood that a whiter colour may cost."""

SPARKS = 0.15
"""Share of the blocks of a silent band that may hold tones."""

LEAST = 0.05
"""Share of samples below which a channel counts as if it had so many."""
BEST = 1e-5
"""Noise of the best sensor there is over the scatter of what it measures: 100 dB."""
UNHEARD, DEAF = 1e-6, 1e12
"""What a channel without any sample counts by, and the density of its noise."""

# Shapes are checked at the door, not in what is called ten thousand times.
Blocks = np.ndarray[Any, np.dtype[np.float64]]
At = np.ndarray[Any, np.dtype[np.float64]]
Power = tuple[
    Float[np.ndarray, " frequency"],
    Float[np.ndarray, "frequency sensor"],
    Float[np.ndarray, " sensor"],
]


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


def silent_above(description: Description, trials: Sequence[Trial] = ()) -> float:
    """Frequency [Hz] above which a structure is taken to be silent.

    That of its modes; of a structure that floats, and has none, that of what drives it in the
    `trials`.
    """
    highest = float(undamped_modes(assemble(description)).frequency_hz[-1])
    for trial in trials:
        if highest * trial.duration_s < FEWEST_PERIODS:
            highest = max(highest, _driven_to(trial))
    return ABOVE * highest


def _driven_to(trial: Trial) -> float:
    """Frequency below which nearly all power of inputs lies; of outputs, where there is none.

    0 where nothing was heard either.
    """
    series = trial.inputs if np.ptp(trial.inputs, axis=0).any() else trial.measured
    spectrum = periodogram(detrended(series), trial.rate_hz)
    power = spectrum.density / np.maximum(spectrum.density.sum(axis=0), 1e-300)
    if not power.any():
        return 0.0
    below = np.cumsum(power.sum(axis=1)) / float(power.sum())
    return float(spectrum.frequency_hz[int(np.searchsorted(below, MOST_POWER))])


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

    With :math:`\pi \approx 1` where the structure answers, a residual may be as strong as it
    likes there without lifting the floor, but the floor cannot lie above it. The colour is of
    all trials; its strength is each trial's own. Where one law of noise fits the whole
    residual of a sensor to within its scatter, or one for each trial does, nothing is
    suspected, and the noise is that law.

    Parameters
    ----------
    residuals
        Zero where a sample is not used.
    silent_above_hz
        Frequency above which the structure hardly answers; 0 to trust the residual throughout.
    """
    powers = []
    for trial, residual in zip(trials, residuals, strict=True):
        frequency, power, spare = incoherent_power(
            residual, trial.inputs, trial.rate_hz, trial.used
        )
        share = np.maximum(trial.used.mean(axis=0), LEAST)
        # A sensor that says nothing in a trial is all noise there, and counts for nothing.
        heard = trial.used.any(axis=0)
        known = np.where(heard, share * spare, UNHEARD)
        powers.append((frequency, np.where(heard, power / share, DEAF), known))
    noise = noise_of_power(powers, rate_hz=trials[0].rate_hz, silent_above_hz=silent_above_hz)
    return no_better(noise, trials)


def no_better(noise: Noise, trials: Sequence[Trial]) -> Noise:
    """Add the noise of the best sensor there is: what was smoothed afterwards seems quieter."""
    colours = []
    for row, trial in zip(noise.colours, trials, strict=True):
        least = (BEST * trial.measured.std(axis=0)) ** 2 / (trial.rate_hz / 2)
        colours.append(
            tuple(
                dataclasses.replace(colour, white=colour.white + float(more))
                for colour, more in zip(row, least, strict=True)
            )
        )
    return dataclasses.replace(noise, colours=tuple(colours))


def noise_of_power(powers: Sequence[Power], *, rate_hz: float, silent_above_hz: float) -> Noise:
    """Estimate noise from spectra that may hold more than noise: see `noise_of_residual`.

    Parameters
    ----------
    powers
        By trial: frequencies, density of each sensor, and which share of the lines of each
        sensor is independent of the others.
    rate_hz
        Sampling rate, for colours with a hump.
    """
    found, believed = [], []
    for sensor in range(powers[0][1].shape[1]):
        means = [
            block_means(frequency, power[:, sensor], silent_above_hz).known(share[sensor])
            for frequency, power, share in powers
        ]
        plain = [
            dataclasses.replace(m, suspect=np.full_like(m.suspect, TRUSTED)) for m in means
        ]
        trusted = own_colours(plain, rate_hz)
        believed.append(passes_for_noise(plain, [colour for colour, _ in trusted]))
        doubtless = believed[-1] or silent_above_hz == 0
        found.append(trusted if doubtless else fit_colours(means, rate_hz))
    by_trial = tuple(zip(*found, strict=True))
    return Noise(
        colours=tuple(tuple(colour for colour, _ in row) for row in by_trial),
        relative_sd=tuple(tuple(error for _, error in row) for row in by_trial),
        alone=tuple(believed),
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


def passes_for_noise(means: Sequence[Means], colours: Sequence[Colour]) -> bool:
    """Whether blocks that are not suspect scatter about the colours as noise does.

    Twice the deficit of log likelihood is close to chi squared with a degree for each block.
    Where some blocks are suspect, a few of the others may be so too: of tones.
    """
    deficit, blocks = 0.0, 0
    for one, colour in zip(means, colours, strict=True):
        seen = one.suspect < SUSPECT
        clean = _mixed(one, colour.density(one.frequency_hz))[1] > 0.5
        if not seen.all() and np.mean(clean[seen]) > 1 - SPARKS:
            seen = seen & clean
        relative = np.maximum(one.power / colour.density(one.frequency_hz), 1e-300)[seen]
        deficit += float(2 * one.lines[seen] @ (relative - 1 - np.log(relative)))
        blocks += len(relative)
    return bool(scipy.stats.chi2.sf(deficit, blocks) > NO_NOISE)


def own_colours(means: Sequence[Means], rate_hz: float) -> list[tuple[Colour, float]]:
    """Colour of all trials together; of each by itself where only such pass for noise."""
    common = fit_colours(means, rate_hz)
    if len(means) == 1 or passes_for_noise(means, [colour for colour, _ in common]):
        return common
    own = [fit_colours([one], rate_hz)[0] for one in means]
    return own if passes_for_noise(means, [colour for colour, _ in own]) else common


def fit_colours(means: Sequence[Means], rate_hz: float) -> list[tuple[Colour, float]]:
    """Colour of all trials together, at the strength of each, with its relative sd."""
    white = Colour(white=1.0)
    plain = [_strength(one, white) for one in means]
    found = [(white.scaled(level), error) for level, error in plain]
    if passes_for_noise(means, [colour for colour, _ in found]):
        return found
    scaled = [one.over(level) for one, (level, _) in zip(means, plain, strict=True)]
    whole = Means(
        *(
            np.concatenate([getattr(one, field.name) for one in scaled])
            for field in dataclasses.fields(Means)
        )
    )
    colour = _colour(whole, rate_hz)
    strengths = [_strength(one, colour) for one in means]
    return [(colour.scaled(level), error) for level, error in strengths]


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
    nearest = float(grid[int(np.argmin([cost(float(level)) for level in grid]))])
    step = float(GRID[1] - GRID[0])
    found = scipy.optimize.minimize_scalar(
        cost,
        bounds=(nearest - step, nearest + step),
        method="bounded",
        options={"xatol": 1e-5},
    )
    level = float(np.exp(found.x))
    clean = _mixed(relative, level * one)[1]
    known = float(clean @ relative.lines)
    return level, 1 / math.sqrt(known if known > 1 else 1.0)


def _colour(means: Means, rate_hz: float) -> Colour:
    """White unless a colour is much better; the first that passes for noise is taken."""
    best = Colour(white=1.0)
    least = _score(means, best) + PAINT
    top = float(means.frequency_hz[-1])
    falling = [
        (FALLING, [-1.0, 0.0, np.log(corner * top), slope])
        for slope, corner in ((2.0, 0.1), (-2.0, 0.5), (1.0, 0.01))
    ]
    humped = [(HUMPED, [-1.0, 0.0, 2.0, turn * np.pi]) for turn in (0.1, 0.3, 0.6)]
    for family, at in falling + humped:
        colour = _painted(means, family, np.array(at), rate_hz)
        score = _score(means, colour)
        if score > least:
            best, least = colour, score
            if passes_for_noise([means], [colour]):
                break
    return _no_quieter(means, best)


def _no_quieter(means: Means, colour: Colour) -> Colour:
    """Raise the white part of a colour that rises as far as nothing speaks against it.

    What rises above the structure's answers says nothing of how quiet it is among them.
    """
    ends = colour.density(means.frequency_hz[[0, -1]])
    if ends[0] >= ends[1]:
        return colour
    least = _score(means, colour) - SPARED
    for white in float(ends[1]) * WHITER:
        raised = dataclasses.replace(colour, white=float(white))
        if white > colour.white and _score(means, raised) > least:
            return raised
    return colour


def _colour_at(at: At, family: int, rate_hz: float) -> Colour:
    """Colour by the numbers that are climbed along: see `climb`."""
    white, low = np.exp(at[:2]).tolist()
    if family == FALLING:
        return Colour(white=white, low=low, corner_hz=float(np.exp(at[2])), slope=float(at[3]))
    radius = float(WIDEST / (1 + np.exp(-at[2])))
    return Colour(white=white, low=low, radius=radius, angle=float(at[3]), rate_hz=rate_hz)


def _painted(means: Means, family: int, at: At, rate_hz: float) -> Colour:
    """Climb to the colour of greatest likelihood."""
    lowest, top = float(means.frequency_hz[0]), float(means.frequency_hz[-1])
    corners = (np.log(lowest / 2), np.log(4 * top))
    own = (corners, SLOPES) if family == FALLING else (ODDS, ANGLES)
    low, high = np.array([*STRENGTHS, *own], dtype=float).T.copy()
    # First without suspicion of the silent band: a block dismissed there pulls no more.
    innocent = np.where(means.suspect < SUSPECT, INNOCENT, means.suspect)
    for suspect in (innocent, means.suspect):
        odds = np.log1p(-suspect), np.log(suspect)
        blocks = np.stack([means.frequency_hz, means.power, means.lines, *odds])
        at = climbed(blocks, at, low, high, family, rate_hz)
    return _colour_at(at, family, rate_hz)


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
