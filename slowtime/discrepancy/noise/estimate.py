"""Estimation of sensor noise from residuals that hold more than noise."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.optimize
import scipy.special
from jaxtyping import Float

from slowtime.discrepancy.free_decay.records import is_free_decay
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description, assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.signals.spectra import detrended, periodogram

from .colour import Colour, Noise
from .fisher_scoring import MAX_POLE_RADIUS, POLE_PAIR, POWER_LAW, maximise_likelihood
from .incoherent_power import incoherent_power


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class NoiseThresholds:
    """Thresholds of the noise estimate, each with its unit, meaning and source."""

    response_margin: float = 1.7
    """[1] Times the highest natural frequency above which a structure hardly answers. Source: a
    mode answers there with half of its static response; half and double change no answer of
    docs/what_decides.md."""
    colour_gain: float = 15.0
    """[nats] Gain of log likelihood that a coloured density must bring over a white one, for
    three more parameters. Source: Schwarz's criterion would ask for 7 at a hundred blocks; half
    and double change no answer of docs/what_decides.md."""
    min_block_lines: int = 8
    """[lines] Of the periodogram in one block at least. Source: docs/what_decides.md: half and
    double change no answer."""
    max_block_lines: int = 200
    """[lines] Of the periodogram in one block at most. Source: docs/what_decides.md: half and
    double change no answer."""
    block_ratio: float = 1.1
    """[1] Last frequency of a block over its first, within the limits of its lines. Source:
    docs/what_decides.md: half and double change no answer."""
    signal_probability: float = 0.99
    """[probability] That a block where the structure answers holds more than noise, before it
    is looked at. Source: docs/what_decides.md: half and double change no answer."""
    tone_probability: float = 1e-5
    """[probability] The same of a block where the structure is silent: a tone of the mains.
    Source: docs/what_decides.md: half and double change no answer."""
    no_signal_probability: float = 1e-200
    """[probability] The same in the first pass of a fit, in which no silent block is
    dismissed. Source: so small that no block is, and above the least number of double
    precision."""
    noise_only_p_value: float = 1e-3
    """[probability] p-value below which a residual that is noise alone is suspected of more.
    Source: one false alarm in a thousand sensors."""
    silent_ratio: float = 2.0
    """[1] Times the frequency above which the structure hardly answers, where the density is
    that of noise alone. Source: an octave; half and double change no answer of
    docs/what_decides.md."""
    min_periods: float = 4.0
    """[periods] Of a mode in a record below which it is no vibration. Source:
    docs/what_decides.md: half and double change no answer."""
    band_power: float = 0.98
    """[share of power] Of what drives a floating structure that lies in its band. Source:
    docs/what_decides.md: half and double change no answer."""
    white_part_loss: float = 1.0
    """[nats] Log likelihood that a larger white part of a rising colour may cost. Source:
    docs/decisions/0027; what rises with frequency says nothing of the noise below."""
    tonal_share: float = 0.15
    """[share of blocks] Of a silent band that may hold tones. Source: docs/what_decides.md:
    half and double change no answer."""
    min_used_share: float = 0.05
    """[share of samples] By which a channel with fewer used samples counts. Source:
    docs/what_decides.md: half and double change no answer."""
    instrument_floor: float = 1e-4
    """[standard deviations of the reading] Below which a difference between a record and a
    simulation says nothing. Source: 80 dB; no transducer is linear to better than 0.01 %, and
    simulated records differ by as much with the integrator and the input between samples."""


THRESHOLDS = NoiseThresholds()

LOG_STRENGTH_BOUNDS = ((-14.0, 6.0), (-14.0, 14.0))
"""[log of the mean density] Bounds of the white and of the coloured part. Source: six decades
below the mean density to well above it; half and double change no answer of
docs/what_decides.md."""
SLOPE_BOUNDS = (-4.0, 4.0)
"""[1] Bounds of the exponent of a power law. Source: noise integrated or differentiated
twice has slopes of 4 and -4."""
RADIUS_LOGIT_BOUNDS = (-1.0, 6.0)
"""[log odds] Bounds of the radius of a pole pair, over `MAX_POLE_RADIUS`. Source:
docs/what_decides.md: half and double change no answer."""
ANGLE_BOUNDS = (0.01, 3.13)
"""[rad] Bounds of the angle of a pole pair. Source: just inside 0 and pi, where the pair
becomes a double real pole."""

STRENGTH_GRID = np.linspace(-4.0, 4.0, 41)
"""[log of the density] Offsets from a first guess at which a strength is tried before it is
refined. Source: factors of 55 either way in steps of 22 %."""

WHITE_PART_GRID = np.logspace(0, -8, 81)
"""[share of the density at the highest line] White parts tried of a colour that rises.
Source: ten per decade, over the dynamic range of a recorder."""

UNMEASURED_WEIGHT = 1e-6
"""[share of the lines] By which a channel without any used sample counts. Source: small
beside one line of one record, yet not zero."""
UNMEASURED_DENSITY = 1e12
"""[unit²/Hz] Density of the noise of a channel without any used sample. Source: so large
that the channel weighs nothing in any fit."""

# Shapes are checked at the door, not in what is called ten thousand times.
Blocks = np.ndarray[Any, np.dtype[np.float64]]
At = np.ndarray[Any, np.dtype[np.float64]]
Power = tuple[
    Float[np.ndarray, " frequency"],
    Float[np.ndarray, "frequency sensor"],
    Float[np.ndarray, " sensor"],
]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BlockMeans:
    """Mean densities over blocks of lines.

    Parameters
    ----------
    lines
        Independent lines in each block.
    signal_probability
        Probability, beforehand, that a block holds more than noise.
    """

    frequency_hz: Blocks
    power: Blocks
    lines: Blocks
    signal_probability: Blocks

    def relative_to(self, level: float) -> "BlockMeans":
        """Divide the densities by a level."""
        return dataclasses.replace(self, power=self.power / level)

    def with_independent_share(self, share: float) -> "BlockMeans":
        """Multiply the lines by the share of them that is independent."""
        return dataclasses.replace(self, lines=self.lines * share)


def response_limit_hz(description: Description, trials: Sequence[Trial] = ()) -> float:
    """Frequency [Hz] above which the response of a structure is negligible."""
    highest = float(undamped_modes(assemble(description)).frequency_hz[-1])
    for trial in trials:
        if highest * trial.duration_s < THRESHOLDS.min_periods:
            highest = max(highest, _excitation_limit_hz(trial))
    return THRESHOLDS.response_margin * highest


def _excitation_limit_hz(trial: Trial) -> float:
    """Frequency [Hz] below which nearly all power of inputs lies, or else of outputs."""
    series = trial.inputs if np.ptp(trial.inputs, axis=0).any() else trial.measured
    spectrum = periodogram(detrended(series), trial.rate_hz)
    power = spectrum.density / np.maximum(spectrum.density.sum(axis=0), 1e-300)
    if not power.any():
        return 0.0
    below = np.cumsum(power.sum(axis=1)) / float(power.sum())
    return float(spectrum.frequency_hz[int(np.searchsorted(below, THRESHOLDS.band_power))])


def estimate_noise(
    trials: tuple[Trial, ...],
    residuals: tuple[Float[np.ndarray, "time sensor"], ...],
    *,
    silent_above_hz: float,
    lacking: bool = False,
) -> Noise:
    r"""Estimate the noise of each sensor from residuals that hold more than noise.

    The mean :math:`m` of a block of :math:`n` lines of the periodogram is of noise alone, or
    of noise with something unknown on top, which can only add:

    .. math:: \log p = \log \left[ (1 - \pi) e^{-n (\log N + m / N)}
              + \pi e^{-n (\log \max(N, m) + m / \max(N, m))} \right] .

    With :math:`\pi \approx 1` where the structure answers, a strong residual there does not
    raise the noise, but the noise cannot exceed it. The colour is common to all trials; its
    strength is each trial's own. Where one density fits the whole residual of a sensor within
    its scatter, or one for each trial does, the whole residual is taken for noise. In free
    decays it is not, as long as the model may lack laws, where that density rises steeply to
    where the structure answers: nothing drives it, so that this is motion which the model
    lacks, and the noise is taken as white.

    Parameters
    ----------
    silent_above_hz
        Frequency [Hz] above which the structure hardly answers; 0 where the whole residual is
        noise.
    lacking
        Whether the model has no law of an element beyond its stiffness and damping.
    """
    powers = []
    for trial, residual in zip(trials, residuals, strict=True):
        frequency, power, spare = incoherent_power(
            residual, trial.inputs, trial.rate_hz, trial.used
        )
        share = np.maximum(trial.used.mean(axis=0), THRESHOLDS.min_used_share)
        # A sensor without any sample in a trial weighs nothing there.
        heard = trial.used.any(axis=0)
        known = np.where(heard, share * spare, UNMEASURED_WEIGHT)
        powers.append((frequency, np.where(heard, power / share, UNMEASURED_DENSITY), known))
    noise = estimate_noise_of_spectra(
        powers,
        rate_hz=trials[0].rate_hz,
        silent_above_hz=silent_above_hz,
        driven=not (lacking and is_free_decay(trials)),
    )
    return with_instrument_floor(noise, trials)


def with_instrument_floor(noise: Noise, trials: Sequence[Trial]) -> Noise:
    """Add the noise of the best instrument, as records that were smoothed seem quieter."""
    colours = []
    for row, trial in zip(noise.colours, trials, strict=True):
        least = (THRESHOLDS.instrument_floor * trial.measured.std(axis=0)) ** 2 / (
            trial.rate_hz / 2
        )
        colours.append(
            tuple(
                dataclasses.replace(colour, white=colour.white + float(more))
                for colour, more in zip(row, least, strict=True)
            )
        )
    return dataclasses.replace(noise, colours=tuple(colours))


def estimate_noise_of_spectra(
    powers: Sequence[Power], *, rate_hz: float, silent_above_hz: float, driven: bool = True
) -> Noise:
    """Estimate the noise from power spectra that hold more than noise.

    By trial, powers are frequencies [Hz], density of each sensor [unit²/Hz], and the share of
    its lines that is independent. The structure hardly answers above `silent_above_hz`. Where
    something that was not measured may drive it (`driven`), its resonance is a part of the
    noise. `estimate_noise` states the likelihood that is maximised.
    """
    found = []
    for sensor in range(powers[0][1].shape[1]):
        means = [
            block_means(frequency, power[:, sensor], silent_above_hz).with_independent_share(
                share[sensor]
            )
            for frequency, power, share in powers
        ]
        plain = [
            dataclasses.replace(
                m,
                signal_probability=np.full_like(
                    m.signal_probability, THRESHOLDS.tone_probability
                ),
            )
            for m in means
        ]
        trusted = select_colours(plain, rate_hz)
        only_noise = is_noise_only(plain, [colour for colour, _ in trusted])
        doubtless = only_noise or silent_above_hz == 0
        chosen = trusted if doubtless else fit_colours(means, rate_hz)
        if not driven and any(_hides_motion(one, silent_above_hz) for one, _ in chosen):
            chosen = _fit_white(means)
        found.append(chosen)
    by_trial = tuple(zip(*found, strict=True))
    return Noise(
        colours=tuple(tuple(colour for colour, _ in row) for row in by_trial),
        relative_sd=tuple(tuple(error for _, error in row) for row in by_trial),
    )


def block_means(
    frequency_hz: Float[np.ndarray, " frequency"],
    power: Float[np.ndarray, " frequency"],
    silent_above_hz: float,
) -> BlockMeans:
    """Average a periodogram over blocks of constant relative width.

    Blocks above `silent_above_hz` are taken to be noise; the upper half of the band where too
    few lines lie above it. Densities are in unit²/Hz.
    """
    edges = [0]
    while edges[-1] < len(power):
        first = edges[-1]
        wide = (
            np.searchsorted(frequency_hz, frequency_hz[first] * THRESHOLDS.block_ratio) - first
        )
        edges.append(
            first + int(np.clip(wide, THRESHOLDS.min_block_lines, THRESHOLDS.max_block_lines))
        )
    edges[-1] = len(power)
    if len(edges) > 2 and edges[-1] - edges[-2] < THRESHOLDS.min_block_lines:
        del edges[-2]
    starts, lines = np.array(edges[:-1]), np.diff(edges).astype(float)
    centre = np.add.reduceat(frequency_hz, starts) / lines
    silent = centre > silent_above_hz
    if lines[silent].sum() < 4 * THRESHOLDS.min_block_lines:
        silent = centre > frequency_hz[-1] / 2
    return BlockMeans(
        centre,
        np.add.reduceat(power, starts) / lines,
        lines,
        np.where(silent, THRESHOLDS.tone_probability, THRESHOLDS.signal_probability),
    )


def _hides_motion(colour: Colour, below_hz: float) -> bool:
    """Whether a density is steeper below a frequency [Hz] than first-order noise can be."""
    responding = below_hz * np.linspace(0.1, 1.0, 46)
    above_hz = THRESHOLDS.silent_ratio * below_hz
    steepest = (above_hz / responding) ** 2  # of a low-pass of first order
    ratio = colour.density(responding) / colour.density(np.array([above_hz]))
    return bool((ratio > steepest).any())


def is_noise_only(means: Sequence[BlockMeans], colours: Sequence[Colour]) -> bool:
    """Whether blocks outside the structure's band scatter about the densities as noise does."""
    deficit, blocks = 0.0, 0
    for one, colour in zip(means, colours, strict=True):
        # Where some blocks lie in the structure's band, a few others may hold tones.
        seen = one.signal_probability < THRESHOLDS.signal_probability
        clean = _mixture_log_likelihood(one, colour.density(one.frequency_hz))[1] > 0.5
        if not seen.all() and np.mean(clean[seen]) > 1 - THRESHOLDS.tonal_share:
            seen = seen & clean
        relative = np.maximum(one.power / colour.density(one.frequency_hz), 1e-300)[seen]
        deficit += float(2 * one.lines[seen] @ (relative - 1 - np.log(relative)))
        blocks += len(relative)
    return bool(scipy.special.chdtrc(blocks, deficit) > THRESHOLDS.noise_only_p_value)


