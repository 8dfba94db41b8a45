r"""Amplitude and phase of one mode along a free decay, from all channels together.

Over a window of a few cycles every channel is

.. math:: y_c(t) = \mathrm{Re}\,[g \, u_c \, e^{\lambda (t - t_k)}] + b_c + \text{other modes} ,

with one complex amplitude g of the mode at the middle of the window and one shape u. The pole
:math:`\lambda` of a window is that of the amplitudes of the windows about it, so that each fit
is linear. Amplitudes at successive windows are then the slow flow of the mode, whatever law
its damping and stiffness follow.

References
----------
.. [1] A. H. Nayfeh and D. T. Mook, "Nonlinear Oscillations" (1979), section 3.3: averaging.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Complex, Float

from slowtime.signals.peaks import local_maxima, prominences

MIN_POINTS = 6
"""[windows] Of a decay, at least. Source: three coefficients, a start, and two to spare."""
FLOOR = 4.0
"""[standard deviations] Amplitude to which a decay is followed. Source: below, noise makes
amplitudes of its own."""
WINDOW_FALL = 0.12
"""[1] Fall of the logarithm of the amplitude over a window. Source: an exponential within it is
then right to a thousandth for dry friction too."""
PER_DECAY = 12
"""[1] Windows side by side in a decay, at least. Source: twice `MIN_POINTS`."""
OTHERS_SHARE = 2.5e-4
"""[1] Power of another line over that of the mode from which it is fitted beside it. Source: it
moves amplitudes by 1.6 % at most."""
LINE = 20.0
"""[1] Power of a line over the median about it. Source: noise is as strong once in a million
lines."""
CELLS = 20
"""[resolutions] On either side, of which that median is."""
MOST_OTHERS = 6
"""[1] Other lines, the strongest. Source: four columns each, of a window of some dozen
samples."""
STANDS_OUT = 4.0
"""[1] Power of a line over the saddles beside it. Source: 6 dB."""
APART = 1.5
"""[1] Cycles of the beat of two lines in a window that tell them apart. Source: the condition
of the fit is then below four."""
RELEASE_PARTS = 128
"""[1] Windows side by side in a record, over which levels are taken for the release."""
RELEASE_CYCLES = 2.0
"""[cycles] Of the strongest line in such a window, at least."""
STILL = 0.9
"""[1] Ratio of the levels whose last times are compared."""
RELEASE_STEPS = 11
"""[1] Such levels: down to 0.3 of the largest, below which a drive is not looked for."""
STAYED = 2.0
"""[1] Time from one level to the next over that to the one after, from which a drive was on.
Source: dry friction has 1.1, viscous damping 1, quadratic 0.9."""
PAUSED = 1.25
"""[1] The same of the first level, that of the largest motion, from which a drive that builds
up to its stop was on. Source: dry friction has 1.1."""
DROPPED = 0.1
"""[1] Least level while a drive is on, over that at its end: between blows it is less."""
DEEPER = 0.7
"""[1] Level to which motion falls after a drive, over the least while it was on: a beat, which
comes and goes as a drive does, only falls as far as it did before."""
BLOCKS = 64
"""[1] Parts of a record whose levels are compared."""
STEADY_TAIL = 1.1
"""[1] Level of the third quarter over that of the last up to which the last is noise. Source: a
decay falls by less only where its first block is below `ABOVE_TAIL`."""
ABOVE_TAIL = 1.5
"""[1] Level of a block over that of the tail from which it is of the decay."""
NEAR = 0.15
"""[1] Relative distance of lines that a window need not be long enough to tell apart. Source:
judgement; ten cycles would be longer than strongly damped decays."""
BEATS_SHARE = 2.5e-3
"""[1] Power of a line over that of the mode from which a beat with it imitates damping. Source:
amplitudes vary by 5 %."""
DISAGREE = 3.0
"""[standard deviations] Root mean square of what one shape leaves of the channels, from which
they do not move in one mode only."""
WHOLE = 0.9
"""[cycles] Of a window from which an offset is fitted beside the mode."""
RELEASED = 3.0
"""[1] Rise of the amplitude over the least before from which the mode was excited again.
Source:
a beat of modes that rises by as much is told by its lines."""
HELD = 0.5
"""[1] Ratio of amplitudes over the usual ratio below which friction holds the mode."""
PASSES = 3
"""Fits with poles of the fit before; the third changes amplitudes by less than a thousandth."""
MAX_UNEVENNESS = 0.25
"""[1] Relative change of the frequency from one cycle to the next at which a decay has ended.
Source: judgement; frequencies change by less."""
NORMAL_MAD = 0.6745
"""[standard deviations] Median of the modulus of a normal variable."""

Points = Float[np.ndarray, " point"]
Samples = Float[np.ndarray, "time channel"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """Slow flow of one mode.

    Parameters
    ----------
    half_cycles
        Counted from the first [1].
    amplitude, amplitude_sd
        In the unit of the channel that moves most.
    channel
        Number of that channel.
    overlap
        Points for each independent window [1].
    beats
        Whether another mode is so near that its beat imitates a change of damping.
    """

    times_s: Points
    half_cycles: Points
    amplitude: Points
    amplitude_sd: Points
    frequency_hz: Points
    frequency_sd_hz: Points
    channel: int = 0
    overlap: float = 2.0
    beats: bool = False


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Flow:
    """Complex amplitudes at the middles of windows, relative to a steady frequency."""

    times: Points
    size: Complex[np.ndarray, " point"]
    sd: Points
    shape: Complex[np.ndarray, " channel"]
    clear: Points
    """Power of all channels by that shape, over that of their noise [1]."""
    left: Points
    """The same of what it leaves, for each degree of freedom; 1 by chance."""


def decay_envelope(
    samples: Samples | Float[np.ndarray, " time"],
    rate_hz: float,
    start_s: float = 0.0,
    *,
    band_hz: tuple[float, float] | None = None,
    near_hz: float | None = None,
) -> Envelope:
    """Follow a mode from the largest motion on, down to the noise.

    Nothing before `start_s` is used; the mode is in `band_hz`, near `near_hz`, by default at
    the strongest line. Raises `ValueError` where there are too few cycles above the noise.
    """
    columns = np.asarray(samples, dtype=float)
    columns = columns[:, None] if columns.ndim == 1 else columns
    columns = columns[int(start_s * rate_hz) :]
    if len(columns) < 2 * MIN_POINTS:
        raise ValueError(_too_few(0))
    columns = columns - np.median(columns[len(columns) // 2 :], axis=0)
    scale = np.where(columns.std(axis=0) > 0, columns.std(axis=0), 1.0)
    begun = _release(columns / scale, rate_hz, near_hz)
    moved = _without_tail(columns[begun:], scale)
    if len(moved) < 2 * MIN_POINTS:
        raise ValueError(_too_few(0))
    hz, lines, strength = _lines(moved / scale, rate_hz, band_hz, near_hz)
    away = np.abs(lines - hz)
    far = away > NEAR * hz
    clear = _told_apart(lines[far], strength[far], 3 / hz)
    shortest = max([1 / hz, *(APART / np.abs(clear - hz)), (6 + 8 * len(clear)) / rate_hz])
    if not len(clear):
        shortest = 1 / hz
    beside = ""
    if len(clear) and shortest > 1.5 / hz:
        near = clear[np.argmin(np.abs(clear - hz))]
        beside = f" (so long as to tell the mode from that at {near:.4g} Hz)"
    begins = max(shortest, len(moved) / rate_hz / 40)
    rough = _followed(moved, rate_hz, hz, clear, begins)
    window, last = _window(rough, hz, shortest, begins, beside)
    moved = moved[: max(int(last * rate_hz), 2 * MIN_POINTS)]
    told = away * window > APART * (1 - 1e-6)  # `shortest` may be the window
    free = _told_apart(lines[told], strength[told], window)
    unresolved = ~told & (away * last > APART)
    beats = bool((unresolved & (strength > BEATS_SHARE)).any())
    flow = _followed(moved, rate_hz, hz, free, window)
    return _envelope(flow, hz, begun / rate_hz + start_s, window, beats, beside)


def _release(scaled: Samples, rate_hz: float, near_hz: float | None) -> int:
    """Row from which a structure is free: that of the largest motion, or a later one."""
    # Along a decay the last times of levels that form a geometric series follow each other
    # evenly. A drive that stops within the record stays at one level long after those above
    # were last reached, and below it the levels follow at once.
    power = np.sum(scaled**2, axis=1)
    largest = int(np.argmax(power))
    lines = np.sum(np.abs(np.fft.rfft(scaled, axis=0)) ** 2, axis=1)
    hz = near_hz or int(np.argmax(lines[1:]) + 1) * rate_hz / len(scaled)
    size = max(len(power) // RELEASE_PARTS, math.ceil(RELEASE_CYCLES * rate_hz / hz))
    if size > len(power) // MIN_POINTS:
        return largest
    level = np.sqrt(np.convolve(power, np.ones(size) / size, "valid"))
    levels = level.max() * STILL ** np.arange(1, RELEASE_STEPS + 2)
    last = [largest, *(int(np.flatnonzero(level >= one)[-1]) for one in levels)]
    begun = largest
    for k in range(1, RELEASE_STEPS + 1):
        stayed, after = last[k] - last[k - 1], last[k + 1] - last[k]
        if last[k] <= largest or stayed < size + STAYED * after:
            continue
        if last[k + 1] == len(level) - 1:
            break  # what follows is not seen to fall
        least = level[max(last[k - 1], largest) : last[k]].min()
        if least > DROPPED * levels[k - 1] and level[last[k] :].min() < DEEPER * least:
            begun = last[k] + int(np.argmax(power[last[k] : last[k] + size]))
    after = last[2] - last[1]
    if begun == largest and last[2] < len(level) - 1 and last[1] - largest > PAUSED * after:
        # A level is that of half its window later.
        free = max(last[1] - after + size // 2, largest)
        begun = free + int(np.argmax(power[free : free + size // 2]))
    return begun


def _too_few(count: int, cycles: float = 0.0, beside: str = "") -> str:
    windows = f"{count} half-overlapping windows"
    windows += f" of {cycles:.3g} cycles{beside}" if cycles else ""
    return (
        f"There are {windows} above the noise, fewer than {MIN_POINTS}: too few for a law of "
        "damping. Give a longer decay, or a stronger one."
    )


def _without_tail(moved: Samples, scale: np.ndarray) -> Float[np.ndarray, "part channel"]:
    """Cut off what follows a decay at a steady level: noise, whose lines are none of modes."""
    if len(moved) < 4 * BLOCKS:
        return moved
    parts = np.array_split(np.sum((moved / scale) ** 2, axis=1), BLOCKS)
    level = np.sqrt([float(part.mean()) for part in parts])
    third, last = (
        float(level[a:b].mean())
        for a, b in ((BLOCKS // 2, 3 * BLOCKS // 4), (3 * BLOCKS // 4, BLOCKS))
    )
    loud = np.flatnonzero(level > ABOVE_TAIL * last)
    if not len(loud) or third > STEADY_TAIL * last:
        return moved
    end = (int(loud[-1]) + 2) * len(moved) // BLOCKS
    return moved[: max(end, 2 * MIN_POINTS)]


def _lines(
    moved: Samples,
    rate_hz: float,
    band_hz: tuple[float, float] | None,
    near_hz: float | None,
) -> tuple[float, Float[np.ndarray, " line"], Float[np.ndarray, " line"]]:
    """Return the frequency of the mode, those of other lines [Hz], and their powers [1]."""
    count = len(moved)
    # The decay begins at its largest value: a taper there would take the decay away.
    taper = np.blackman(2 * count)[count:, None]
    length = 2 * count
    power = np.sum(np.abs(np.fft.rfft(moved * taper, n=length, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(length, 1 / rate_hz)
    low, high = band_hz or (
        (0.0, rate_hz) if near_hz is None else (near_hz / 1.2, near_hz * 1.2)
    )
    power[: 3 * length // count] = 0.0
    if high * count < 3 * rate_hz:
        raise ValueError(
            f"From the largest motion on, or from where a drive stops, the record has "
            f"{count / rate_hz:.3g} s, fewer than 3 cycles up to {high:.4g} Hz: too few for a "
            "law of damping. Where two modes beat, a late beat may be the largest motion. Give "
            "a longer record, or cut it off before that."
        )
    inside = (frequency >= low) & (frequency <= high)
    if not inside.any() or not power[inside].any():
        raise ValueError(
            f"No motion from {low:g} to {high:g} Hz was found. Give a band or a frequency of "
            f"the record, between 0 and {rate_hz / 2:g} Hz."
        )
    peaks = local_maxima(np.log(power + 1e-300))
    main = int(np.argmax(np.where(inside, power, -1.0)))
    own = [p for p in peaks if inside[p]]
    if near_hz is not None and own:
        strong = [p for p in own if power[p] > OTHERS_SHARE * power[main]]
        main = min(strong, key=lambda p: abs(frequency[p] - near_hz))
    cells = CELLS * length // count
    heights = prominences(np.log(power + 1e-300), peaks)
    others = [
        int(p)
        for p, height in zip(peaks, heights, strict=True)
        if height > math.log(STANDS_OUT)
        and power[p] > OTHERS_SHARE * power[main]
        and power[p] > LINE * float(np.median(power[max(p - cells, 0) : p + cells]))
        and abs(int(p) - main) > 3 * length // count
    ]
    others = sorted(others, key=lambda p: -power[p])[:MOST_OTHERS]
    bend = np.log(power[main - 1 : main + 2] + 1e-300) if 0 < main < len(power) - 1 else None
    shift = 0.0
    if bend is not None and bend[0] - 2 * bend[1] + bend[2] < 0:
        shift = float((bend[0] - bend[2]) / (2 * (bend[0] - 2 * bend[1] + bend[2])))
    step = float(frequency[1])
    others = sorted(others)
    return float(frequency[main]) + shift * step, frequency[others], power[others] / power[main]


def _told_apart(
    lines: Float[np.ndarray, " line"], strength: Float[np.ndarray, " line"], window: float
) -> Float[np.ndarray, " told"]:
    """Return lines that a window tells from all stronger ones."""
    kept: list[float] = []
    for line in lines[np.argsort(-strength)].tolist():
        if all(abs(line - other) * window > APART * (1 - 1e-6) for other in kept):
            kept.append(line)
    return np.array(sorted(kept))


def _window(
    flow: _Flow, hz: float, shortest: float, begins: float, beside: str
) -> tuple[float, float]:
    """Length of a window, and end of the decay, by a rough flow of windows `begins` [s]."""
    size = np.abs(flow.size)
    first = _first(size, flow.sd)
    low = np.flatnonzero(size[first:] < FLOOR * flow.sd[first:])
    count = first + (int(low[0]) if len(low) else len(size) - first)
    if count - first < 3:
        raise ValueError(_too_few(count - first, begins * hz, beside))
    span = float(flow.times[count - 1] - flow.times[first])
    fall = float(np.log(size[first] / max(float(size[first:count].min()), 1e-300)))
    fall = max(fall, 1e-9)
    window = min(span * WINDOW_FALL / fall, span / PER_DECAY)
    if shortest == 1 / hz and fall / span > hz:
        shortest = 0.5 / hz  # so strongly damped that a cycle is most of the decay
    return max(window, shortest), float(flow.times[count - 1] + window)


def _followed(
    moved: Samples,
    rate_hz: float,
    hz: float,
    others: Float[np.ndarray, " line"],
    window: float,
) -> _Flow:
    """Fit all windows, half overlapping, with poles of the fit before."""
    # Whole cycles, as far as samples allow: the offset is then apart from the mode.
    window = max(round(2 * window * hz) / 2, 0.5) / hz
    length = max(round(window * rate_hz), 4)
    starts = np.arange(0, max(len(moved) - length, 0) + 1, max(length // 2, 1))
    times = (starts + (length - 1) / 2) / rate_hz
    poles = np.full(len(starts), 2j * np.pi * hz)
    x = (np.arange(length) - (length - 1) / 2) / rate_hz
    flow = _joined(times, *_fitted(moved, starts, x, poles, others))
    for _ in range(PASSES - 1 if len(starts) > 2 else 0):
        poles = _poles(flow, hz)
        flow = _joined(times, *_fitted(moved, starts, x, poles, others))
    return flow


def _fitted(
    moved: Samples,
    starts: np.ndarray,
    x: np.ndarray,
    poles: np.ndarray,
    others: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Complex amplitudes of each window and channel, and their variances."""
    amplitudes = np.zeros((len(starts), moved.shape[1]), complex)
    variances = np.zeros((len(starts), moved.shape[1]))
    whole = len(x) * abs(poles[0].imag) * (x[1] - x[0]) > 2 * np.pi * WHOLE
    fixed = [np.ones(len(x))] * bool(whole)
    if len(x) > 4 + 6 * len(others):
        for line in others:
            turn = 2 * np.pi * line * x
            fixed += [np.cos(turn), np.sin(turn), x * np.cos(turn), x * np.sin(turn)]
    for k, (start, pole) in enumerate(zip(starts, poles, strict=True)):
        wave = np.exp(pole * x)
        basis = np.column_stack([wave.real, -wave.imag, *fixed])
        inverse = np.linalg.pinv(basis, rcond=1e-8)
        piece = moved[start : start + len(x)]
        found = inverse @ piece
        left = piece - basis @ found
        spare = max(len(x) - basis.shape[1], 1)
        share = float(np.sum(inverse[:2] ** 2)) / 2
        amplitudes[k] = found[0] + 1j * found[1]
        variances[k] = np.sum(left**2, axis=0) / spare * share
    return amplitudes, variances


