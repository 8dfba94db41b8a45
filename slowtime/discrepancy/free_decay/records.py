"""Free decays: records that nothing drives, which die down and may end at a standstill."""

from collections.abc import Mapping, Sequence

import numpy as np
import scipy
from jaxtyping import Float

from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.dynamics.effects import Kind
from slowtime.identification.free_decay.decay_errors import mode_of_fit
from slowtime.identification.free_decay.decay_fit import drift_basis, fit_decays
from slowtime.signals.spectra import transform

MIN_REST = 0.02
"""[share of a record] At rest at its end, from which that is cut off. Source: a decision."""
STILL_STEPS = 2.5
"""[steps of the sensor] From its last readings, within which a channel is at rest: what it
tells there is its resolution. Source: half a step more than two; half and double change no
answer of docs/what_decides.md."""
REST_READINGS = 50
"""[1] Part of a record whose median tells where it comes to rest: one of this many. Source: the
share `MIN_REST` at rest from which a record is cut."""
MIN_PEAKS = 8
"""[half cycles] That a record must hold. Source: peaks of random motion fall eight times in a
row in one record of forty thousand."""
MAX_RISING_SHARE = 0.05
"""[share of the peaks] That may be higher than one cycle before, or one of them. Source: the
5 % level; those of stationary random motion rise half of the time."""
MIN_RISE = 0.005
"""[share of the largest peak] By which a peak must be higher to have risen. Source: resolution
of usual encoders and the noise of usual sensors."""
FALLING_P_VALUE = 1e-3
"""[probability] p-value of the trend of peaks (Kendall) below which they fall. Source: peaks
of random motion fall in one record of a thousand, and hardly ever without rising in between."""
MANY_PARTS = 12
"""[1] Equal parts of a record whose strengths are compared. Source: random motion falls through
so many with a probability of one in 12!, or in a few thousand if it is slow; half and double
change no answer of docs/what_decides.md."""
FEW_PARTS = 4
"""[1] The same of a record whose modes beat. Source: as above, with `MAX_RATIO_OF_FEW`."""
MIN_PART_SAMPLES = 16
"""[samples] Of such a part. Source: as many tell a strength to a fifth."""
FLOOR_RATIO = 1.5
"""[1] Over the least strength, up to which a part is noise alone. Source: six standard
deviations of the strength of 64 independent samples; half and double change no answer of
docs/what_decides.md."""
MAX_RATIO_OF_MANY = 1.05
"""[1] Of the strength of a part to that before, of many. Source: a slow decay, whose parts
scatter by a twentieth."""
MAX_RATIO_OF_FEW = 0.6
"""[1] The same of few parts. Source: of three hundred random responses of all bandwidths, three
at most pass."""
MAX_LAST_LEVEL = 0.3
"""[1] Of the least strength to the first. Source: 10 dB; half and double change no answer of
docs/what_decides.md."""
FEW_PEAKS = 3
"""[half cycles] Of a record that is tested as a single decaying sinusoid. Source: a sinusoid of
fewer has no amplitude, frequency and damping of its own."""
MAX_RING_REST = 0.02
"""[share of variance] That a decaying sinusoid leaves at most of such a record. Source: 17 dB;
what drives a structure at random leaves more over two cycles."""
FALLING_SDS = 3.0
"""[standard deviations] Of its damping from which a sinusoid falls. Source: a tone that does
not is taken for one that falls once in 740 records."""
FIRST_DECAY = 0.1
"""[1] Fall of the logarithm of the amplitude over a record from which the fit starts. Source:
it converges from half or twice as much."""
RING_FREQUENCIES = np.linspace(0.75, 1.25, 41)
"""[1] Frequencies that are tried, over that of the crossings of zero. Source: a crossing more
or less in a record of four."""
RING_DAMPINGS = np.array([0.0, 0.003, 0.01, 0.02, 0.05, 0.1, 0.2])
"""[1] Damping ratios that are tried. Source: usual ones of structures and machines."""


def is_free_decay(trials: Sequence[Trial]) -> bool:
    """Return whether nothing drives any record, and each dies down."""
    return bool(trials) and all(
        not one.inputs.any() and (_decays(one) or _dies_down(one) or _rings_on(one))
        for one in trials
    )


def without_standstill(trial: Trial) -> Trial:
    """Cut a free decay where it has come to rest: a still channel is not a faulty one there."""
    moving = np.flatnonzero((np.abs(_excursions(trial.measured)) > STILL_STEPS).any(axis=1))
    end = int(moving[-1]) + 2 if len(moving) else len(trial.outputs)
    resting = len(trial.outputs) - end
    if resting < MIN_REST * len(trial.outputs) or end < MIN_SAMPLES:
        return trial
    return trial.part(0, end)


def without_tones(kinds: Mapping[str, Kind]) -> dict[str, Kind]:
    """List the kinds that need no drive of their own."""
    # A tone or a pulsation at the frequency of the decay follows it for as long as it lasts,
    # and imitates any law of its damping.
    return {name: kind for name, kind in kinds.items() if kind.quadrature is None}


