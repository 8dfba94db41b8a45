"""Multiple shooting: records cut into segments, each with an initial state of its own.

The misfit of a long free run has a local minimum for every period by which it may be out of
phase, and countless ones where motion is chaotic. Over a few periods it has one. So a law that
is not yet well known is fitted to segments (multiple shooting without continuity constraints),
and from there to the whole.

References
----------
.. [1] H. G. Bock, "Recent advances in parameter identification techniques for O.D.E.", in
   Numerical Treatment of Inverse Problems in Differential and Integral Equations, Birkhäuser
   (1983).
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.plant import Name, Plant

from .fit import Fit, attempt, refit
from .initial_states import best_initial_state, multistart_initial_state, state_from_sensors
from .levenberg_marquardt import DEFAULT_CONTROL, FitAbandoned, FitControl

SEGMENT_PERIODS = 3.0
"""[periods of the slowest mode] That a segment lasts. Source: docs/decisions/0031; over a
few periods the misfit has one minimum."""
FIRST_PERIODS = 5.0
"""[periods of the slowest mode] With which records begin. Source: docs/decisions/0029;
docs/what_decides.md: half and double change no answer."""
MULTISTART_SHARE = 0.05
"""[share of the segments] Up to which outlying ones are fitted from many initial states.
Source: docs/what_decides.md: half and double change no answer."""
OUTLYING_RATIO = 30.0
"""[1] Times the median chi squared per sample from which a segment is outlying. Source:
docs/what_decides.md: half and double change no answer."""
OUTLIER_ROUNDS = 3
"""[1] Refits of the constants without the outlying segments at most. Source:
docs/what_decides.md: half and double change no answer."""
RIGID_FREQUENCY = 1e-6
"""[share of the highest natural frequency] Below which a motion is rigid. Source: square
root of the rounding error of an eigenvalue, with margin."""

State = Float[np.ndarray, " state"]


def shooting_fit(
    plant: Plant,
    trials: Sequence[Trial],
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    control: FitControl = DEFAULT_CONTROL,
    free: Sequence[Name] | None = None,
) -> tuple[Fit, list[State]]:
    """Fit constants to segments of records; give that fit, and each record's initial state.

    The cost to beat of `control` is that of the segments together.
    """
    cut, origin = cut_segments(plant, trials)
    own, late = noise.for_trials(origin), control.is_late
    starts, left = _sequential_initial_states(plant, cut, origin, own, values, late)
    strays = _outlying_segments(left)
    for _ in range(OUTLIER_ROUNDS):
        if not strays:
            break
        # Constants fitted to the other segments leave fewer outliers.
        values = _fit_without(strays, plant, cut, own, values, starts, late, free).values
        starts, left = _sequential_initial_states(plant, cut, origin, own, values, late)
        before, strays = strays, _outlying_segments(left)
        if not len(strays) < len(before):
            break
    if len(strays) <= max(MULTISTART_SHARE * len(cut), 1):
        size = np.max(np.abs(starts), axis=0)
        for i in strays:
            alone = own.for_trials([i])
            starts[i] = multistart_initial_state(plant, cut[i], alone, values, starts[i], size)
    found = refit(
        plant, cut, free=free, noise=own, values=values, states=starts, horizons=(1.0,),
        control=control,
    )  # fmt: skip
    return found, [found.states[origin.index(i)] for i in range(len(trials))]


def _outlying_segments(left: Sequence[float]) -> list[int]:
    """Numbers of segments whose misfit is far above the median: they are in a wrong minimum."""
    bar = OUTLYING_RATIO * max(float(np.median(left)), 1.0)
    return [i for i, one in enumerate(left) if one > bar]


def _fit_without(
    strays: Sequence[int],
    plant: Plant,
    cut: Sequence[Trial],
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    states: Sequence[State],
    late: Callable[[], bool] | None,
    free: Sequence[Name] | None = None,
) -> Fit:
    """Fit all segments but some."""
    rest = [i for i in range(len(cut)) if i not in strays]
    return refit(
        plant, [cut[i] for i in rest], free=free, noise=noise.for_trials(rest), values=values,
        states=[states[i] for i in rest], horizons=(1.0,), control=FitControl(is_late=late),
    )  # fmt: skip


def cut_segments(
    plant: Plant, trials: Sequence[Trial]
) -> tuple[tuple[Trial, ...], tuple[int, ...]]:
    """Cut records into segments of a few periods; give these and their records' numbers."""
    lowest = lowest_frequency_hz(plant)
    cut, origin = [], []
    for number, trial in enumerate(trials):
        samples = len(trial.outputs)
        least = _samples_of_periods(SEGMENT_PERIODS, lowest, trial)
        edges = np.linspace(0, samples, max(samples // least, 1) + 1).astype(int).tolist()
        for first, last in itertools.pairwise(edges):
            cut.append(trial.part(first, last))
            origin.append(number)
    return tuple(cut), tuple(origin)


def first_periods(plant: Plant, trials: Sequence[Trial]) -> tuple[Trial, ...]:
    """Cut the first few periods out of each record; all of it without a vibration mode."""
    lowest = lowest_frequency_hz(plant)
    return tuple(
        trial.part(0, _samples_of_periods(FIRST_PERIODS, lowest, trial)) for trial in trials
    )


def strongest_segments(
    plant: Plant, trials: Sequence[Trial], count: int, share: float = 1.0
) -> tuple[Trial, ...]:
    """Cut the part of greatest power out of each record.

    Its power is `share` of the greatest; the slowest mode of the plant sets its length.
    """
    lowest = lowest_frequency_hz(plant)
    found = []
    for trial in trials:
        length = _samples_of_periods(count * SEGMENT_PERIODS, lowest, trial)
        size = np.maximum(np.std(trial.measured, axis=0), np.finfo(float).tiny)
        moved = np.sum((trial.measured / size) ** 2, axis=1)
        so_far = np.concatenate([[0.0], np.cumsum(moved)])
        power = so_far[length:] - so_far[: len(so_far) - length]
        first = int(np.argmin(np.abs(power - share * power.max())))
        found.append(trial.part(first, first + length))
    return tuple(found)


def _samples_of_periods(periods: float, lowest_hz: float, trial: Trial) -> int:
    """Give the samples of so many periods; the whole record where it is shorter."""
    whole = len(trial.outputs)
    length = int(periods / lowest_hz * trial.rate_hz) if lowest_hz else whole
    return min(max(length, MIN_SAMPLES), whole)


def initial_states_of_records(
    plant: Plant,
    trials: Sequence[Trial],
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
) -> list[State]:
    """Fit the initial state of each record to its first segment, all constants held."""
    cut, origin = cut_segments(plant, trials)
    firsts = [origin.index(number) for number in range(len(trials))]
    rest = np.zeros(len(plant.state_names))
    return [
        _fit_initial_state(
            plant,
            cut[i],
            noise.for_trials([number]),
            values,
            state_from_sensors(plant, cut[i], rest),
        ).states[0]
        for number, i in enumerate(firsts)
    ]


def lowest_frequency_hz(plant: Plant) -> float:
    """Lowest natural frequency of a vibration mode [Hz]; 0 where there are rigid modes only."""
    frequency = undamped_modes(assemble(plant.description)).frequency_hz
    own = frequency[frequency > RIGID_FREQUENCY * frequency[-1]]
    return float(own[0]) if len(own) else 0.0


def _sequential_initial_states(
    plant: Plant,
    cut: Sequence[Trial],
    origin: Sequence[int],
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    late: Callable[[], bool] | None,
) -> tuple[list[State], list[float]]:
    """Fit initial states segment by segment, each from where the run of the last one ends.

    Gives the initial states, and chi squared of each segment over its samples.
    """
    found: list[State] = []
    left: list[float] = []
    rest = np.zeros(len(plant.state_names))
    for number, piece in enumerate(cut):
        if late is not None and late():
            raise FitAbandoned
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
        own = noise.for_trials([number])
        led = state if np.isfinite(state).all() and state.size else rest
        begin = best_initial_state(
            plant, piece, own, values, [led, state_from_sensors(plant, piece, led)]
        )
        told = _fit_initial_state(plant, piece, own, values, begin)
        found.append(told.states[0])
        left.append(told.cost / max(told.data, 1))
    return found, left


def _fit_initial_state(
    plant: Plant,
    piece: Trial,
    noise: Noise,
    values: Float[np.ndarray, " parameter"],
    begin: State,
) -> Fit:
    """Fit the initial state of a segment, constants held; from rest where a run diverges."""

    def fitted(state: State) -> Fit:
        return refit(
            plant, (piece,), free=[], noise=noise, values=values, states=(state,),
            horizons=(1.0,),
        )  # fmt: skip

    # A small error of the state may cross the edge of a potential well.
    return attempt(fitted, begin) or fitted(0 * begin)