def _joined(times: Points, amplitudes: np.ndarray, variances: np.ndarray) -> _Flow:
    """Join the channels by the shape that they share; where they disagree, errors grow."""
    noise = np.sqrt(np.median(variances, axis=0)) + 1e-12 * np.abs(amplitudes).max(axis=0)
    noise = np.maximum(noise, 1e-300)
    _, _, right = np.linalg.svd(amplitudes / noise, full_matrices=False)
    shape = right[0] * noise
    strongest = int(np.argmax(np.abs(shape)))
    shape = shape / shape[strongest]
    weight = np.abs(shape / noise) ** 2
    size = (amplitudes * shape.conj() / noise**2).sum(axis=1) / weight.sum()
    of_window = np.sqrt((variances * weight / noise**2).sum(axis=1) * 1.0) / weight.sum()
    others = np.abs(amplitudes - size[:, None] * shape) ** 2 / noise**2
    left = others.sum(axis=1) / (2 * max(amplitudes.shape[1] - 1, 1))
    clear = np.abs(size) ** 2 * weight.sum()
    return _Flow(times, size, of_window * np.maximum(np.sqrt(left), 1.0), shape, clear, left)


def _poles(flow: _Flow, hz: float) -> np.ndarray:
    """Pole at each window, by the amplitudes of the windows about it."""
    step = float(flow.times[1] - flow.times[0])
    turned = np.unwrap(np.angle(flow.size) - 2 * np.pi * hz * (flow.times - flow.times[0]))
    omega = 2 * np.pi * hz + np.gradient(turned, step)
    size = np.maximum(np.abs(flow.size), 1e-300)
    fall = -np.gradient(np.log(size), step)
    half = len(flow.size) // 2
    trusted = np.abs(flow.size) > FLOOR * flow.sd
    fall = np.where(trusted, np.clip(fall, -0.2 * hz, 2 * hz), np.median(fall[: half + 1]))
    omega = np.where(
        trusted & (np.abs(omega / (2 * np.pi * hz) - 1) < 0.5), omega, 2 * np.pi * hz
    )
    return np.asarray(-fall + 1j * omega)