def _excursions(series: Float[np.ndarray, "time sensor"]) -> Float[np.ndarray, "time sensor"]:
    """Distances from the last readings, in the least steps between readings that differ."""
    found = np.zeros(series.shape)
    for sensor, column in enumerate(series.T):
        steps = np.abs(np.diff(column))
        least = steps[steps > 0].min(initial=np.inf)
        rest = np.median(column[-max(len(column) // REST_READINGS, 1) :])
        found[:, sensor] = (column - rest) / least if np.isfinite(least) else 0.0
    return found


def _decays(trial: Trial) -> bool:
    """Whether the peaks of the loudest sensor of a record fall from cycle to cycle."""
    loud = int(np.argmax(np.std(trial.measured, axis=0)))
    series = trial.measured[:, loud]
    peaks = _peaks(series - np.mean(series[len(series) // 2 :]))
    if len(peaks) < FEW_PEAKS:
        return False
    if len(peaks) < MIN_PEAKS:
        return _rings_freely(series, trial.rate_hz, peaks)
    # Peaks of either side are averaged: the zero of a sensor may be off.
    level = (peaks[1:] + peaks[:-1]) / 2
    rising = int(np.sum(level[2:] > level[:-2] + MIN_RISE * level.max()))
    trend = scipy.stats.kendalltau(np.arange(len(level)), level, alternative="less")
    most = max(1, int(MAX_RISING_SHARE * (len(level) - 2)))
    return bool(rising <= most and trend.pvalue < FALLING_P_VALUE)


def _dies_down(trial: Trial) -> bool:
    """Whether the strength of a record falls from part to part, down to its noise."""
    # Peaks of several modes beat, and those of a one-sided spring alternate; the strength of
    # long parts falls all the same.
    size = np.std(trial.measured, axis=0)
    moved = trial.measured[:, size > 0] / size[size > 0]
    if moved.shape[1] == 0 or len(moved) < MANY_PARTS * MIN_PART_SAMPLES:
        return False
    moved = moved - np.median(moved[-len(moved) // MANY_PARTS :], axis=0)
    return any(
        _falls(moved, parts, most)
        for parts, most in ((MANY_PARTS, MAX_RATIO_OF_MANY), (FEW_PARTS, MAX_RATIO_OF_FEW))
    )


def _rings_on(trial: Trial) -> bool:
    """Whether the loudest sensor tells one sinusoid that falls, and white noise."""
    # Peaks of a weakly damped decay fall by less than their noise. Of six hundred responses of
    # one mode to random forces, 0.02 to 1 time constants long, none leaves a white residual.
    loud = int(np.argmax(np.std(trial.measured, axis=0)))
    series = trial.measured[:, loud]
    if len(series) < MIN_SAMPLES or not np.isfinite(series).all() or not np.ptp(series):
        return False
    frequency, spectrum = transform(
        (series - series.mean())[:, None], trial.rate_hz, taper="hann"
    )
    peak = float(frequency[1 + np.argmax(np.abs(spectrum[1:]))])
    start = np.array([-FIRST_DECAY * trial.rate_hz / len(series) + 2j * np.pi * peak])
    fit = fit_decays(series, trial.rate_hz, start, drift_basis(len(series), 1))
    found = mode_of_fit(fit, 0, trial.rate_hz).identified
    damping = found.damping_ratio
    return (
        fit.converged
        and not found.flags
        and damping.value > FALLING_SDS * damping.sd
        and fit.cost < MAX_RING_REST * len(series) * float(np.var(series))
    )


def _falls(moved: Float[np.ndarray, "time sensor"], parts: int, most: float) -> bool:
    """Whether each part is weaker than `most` times that before, until only noise is left."""
    level = np.array([
        float(np.sqrt(np.mean(part**2))) for part in np.array_split(moved, parts)
    ])  # fmt: skip
    least = float(level.min())
    heard = np.flatnonzero(level > FLOOR_RATIO * least)
    last = min(int(heard[-1]) + 1, parts - 1) if len(heard) else 0
    falls = bool((level[1 : last + 1] < most * level[:last]).all())
    return falls and least < MAX_LAST_LEVEL * float(level[0])


def _rings_freely(
    series: Float[np.ndarray, " time"], rate_hz: float, peaks: Float[np.ndarray, " peak"]
) -> bool:
    """Whether a record of few cycles is one decaying sinusoid about a constant."""
    times = np.arange(len(series)) / rate_hz
    half = (len(peaks) + 1) / (times[-1] or 1.0)
    omega, decay = np.pi * half * RING_FREQUENCIES, RING_DAMPINGS
    least = np.inf
    for w in omega:
        for zeta in decay:
            fall = np.exp(-zeta * w * times)
            basis = np.stack([fall * np.cos(w * times), fall * np.sin(w * times), times**0], 1)
            left = series - basis @ np.linalg.lstsq(basis, series, rcond=None)[0]
            least = min(least, float(np.var(left)))
    return least < MAX_RING_REST * float(np.var(series))


def _peaks(series: Float[np.ndarray, " time"]) -> Float[np.ndarray, " peak"]:
    """Largest sizes between crossings of zero, by parabolas; the outer pieces left out."""
    ends = np.flatnonzero(np.diff(np.signbit(series))) + 1
    pieces = np.split(np.abs(series), ends)[1:-1]
    return np.array([_vertex(piece) for piece in pieces])


def _vertex(piece: Float[np.ndarray, " time"]) -> float:
    """Height of the parabola through the largest sample of a piece and its neighbours."""
    at = int(np.argmax(piece))
    if not 0 < at < len(piece) - 1:
        return float(piece[at])
    before, top, after = piece[at - 1 : at + 2]
    bend = before - 2 * top + after
    return float(top - (after - before) ** 2 / (8 * bend) if bend < 0 else top)