def select_colours(means: Sequence[BlockMeans], rate_hz: float) -> list[tuple[Colour, float]]:
    """Fit a colour common to all trials, or one for each where only that explains them."""
    common = fit_colours(means, rate_hz)
    if len(means) == 1 or is_noise_only(means, [colour for colour, _ in common]):
        return common
    own = [fit_colours([one], rate_hz)[0] for one in means]
    return own if is_noise_only(means, [colour for colour, _ in own]) else common


def fit_colours(means: Sequence[BlockMeans], rate_hz: float) -> list[tuple[Colour, float]]:
    """Fit the colour common to all trials, and its strength in each with its relative sd."""
    plain = _fit_white(means)
    if is_noise_only(means, [colour for colour, _ in plain]):
        return plain
    scaled = [one.relative_to(c.white) for one, (c, _) in zip(means, plain, strict=True)]
    whole = BlockMeans(
        *(
            np.concatenate([getattr(one, field.name) for one in scaled])
            for field in dataclasses.fields(BlockMeans)
        )
    )
    colour = _select_family(whole, rate_hz)
    strengths = [_fit_strength(one, colour) for one in means]
    return [(colour.scaled(level), error) for level, error in strengths]


def _fit_white(means: Sequence[BlockMeans]) -> list[tuple[Colour, float]]:
    """Fit a white density to each trial; give it and its relative standard deviation."""
    strengths = [_fit_strength(one, Colour(white=1.0)) for one in means]
    return [(Colour(white=level), error) for level, error in strengths]