def _envelope(
    flow: _Flow, hz: float, start_s: float, window: float, beats: bool, beside: str
) -> Envelope:
    """Cut the flow where the decay ends, and state frequencies and errors."""
    size = np.abs(flow.size)
    turned = np.unwrap(np.angle(flow.size) - 2 * np.pi * hz * (flow.times - flow.times[0]))
    phase = turned + 2 * np.pi * hz * (flow.times - flow.times[0])
    first = _first(size, flow.sd)
    count = _count(size[first:], flow.sd[first:], phase[first:])
    if count < MIN_POINTS:
        raise ValueError(_too_few(count, window * hz, beside))
    kept = slice(first, first + count)
    size, sd, phase, times = size[kept], flow.sd[kept], phase[kept], flow.times[kept]
    told = sd / size
    sd = sd * _roughness(np.log(size), told)
    turn_sd = told * _roughness(phase, told)
    frequency, frequency_sd = _frequencies(times, phase, turn_sd)
    step = float(times[1] - times[0])
    return Envelope(
        times_s=times + start_s,
        half_cycles=(phase - phase[0]) / np.pi,
        amplitude=size,
        amplitude_sd=sd,
        frequency_hz=frequency,
        frequency_sd_hz=frequency_sd,
        channel=int(np.argmax(np.abs(flow.shape))),
        overlap=max(window / step, 1.0),
        beats=beats or _disagree(flow.clear[kept], flow.left[kept]),
    )


