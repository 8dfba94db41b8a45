r"""Online detection of a sudden change of level at each reading.

Beside the process that was learnt stand rivals of it, one for each recent reading, whose level
may have jumped just before. If there was no jump, the likelihood of a rival over that of the
process ever exceeds c with probability :math:`1 / c` at most (Ville, 1939). That holds for the
process it is; where a history allows many, process and rivals are families of them, each member
with its weight, so that what one of them would take for a jump may be a bend of another.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.state_space import Advanced, Belief, lifted, step

Usable = Float[np.ndarray, " usable"]

RECENT = 8
"""Readings back to which a jump is looked for."""

_CLEAR = 4.5
"""Standard deviations between neighbouring lines from which a jump is tried."""

_SIDE = 5
_SPREAD = 10.0  # squared places of five readings about their middle
_MOST = 2


@dataclasses.dataclass(frozen=True, slots=True)
class DetectorState:
    """The process, and its rivals, after some readings.

    Parameters
    ----------
    process
        Belief without a jump.
    rivals
        Beliefs with a jump before each of the last readings, oldest first.
    before
        Beliefs of the process before each of these jumps, carried on without readings.
    since
        Slow time of the last reading before each jump.
    log_odds
        Logarithm of the likelihood of each rival over that of the process.
    readings
        Taken in since each jump.
    log_weights
        Logarithms of the probabilities of the members of a family now.
    own, theirs
        Of each rival and member: logarithms of the probability of the member before the jump,
        and of its likelihood since, without and with the jump, added to it.
    """

    process: Belief
    rivals: Belief | None
    before: Belief | None
    since: Float[np.ndarray, " rival"]
    log_odds: Float[np.ndarray, " rival"]
    readings: Float[np.ndarray, " rival"]
    log_weights: Float[np.ndarray, "*family"]
    own: Float[np.ndarray, "rival ..."]
    theirs: Float[np.ndarray, "rival ..."]


@dataclasses.dataclass(frozen=True, slots=True)
class LevelChange:
    """What one reading says of a change of the model.

    Parameters
    ----------
    noticed
        Whether the model has changed.
    since
        Slow time of the last reading before the likeliest jump; NaN where there is none.
    odds
        Likelihood with that jump over that without [1].
    size, sd
        Of the jump, in the unit of the readings.
    """

    noticed: bool
    since: float
    odds: float
    size: float
    sd: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ChangeDetector:
    """Look-out for jumps.

    Parameters
    ----------
    process
        What was learnt from the history so far; a family of processes, or one.
    jump_sd
        How far a level may go, in the unit of the readings.
    odds
        Likelihood ratio from which a change is told: the mean number of readings between false
        alarms is no less.
    fewest
        Readings after a jump that must have confirmed it.
    outliers
        Share of readings that may be of no sense: the process passes over a reading that is
        likelier to be one of them, so that a single outlier is not taken for a jump.
    """

    process: SlowProcess
    jump_sd: float
    odds: float = 1000.0
    fewest: int = 2
    outliers: float = 0.01

    def start(
        self, belief: Belief, log_weights: Float[np.ndarray, "*family"] | None = None
    ) -> DetectorState:
        """Begin from a belief after the history, as `filtering.filtered` gives it.

        Parameters
        ----------
        belief
            Belief after the history.
        log_weights
            Of the members of a family; all alike where not given.

        Returns
        -------
        State of the detector.
        """
        none, family = np.zeros(0), belief.mean.shape[:-1]
        weights = np.zeros(family) if log_weights is None else log_weights
        weights = np.asarray(weights - _log_sum(weights))
        empty = np.zeros((0, *family))
        return DetectorState(belief, None, None, none, none, none, weights, empty, empty)

    def step(
        self, state: DetectorState, time: float, value: float, sd: float
    ) -> tuple[DetectorState, LevelChange]:
        """Process one reading; a `value` of NaN only advances the time.

        Parameters
        ----------
        state
            State before the reading.
        time
            Slow time of the reading.
        value
            Reading.
        sd
            Standard deviation.

        Returns
        -------
        New state, and the evidence of a change.
        """
        # All beliefs are of the same time.
        advanced = self.process.advance(np.array([time - state.process.time]))
        if value != value or sd != sd:
            state = dataclasses.replace(
                state,
                process=step(self.process, state.process, time, np.nan, np.nan, advanced)[0],
                rivals=self._predicted_belief(state.rivals, time, advanced),
                before=self._predicted_belief(state.before, time, advanced),
            )
            return state, LevelChange(False, np.nan, 0.0, np.nan, np.nan)
        kept = slice(int(len(state.since) == RECENT), None)
        old, weights = state.process, state.log_weights
        rivals = _stacked(state.rivals, kept, lifted(old, self.jump_sd))
        before = self._predicted_belief(_stacked(state.before, kept, old), time, advanced)
        rivals, read = step(self.process, rivals, time, value, sd, advanced)
        process, likelihood = self._process_step(old, weights, (time, value, sd), advanced)
        own = np.concatenate([state.own[kept], weights[None]]) + likelihood
        theirs = np.concatenate([state.theirs[kept], weights[None]]) + read.log_likelihood
        told = weights + likelihood
        watching = DetectorState(
            process,
            rivals,
            before,
            np.append(state.since[kept], old.time),
            _together(theirs) - _together(own),
            np.append(state.readings[kept], 0.0) + 1.0,
            np.asarray(told - _log_sum(told)),
            own,
            theirs,
        )
        return watching, self._judged(watching)

    def taken_over(self, state: DetectorState, since: float) -> DetectorState:
        """State in which a jump after `since` counts as known.

        Parameters
        ----------
        state
            State before the reading.
        since
            Slow time of the reading before the jump.
        """
        assert state.rivals is not None
        best = int(np.flatnonzero(state.since == since)[-1])
        rival = Belief(
            state.rivals.time, state.rivals.mean[best], state.rivals.covariance[best]
        )
        return self.start(rival, state.theirs[best])

    def _process_step(
        self,
        belief: Belief,
        weights: Float[np.ndarray, "*family"],
        given: tuple[float, float, float],
        advanced: Advanced,
    ) -> tuple[Belief, Float[np.ndarray, "*family"]]:
        """Step of the process, and the likelihood of the reading, outlier or not."""
        updated, reading = step(self.process, belief, *given, advanced)
        wide = np.asarray(reading.spread) + self.jump_sd**2
        outlying = np.log(self.outliers) - 0.5 * (
            np.asarray(reading.residual) ** 2 / wide + np.log(2 * np.pi * wide)
        )
        likelihood = np.asarray(reading.log_likelihood)
        if _log_sum(weights + outlying) > _log_sum(weights + likelihood):
            passed, _ = step(self.process, belief, given[0], np.nan, np.nan, advanced)
            return passed, np.asarray(outlying)
        return updated, likelihood

    def _predicted_belief(
        self, belief: Belief | None, time: float, advanced: Advanced
    ) -> Belief | None:
        if belief is None:
            return None
        return step(self.process, belief, time, np.nan, np.nan, advanced)[0]

    def _judged(self, state: DetectorState) -> LevelChange:
        assert state.rivals is not None
        assert state.before is not None
        able = np.where(state.readings >= self.fewest, state.log_odds, -np.inf)
        best = int(able.argmax())
        if not able[best] > -np.inf:
            return LevelChange(False, np.nan, 0.0, np.nan, np.nan)
        seen = self.process.observation
        share = np.exp(state.theirs[best] - _log_sum(state.theirs[best]))
        sizes = (state.rivals.mean[best] - state.before.mean[best]) @ seen
        spreads = (state.rivals.covariance[best] + state.before.covariance[best]) @ seen @ seen
        size = float(np.sum(share * sizes))
        spread = float(np.sum(share * (spreads + (sizes - size) ** 2)))
        return LevelChange(
            bool(able[best] > np.log(self.odds)),
            float(state.since[best]),
            float(np.exp(min(able[best], 700.0))),
            size,
            float(np.sqrt(spread)),
        )


def _together(
    logs: Float[np.ndarray, "rival ..."],
) -> Float[np.ndarray, " rival"]:
    """Sum of the probabilities of all members, in logarithms."""
    return np.asarray(np.logaddexp.reduce(logs.reshape(len(logs), -1), axis=1))


def _log_sum(logs: np.ndarray | np.floating) -> float:
    """Sum of the probabilities of a family, in logarithms.

    `scipy.special.logsumexp` takes six times as long for so few.
    """
    return float(np.logaddexp.reduce(np.ravel(logs)))


def _stacked(many: Belief | None, kept: slice, one: Belief) -> Belief:
    """Beliefs of rivals with one more behind, at the time of the newest."""
    if many is None:
        return Belief(one.time, one.mean[None], one.covariance[None])
    return Belief(
        one.time,
        np.concatenate([many.mean[kept], one.mean[None]]),
        np.concatenate([many.covariance[kept], one.covariance[None]]),
    )


def candidate_jump_times(time: Usable, value: Usable, sd: Usable) -> tuple[float, ...]:
    """Find the times after which a history may have jumped, the clearest first.

    Lines through a few readings on either side, asked for their difference in the middle.

    Parameters
    ----------
    time
        Times of the readings [slow time].
    value
        Readings; NaN where there is none.
    sd
        Standard deviations of the readings, in their unit.

    Returns
    -------
    Slow times; mostly none.
    """
    if len(time) < 2 * _SIDE + 2:
        return ()
    scatter = np.median(np.abs(np.diff(value))) / 0.954
    # Of the difference of two lines of five readings each, where they meet.
    shares = 2.0 / _SIDE + 0.5 * _SIDE**2 / _SPREAD
    windows = np.lib.stride_tricks.sliding_window_view
    five, errors = windows(value, _SIDE), windows(sd**2, 2 * _SIDE).mean(axis=1)
    means, slopes = five.mean(axis=1), five @ (np.arange(_SIDE) - 0.5 * (_SIDE - 1)) / _SPREAD
    slope = 0.5 * (slopes[:-_SIDE] + slopes[_SIDE:])
    steps = np.abs(means[_SIDE:] - means[:-_SIDE] - slope * _SIDE)
    scores = np.zeros(len(time))
    noise = np.maximum(np.maximum(errors, scatter**2), 1e-300)
    scores[_SIDE : len(time) - _SIDE + 1] = steps / np.sqrt(shares * noise)
    found: list[int] = []
    for k in np.argsort(-scores):
        if scores[k] < _CLEAR or len(found) == _MOST:
            break
        if all(abs(k - other) > _SIDE for other in found):
            found.append(int(k))
    return tuple(float(time[k - 1]) for k in found)