def _fit_strength(means: BlockMeans, colour: Colour) -> tuple[float, float]:
    """Fit a factor on a colour to the means; give it and its relative standard deviation."""
    relative = dataclasses.replace(
        means, power=np.maximum(means.power, 1e-300) / colour.density(means.frequency_hz)
    )
    trusted = relative.signal_probability < THRESHOLDS.signal_probability
    centre = float(np.log(np.median(relative.power[trusted])))

    one = np.ones(len(relative.power))

    def cost(log_level: float) -> float:
        return -float(_mixture_log_likelihood(relative, np.exp(log_level) * one)[0].sum())

    grid = centre + STRENGTH_GRID
    nearest = float(grid[int(np.argmin([cost(float(level)) for level in grid]))])
    step = float(STRENGTH_GRID[1] - STRENGTH_GRID[0])
    found = scipy.optimize.minimize_scalar(
        cost,
        bounds=(nearest - step, nearest + step),
        method="bounded",
        options={"xatol": 1e-5},
    )
    level = float(np.exp(found.x))
    clean = _mixture_log_likelihood(relative, level * one)[1]
    known = float(clean @ relative.lines)
    return level, 1 / math.sqrt(known if known > 1 else 1.0)


def _select_family(means: BlockMeans, rate_hz: float) -> Colour:
    """Choose a white density unless a coloured one is much more likely."""
    best = Colour(white=1.0)
    least = _log_likelihood(means, best) + THRESHOLDS.colour_gain
    top = float(means.frequency_hz[-1])
    falling = [
        (POWER_LAW, [-1.0, 0.0, np.log(corner * top), slope])
        for slope, corner in ((2.0, 0.1), (-2.0, 0.5), (1.0, 0.01))
    ]
    humped = [(POLE_PAIR, [-1.0, 0.0, 2.0, turn * np.pi]) for turn in (0.1, 0.3, 0.6)]
    for family, at in falling + humped:
        colour = _fit_family(means, family, np.array(at), rate_hz)
        score = _log_likelihood(means, colour)
        if score > least:
            best, least = colour, score
            if is_noise_only([means], [colour]):
                break
    return _raise_white_part(means, best)


