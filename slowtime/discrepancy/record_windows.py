"""Windows of long records: what is missing is looked for in parts, and judged by the whole.

A search costs as much as its records are long, and a law that acts all the time shows in some
hundred periods. So it is looked for where a record moves most, fitted to whole records from
there, and looked for in more of them only where these leave more than it explains: what acts
seldom, what changes slowly, and what a window leaves undecided.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import scipy.fft

from slowtime.dynamics.description import Description, assemble
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.modes import undamped_modes

from .calibration import Fit, try_refit
from .hypothesis import Hypothesis
from .localization import locate
from .quoting import requote_all
from .records import MIN_SAMPLES, Trial
from .selection.comparison import explains_all
from .thresholds import LIMITS

WINDOW_SAMPLES = 12_000
"""[samples] Of all windows together. Source: twice the records in which the hidden rigs of the
documentation were named, so that these are hardly cut."""
RECORD_SAMPLES = 6_000
"""[samples] Of each window. Source: 30 s at 200 Hz, as those records."""
MIN_PERIODS = 60.0
"""[periods of the lowest mode] In a window at least. Source: a mode of 1 % damping has
forgotten how it began after as many."""
GROWTH = 4
"""[1] Times as many samples in the next windows. Source: searches in all windows together then
cost a third more than that in whole records."""
START_POWER_SHARE = 0.5
"""[share of the power of the loudest window] From which a record is cut to its beginning, whose
initial state is the likelier to be rest. Source: a decision; half is 3 dB."""


def record_windows(
    trials: tuple[Trial, ...], description: Description
) -> Iterator[tuple[Trial, ...]]:
    """Give ever longer windows of all records, and at last the records themselves."""
    modes = undamped_modes(assemble(description)).frequency_hz
    lowest = min((hz for hz in modes.tolist() if hz > 0.0), default=0.0)
    count = min(RECORD_SAMPLES, WINDOW_SAMPLES // len(trials))
    while lowest > 0.0:
        windows = tuple(
            _window(trial, max(count, int(MIN_PERIODS / lowest * trial.rate_hz), MIN_SAMPLES))
            for trial in trials
        )
        if 2 * _samples(windows) > _samples(trials):
            break  # hardly less to do
        yield windows
        count *= GROWTH
    yield trials


def with_whole_records(
    found: Hypothesis, trials: tuple[Trial, ...], kinds: Mapping[str, Kind]
) -> Hypothesis | None:
    """Fit what was found in windows to whole records.

    None where whole records do not settle it: where they leave more than it explains, or
    windows did not decide.
    """
    doubted = found.undecided or found.constants_suffice or found.near_unknown
    if found.final or found.exhausted or found.without_sensor or doubted:
        return None
    if not found.fits_whole_records or len(found.fits) != 1 + len(found.effects):
        return None
    last = _lengthened(found.last, found.trials, trials)
    if last is None or not explains_all(found.with_effects((found.first, last), found.effects)):
        return None
    before = [_lengthened(fit, found.trials, trials) for fit in found.fits[:-1]]
    fits = [fit for fit in (*before, last) if fit is not None]
    if len(fits) != len(found.fits):
        return None
    rest = found.localized
    if not found.effects:
        rest = locate(fits[0], trials)
        if rest.p_value <= LIMITS.false_alarm_p_value:
            return None
    return dataclasses.replace(
        found, fits=tuple(fits), trials=trials, localized=rest, fitted=(), nested=(),
        effects=tuple(requote_all(found.effects, fits[-1], kinds)),
    )  # fmt: skip


def _lengthened(fit: Fit, windows: Sequence[Trial], trials: Sequence[Trial]) -> Fit | None:
    """Refit a model to whole records from where windows left it."""
    states = [
        state if window.start_s == trial.start_s else np.zeros_like(state)
        for state, window, trial in zip(fit.states, windows, trials, strict=True)
    ]
    return try_refit(fit.plant, trials, values=fit.values, states=states, horizons=(1.0,))


def _samples(trials: Sequence[Trial]) -> int:
    return sum(len(trial.outputs) for trial in trials)


def _window(trial: Trial, count: int) -> Trial:
    """Cut a record to the part of so many samples in which sensors move most."""
    count = scipy.fft.prev_fast_len(count)
    if count >= len(trial.outputs):
        return trial
    moved = trial.measured - np.mean(trial.measured, axis=0)
    size = np.mean(moved**2, axis=0)
    power = np.sum(moved**2 / np.where(size > 0.0, size, 1.0), axis=1)
    heard = np.concatenate([[0.0], np.cumsum(power)])
    inside = heard[count:] - heard[:-count]
    first = int(np.argmax(inside))
    if inside[0] >= START_POWER_SHARE * inside[first]:
        first = 0
    return trial.part(first, first + count)
