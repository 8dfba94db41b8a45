"""Alarm on changes that temperature and load do not explain."""

import dataclasses

import numpy as np
from jaxtyping import Float

from . import change_onset
from . import filter as recursion
from .change_onset import Entered, Onsets
from .change_size import ChangeEstimate, estimate_change
from .filter import CovariateBelief, CovariateInnovation
from .normal_model import NormalModel

DOUBTFUL = 5.0
"""Distance from the prediction beyond which a reading is held back [standard deviations]."""

AGREEING = 3
"""Number of successive outlying readings on one side that are accepted as a change."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class HeldReading:
    """A reading that may be an outlier."""

    time: float
    value: float
    sd: float
    features: Float[np.ndarray, " coefficient"]
    side: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class WatchState:
    """What the watch remembers between readings."""

    belief: CovariateBelief
    onsets: Onsets
    held: tuple[HeldReading, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class Judgement:
    """One reading judged.

    Parameters
    ----------
    expected, sd
        What was expected of the frequency, by all before it, in its unit.
    residual
        Reading minus expected, in standard deviations; NaN where it cannot be judged.
    evidence
        Time between false alarms at which this evidence would just raise an alarm.
    alarm
        Whether the evidence has passed the limit.
    left_out
        Why the reading was not judged, or None.
    """

    expected: float
    sd: float
    residual: float
    evidence: float
    alarm: bool
    left_out: str | None = None


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Watch:
    """Judge readings of one frequency, one at a time, at a constant cost.

    Parameters
    ----------
    normal
        What `learn_normal` has learnt.
    time_between_false_alarms
        Mean time to the first false alarm, at least, in the unit of slow time. Of several
        frequencies watched together, give each so many times the time wanted for all.
    entered
        Whether to look for a `loss`, a `gain`, or either.
    size
        Typical relative change of the frequency looked for [1].
    most
        Number of instants kept as possible onsets.
    """

    normal: NormalModel
    time_between_false_alarms: float
    entered: Entered = "loss"
    size: float = 0.01
    most: int = 48

    def __post_init__(self) -> None:
        """Refuse limits that mean nothing."""
        if not (self.time_between_false_alarms > 0.0 and self.size > 0.0 and self.most >= 3):
            raise ValueError(
                f"time_between_false_alarms={self.time_between_false_alarms}, "
                f"size={self.size}, most={self.most}: give a positive time in the unit of slow "
                "time, a relative change such as 0.01, and at least 3 onsets."
            )

    def start(self) -> WatchState:
        """Begin at the end of training, or anew after an alarm was looked into."""
        return WatchState(
            self.normal.belief, change_onset.no_onsets(len(self.normal.belief.mean))
        )

    def acknowledge(self, state: WatchState) -> WatchState:
        """State without the evidence so far, after a false alarm.

        Parameters
        ----------
        state
            State of the monitor.

        Returns
        -------
        New state.
        """
        return WatchState(state.belief, change_onset.no_onsets(len(state.belief.mean)))

    def step(
        self,
        state: WatchState,
        slow_time: float,
        frequency: float,
        frequency_sd: float,
        covariates: Float[np.ndarray, " covariate"],
    ) -> tuple[WatchState, Judgement]:
        """Judge one reading; the evidence is unchanged if it cannot be judged.

        Parameters
        ----------
        state
            State before the reading.
        slow_time
            Time of the reading.
        frequency
            Frequency [Hz].
        frequency_sd
            Standard deviation [Hz].
        covariates
            Temperature and loads of the reading.

        Returns
        -------
        New state, and the judgement.
        """
        if not slow_time >= state.belief.time:
            raise ValueError(
                f"Slow time {slow_time} is before {state.belief.time}, which has been judged. "
                "Give readings in ascending order, all later than training."
            )
        unfit = self._unfit(frequency, frequency_sd, covariates)
        if unfit is not None:
            return state, self._judgement(state, None, unfit)
        value = float(np.log(frequency)) - self.normal.centre
        features = self.normal.basis.features(covariates[None, :])[0]
        now = HeldReading(slow_time, value, frequency_sd / frequency, features, 0.0)
        _, onsets, reading = self._met(state, now)
        now = dataclasses.replace(now, side=float(np.sign(reading.residual)))
        if not self._doubtful(onsets, reading):
            after = self._updated_state(dataclasses.replace(state, held=()), now)
            return after, self._judgement(after, reading, None)
        alike = [one for one in state.held if one.side == now.side]
        state = dataclasses.replace(state, held=(*alike, now))
        if len(state.held) < AGREEING:
            return state, self._judgement(state, reading, "held back as an outlier")
        after = dataclasses.replace(state, held=())
        for one in state.held:
            after = self._updated_state(after, one)
        return after, self._judgement(after, reading, None)

    def _met(
        self, state: WatchState, now: HeldReading
    ) -> tuple[CovariateBelief, Onsets, CovariateInnovation]:
        """Carry belief and bets on to a reading, and compare it with what is expected."""
        wander = self.normal.wander
        belief = recursion.predict(state.belief, wander, now.time)
        reading = recursion.innovation(belief, wander, now.value, now.sd, now.features)
        return belief, self._faded(state.onsets, now.time - state.belief.time), reading

    def _updated_state(self, state: WatchState, now: HeldReading) -> WatchState:
        """Take a reading into belief and bets."""
        belief, onsets, reading = self._met(state, now)
        onsets = change_onset.update_onsets(
            onsets,
            now.time,
            now.time - state.belief.time,
            seen=reading.seen,
            gain=reading.gain,
            residual=reading.residual,
            variance=reading.variance,
            size=self.size,
            entered=self.entered,
        )
        belief = recursion.update(belief, reading)
        return WatchState(belief, change_onset.merge_onsets(onsets, self.most), state.held)

    def _doubtful(self, onsets: Onsets, reading: CovariateInnovation) -> bool:
        """Whether a reading is far from what is normal, and from the change believed in."""
        changed = 0.0
        if len(onsets.time):
            best = int(onsets.log_capital.argmax())
            _, mean, _ = change_onset.onset_posterior(onsets, self.size)
            changed = float(mean[best] * (1.0 - onsets.response[best] @ reading.seen))
        off = min(abs(reading.residual), abs(reading.residual - changed))
        return bool(off > DOUBTFUL * np.sqrt(reading.variance))

    def _judgement(
        self, state: WatchState, reading: CovariateInnovation | None, left_out: str | None
    ) -> Judgement:
        evidence = float(np.exp(min(state.onsets.log_total, 700.0)))
        alarm = evidence >= self.time_between_false_alarms
        if reading is None:
            return Judgement(np.nan, np.nan, np.nan, evidence, alarm, left_out)
        expected = float(np.exp(self.normal.centre + reading.expected))
        spread = float(np.sqrt(reading.variance))
        score = reading.residual / spread
        return Judgement(expected, expected * spread, score, evidence, alarm, left_out)

    def entry(self, state: WatchState, level: float = 0.95) -> ChangeEstimate:
        """Size and onset of the change, given that there is one.

        Parameters
        ----------
        state
            State of the monitor.
        level
            Probability of the interval.

        Returns
        -------
        Estimate with interval.
        """
        return estimate_change(state.onsets, self.size, self.entered, level)

    def _faded(self, onsets: Onsets, elapsed: float) -> Onsets:
        """Let what the filter has put down to the wandering part fade as that does."""
        response = onsets.response.copy()
        response[:, -1] *= self.normal.wander.kept(elapsed)
        return dataclasses.replace(onsets, response=response)

    def _unfit(
        self, frequency: float, sd: float, covariates: Float[np.ndarray, " covariate"]
    ) -> str | None:
        """Say why a reading cannot be judged."""
        if not (np.isfinite(frequency) and frequency > 0.0 and np.isfinite(sd) and sd >= 0.0):
            return "no frequency with a standard deviation"
        if not np.isfinite(covariates).all():
            return "a covariate is missing"
        if not self.normal.basis.within(covariates[None, :])[0]:
            return "covariates beyond those of the training"
        return None