def _raise_white_part(means: BlockMeans, colour: Colour) -> Colour:
    """Raise the white part of a rising density as far as the likelihood hardly falls."""
    # Noise that rises above the structure's band says nothing of the noise within it.
    ends = colour.density(means.frequency_hz[[0, -1]])
    if ends[0] >= ends[1]:
        return colour
    least = _log_likelihood(means, colour) - THRESHOLDS.white_part_loss
    for white in float(ends[1]) * WHITE_PART_GRID:
        raised = dataclasses.replace(colour, white=float(white))
        if white > colour.white and _log_likelihood(means, raised) > least:
            return raised
    return colour


def _colour_at(at: At, family: int, rate_hz: float) -> Colour:
    """Colour by the parameters of `maximise_likelihood`."""
    white, low = np.exp(at[:2]).tolist()
    if family == POWER_LAW:
        return Colour(
            white=white, coloured=low, corner_hz=float(np.exp(at[2])), slope=float(at[3])
        )
    radius = float(MAX_POLE_RADIUS / (1 + np.exp(-at[2])))
    return Colour(white=white, coloured=low, radius=radius, angle=float(at[3]), rate_hz=rate_hz)


def _fit_family(means: BlockMeans, family: int, at: At, rate_hz: float) -> Colour:
    """Fit the parameters of one family by Fisher scoring."""
    lowest, top = float(means.frequency_hz[0]), float(means.frequency_hz[-1])
    corners = (np.log(lowest / 2), np.log(4 * top))
    own = (
        (corners, SLOPE_BOUNDS) if family == POWER_LAW else (RADIUS_LOGIT_BOUNDS, ANGLE_BOUNDS)
    )
    low, high = np.array([*LOG_STRENGTH_BOUNDS, *own], dtype=float).T.copy()
    # First with the silent band as noise: a block dismissed there would have no more weight.
    innocent = np.where(
        means.signal_probability < THRESHOLDS.signal_probability,
        THRESHOLDS.no_signal_probability,
        means.signal_probability,
    )
    for suspect in (innocent, means.signal_probability):
        odds = np.log1p(-suspect), np.log(suspect)
        blocks = np.stack([means.frequency_hz, means.power, means.lines, *odds])
        at = maximise_likelihood(blocks, at, low, high, family, rate_hz)
    return _colour_at(at, family, rate_hz)


def _log_likelihood(means: BlockMeans, colour: Colour) -> float:
    """Log likelihood of all blocks."""
    return float(_mixture_log_likelihood(means, colour.density(means.frequency_hz))[0].sum())


def _mixture_log_likelihood(means: BlockMeans, density: Blocks) -> tuple[Blocks, Blocks]:
    """Log likelihood of each block, and its probability to be noise alone."""
    noise = -means.lines * (np.log(density) + means.power / density)
    more = np.maximum(density, means.power)
    above = -means.lines * (np.log(more) + means.power / more)
    one, other = (
        np.log1p(-means.signal_probability) + noise,
        np.log(means.signal_probability) + above,
    )
    total = np.logaddexp(one, other)
    return total, np.exp(one - total)
