"""Detects sudden changes of the level of a twin's estimates.

A process is learnt from the readings so far, and now and then anew;
`evolution.events.change_detection` asks of each reading whether a rival with a jump before one
of the last ones is likelier. Once it is, the rival takes over, and the past before the jump is
let go.
"""

import dataclasses

import numpy as np

from slowtime.estimation.filtering import filtered
from slowtime.evolution.events import change_detection
from slowtime.evolution.events.change_detection import RECENT
from slowtime.evolution.events.known_events import Repair, apply_event
from slowtime.evolution.forecasting import forecast

LEARN = 20
"""Readings that a process is first learnt from."""

MOST = 200
"""Of a longer past, as many of the newest."""

JUMP_SD = 0.1
"""How far a relative change may go at once, typically [1]."""

_GROWN = 1.5
"""By how much there must be more readings before the process is learnt anew."""

_NO_NOISE = 1e-9
"""Least standard deviation of a reading [1]: keeps weights finite."""

ANYWHERE = 1.0
"""How far a relative change may go by an event that was told [1]: all that there is."""

_LEVEL = 5
"""Readings before a jump of which the level before it is the mean."""


@dataclasses.dataclass(frozen=True, slots=True)
class DetectedChange:
    """A change of the model.

    Parameters
    ----------
    since
        Slow time of the last reading before it.
    size, sd
        How far the level went [1].
    odds
        How much likelier the readings are with it than without [1].
    before
        Mean of the last readings before it [1].
    earliest
        Slow time of the first of these.
    """

    since: float
    size: float
    sd: float
    odds: float
    before: float = float("nan")
    earliest: float = float("nan")


@dataclasses.dataclass(slots=True)
class Detector:
    """Change detector of one quantity; `take` returns the detected changes.

    Parameters
    ----------
    odds
        Likelihood ratio from which a change is told: the mean number of readings between false
        alarms is no less.
    told
        Slow times after which somebody has told that the level may have gone elsewhere.
    """

    odds: float
    told: tuple[float, ...] = ()
    past: list[tuple[float, float, float]] = dataclasses.field(default_factory=list)
    learnt_at: int = 0
    watch: change_detection.ChangeDetector | None = None
    state: change_detection.DetectorState | None = None

    def take(self, time: float, value: float, sd: float) -> DetectedChange | None:
        """Take in the next reading; one that is not later than the last is passed over.

        Parameters
        ----------
        time
            Slow time of the reading.
        value
            Value of the quantity [1].
        sd
            Its standard deviation [1].

        Returns
        -------
        The change, if this reading confirms one.
        """
        if self.past and time <= self.past[-1][0]:
            return None
        self.past.append((time, value, max(sd, _NO_NOISE)))
        found = self._step(self.past[-1])
        if found is None and len(self.past) >= max(LEARN, _GROWN * self.learnt_at) + RECENT:
            found = self._learn()
        return found

    def _step(self, reading: tuple[float, float, float]) -> DetectedChange | None:
        if self.watch is None or self.state is None:
            return None
        self._meet_told(reading[0])
        self.state, change = self.watch.step(self.state, *reading)
        if not change.noticed:
            return None
        last = [one for one in self.past if one[0] <= change.since][-_LEVEL:]
        self._go_on_after(change.since)
        before = float(np.mean([value for _, value, _ in last])) if last else float("nan")
        earliest = last[0][0] if last else change.since
        return DetectedChange(
            change.since, change.size, change.sd, change.odds, before, earliest
        )

    def _meet_told(self, until: float) -> None:
        """Let the level change freely at events reported since the last reading."""
        assert self.watch is not None
        assert self.state is not None
        since = self.state.process.time
        for at in self.told:
            if since <= at < until:
                anywhere = Repair(time=at, share=0.0, level_sd=ANYWHERE)
                belief = apply_event(self.watch.process, self.state.process, anywhere)
                self.state = self.watch.start(belief, self.state.log_weights)

    def _go_on_after(self, since: float) -> None:
        """Continue with the confirmed rival."""
        assert self.state is not None
        assert self.watch is not None
        self.state = self.watch.taken_over(self.state, since)
        self.past = [reading for reading in self.past if reading[0] > since]
        self.learnt_at = 0

    def _learn(self) -> DetectedChange | None:
        """Learn from all but the last readings, which may be after a jump, and watch these."""
        self.past = self.past[-MOST - RECENT :]
        time, value, sd = np.array(self.past[:-RECENT]).T.copy()
        self.learnt_at = len(time)
        told = [Repair(time=at) for at in self.told]
        outlook = forecast.fit(time, value, sd, process="smooth", known=told)
        self.watch = change_detection.ChangeDetector(
            process=outlook.family, jump_sd=JUMP_SD, odds=self.odds
        )
        lifts = [(at, ANYWHERE) for at in self.told if time[0] <= at < time[-1]]
        belief = filtered(
            outlook.family, time, value, sd, jumps=(*outlook.jumps, *lifts)
        ).belief
        self.state = self.watch.start(belief, np.log(outlook.weights))
        found = None
        for reading in self.past[-RECENT:]:
            found = self._step(reading) or found
        return found