def _disagree(clear: Points, left: Points) -> bool:
    """Whether the ratios of channels change along a decay: two modes are taken for one."""
    # Their beat then imitates damping, too slowly for another line to be seen.
    return bool(left.mean() > DISAGREE**2 and left.sum() > BEATS_SHARE * clear.sum())


def _first(size: Points, sd: Points) -> int:
    """First window in which the mode is alone: other modes may be stronger at the release."""
    clear = np.flatnonzero(size[: len(size) // 4 + 1] >= FLOOR * sd[: len(size) // 4 + 1])
    return int(clear[0]) if len(clear) else 0


def _count(size: Points, sd: Points, phase: Points) -> int:
    """Points before the mode is lost in noise, is held by friction, or is none any more."""
    ends = [len(size)]
    ends += np.flatnonzero(size < FLOOR * np.maximum(sd, 1e-12 * size.max()))[:1].tolist()
    # A second release: the least amplitude before it is where the first decay ends.
    risen = np.flatnonzero(size > RELEASED * np.minimum.accumulate(size))
    ends += [int(np.argmin(size[:again])) + 1 for again in risen[:1]]
    advance = np.diff(phase)
    usual = float(np.median(advance)) or 1e-300
    uneven = np.flatnonzero(np.abs(advance / usual - 1) > MAX_UNEVENNESS)
    ends += (uneven[:1] + 1).tolist()
    # Friction that takes more than is left of an amplitude holds it.
    ratio = size[1:] / np.maximum(size[:-1], 1e-300)
    usual = float(np.median(ratio[: max(len(ratio) // 2, 1)]))
    ends += (np.flatnonzero(ratio < HELD * min(usual, 1.0))[:1] + 1).tolist()
    return int(min(ends))


def _roughness(logs: Points, relative: Points) -> float:
    """Scatter of amplitudes about a smooth course, over what windows tell; at least 1."""
    # Third differences of every second window, which overlaps no other, leave what is smooth.
    if len(logs) < 10:
        return 1.0
    rough = logs[6:] - 3 * logs[4:-2] + 3 * logs[2:-4] - logs[:-6]
    expected = math.sqrt(20.0) * np.sqrt(relative[6:] * relative[:-6])
    return float(max(1.0, np.median(np.abs(rough) / expected) / NORMAL_MAD))


def _frequencies(times: Points, phase: Points, relative: Points) -> tuple[Points, Points]:
    """Frequency about each point, and its standard deviation."""
    slopes, sd = local_slopes(times, phase, relative)
    return slopes / (2 * np.pi), sd / (2 * np.pi)


def local_slopes(at: Points, values: Points, sd: Points) -> tuple[Points, Points]:
    """Slopes of parabolas through the points about each, with standard deviations."""
    count = len(at)
    reach = min(max(count // 6, 2), 6)
    slopes, errors = np.zeros(count), np.zeros(count)
    for i in range(count):
        first = min(max(i - reach, 0), max(count - 2 * reach - 1, 0))
        near = slice(first, min(first + 2 * reach + 1, count))
        x = at[near] - at[i]
        basis = np.stack([np.ones(len(x)), x, x**2], axis=1)
        slope = np.linalg.pinv(basis)[1]
        slopes[i] = float(slope @ values[near])
        # Half of the samples of each value's neighbours are its own.
        errors[i] = math.sqrt(2 * float(slope**2 @ sd[near] ** 2))
    return slopes, errors
