r"""Prediction and update of a forecast, reading by reading.

The belief of each process of the outlook is all that a forecast needs of the past, so that
neither a further reading nor a forecast costs more after many readings than after few.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from slowtime.estimation import filtering
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.processes import Sum
from slowtime.estimation.state_space import Belief, Jump, predict
from slowtime.evolution.change import Series, check_level
from slowtime.evolution.events.known_events import KnownEvent, apply_event

from . import mixture_quantile
from .outlook import JumpLaw, Outlook, history

Kind: TypeAlias = tuple[SlowProcess | Sum, Belief, np.ndarray]
"""A family of processes, what is believed of it, and the probability of each member."""


@dataclasses.dataclass(frozen=True, slots=True)
class Forecast:
    """What is expected at future slow times, without the noise of readings.

    Parameters
    ----------
    mean, sd, lo, hi
        Of the quantity itself, at each time asked for.
    horizon
        Slow time beyond which the forecast only repeats its trend: one length scale of the
        Matérn process after the last reading, less where the readings say little of that
        process. The bands hold beyond it too, as long as the trend goes on as it has.
    """

    mean: Float[np.ndarray, " later"]
    sd: Float[np.ndarray, " later"]
    lo: Float[np.ndarray, " later"]
    hi: Float[np.ndarray, " later"]
    horizon: float


@dataclasses.dataclass(frozen=True, slots=True)
class Continuation:
    """An outlook and what is believed after the last reading.

    Parameters
    ----------
    outlook
        What `forecast.fit` has learnt.
    smooth, wave
        What is believed of its processes without and with a wave; None where it has none.
    known
        Events that were told and that no reading has followed yet, in order of their time.
    """

    outlook: Outlook
    smooth: Belief
    wave: Belief | None = None
    known: tuple[KnownEvent, ...] = ()

    @property
    def time(self) -> float:
        """Slow time of the last reading."""
        return float(self.smooth.time)

    def follow(self, slow_time: Series, value: Series, sd: Series) -> "Continuation":
        """Update by further readings, at constant cost per reading.

        In portions of any size they lead to the same numbers, to the last bit.

        Parameters
        ----------
        slow_time
            Times of the readings [slow time].
        value
            Readings; NaN where there is none.
        sd
            Standard deviations of the readings, in their unit.

        Returns
        -------
        Continuation after the last reading.

        Raises
        ------
        ValueError
            Where one is earlier than the last: `begin` anew from the history in order.
        """
        time, values, sds = history(slow_time, value, sd)
        if not len(time):
            return self
        if time[0] < self.time:
            raise ValueError(
                f"A reading at slow time {time[0]:g} was given after one at {self.time:g}. "
                "Begin anew from all readings in order."
            )
        readings = time, values, _floored(self.outlook, sds)
        smooth = _followed(self.outlook.family, self.smooth, readings, known=self.known)
        wave = None
        if self.outlook.wave is not None and self.wave is not None:
            wave = _followed(self.outlook.wave, self.wave, readings, known=self.known)
        left = tuple(event for event in self.known if event.time >= time[-1])
        return dataclasses.replace(self, smooth=smooth, wave=wave, known=left)

    def now(self) -> "Continuation":
        """Give what is believed once the events after the last reading are taken in."""
        due = [event for event in self.known if event.time <= self.time]
        smooth, wave = self.smooth, self.wave
        for event in due:
            smooth = apply_event(self.outlook.family, smooth, event)
            if self.outlook.wave is not None and wave is not None:
                wave = apply_event(self.outlook.wave, wave, event)
        return dataclasses.replace(self, smooth=smooth, wave=wave, known=self.known[len(due) :])

    def predict(
        self, horizon_times: Float[np.ndarray, " later"], *, level: float = 0.95
    ) -> Forecast:
        """Forecast the quantity at future slow times, none before the last reading.

        Parameters
        ----------
        horizon_times
            Future slow times, ascending or not.
        level
            Probability of the bands [1].

        Returns
        -------
        Mean, standard deviation and interval, in the unit of the readings.
        """
        tail = float(ndtr(-check_level(level)))
        if horizon_times.size and not horizon_times.min() >= self.time:
            raise ValueError(
                f"A forecast was asked for slow time {horizon_times.min():g}, before the last "
                f"reading at {self.time:g}. Ask for later times; for the past there is "
                "slowtime.estimation.filtering.smooth."
            )
        kinds = list(self.kinds())
        all_means, all_spreads = zip(
            *(predict(process, belief, horizon_times) for process, belief, _ in kinds),
            strict=True,
        )
        weights = np.concatenate([own for _, _, own in kinds])
        means, spreads = np.concatenate(all_means), np.concatenate(all_spreads)
        if self.outlook.further is not None:
            weights, means, spreads = _with_jumps(
                self.outlook.further, horizon_times - self.time, weights, means, spreads
            )
        mean = np.sum(weights.T * means.T, axis=-1)
        spread = np.sqrt(np.sum(weights.T * (spreads**2 + (means - mean) ** 2).T, axis=-1))
        lo, hi = (
            mixture_quantile.mixture_quantile(share, weights, means, spreads)
            for share in (tail, 1.0 - tail)
        )
        return Forecast(mean, spread, lo, hi, self.horizon)

    @property
    def horizon(self) -> float:
        """Slow time beyond which the processes only repeat their trend; see `Forecast`."""
        return float(self.time + self._memory())

    def kinds(self) -> Iterator[Kind]:
        """Tell what is believed of each kind of process, and how probable its members are."""
        outlook, now = self.outlook, self.now()
        yield outlook.family, now.smooth, (1.0 - outlook.wave_share) * outlook.weights
        if outlook.wave is not None and outlook.wave_weights is not None and now.wave:
            yield outlook.wave, now.wave, outlook.wave_share * outlook.wave_weights

    def _memory(self) -> float:
        """Length scale, times the share of the Matérn process that the readings determine.

        A wave is remembered longer: as long as it keeps its form, by the same rule.
        """
        outlook, family = self.outlook, self.outlook.family
        share = 1.0 - self.now().smooth.covariance[..., 2, 2] / np.square(family.sd)
        weights = (1.0 - outlook.wave_share) * outlook.weights
        reach = float(weights @ (np.clip(share, 0.0, 1.0) * family.length))
        if outlook.wave is not None and outlook.wave_weights is not None:
            place = list(outlook.wave.free).index("length", 5)
            memory = float(np.exp(outlook.wave_weights @ outlook.wave.logs[:, place]))
            reach += outlook.wave_share * memory
        return reach


def _with_jumps(
    law: JumpLaw, ahead: Series, weights: np.ndarray, means: np.ndarray, spreads: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Set futures with further jumps beside those without; weights differ from time to time."""
    _, variance, none, number = law.moments(ahead)
    any_jump = np.maximum(1.0 - none, 1e-300)
    shift = number * law.mean
    # Of what jumps add all is in the futures that have any: law of total variance.
    square = variance / any_jump + (law.rate * ahead * law.mean) ** 2 / any_jump - shift**2
    shares = np.concatenate([weights[:, None] * none, weights[:, None] * any_jump])
    jumped = np.sqrt(spreads**2 + np.maximum(square, 0.0))
    return (
        shares / shares.sum(axis=0),
        np.concatenate([means, means + shift]),
        np.concatenate([spreads, jumped]),
    )


def begin(
    outlook: Outlook,
    slow_time: Series,
    value: Series,
    sd: Series,
    *,
    known: Sequence[KnownEvent] = (),
) -> Continuation:
    """Filter a history, in any order, from before its first reading on.

    Parameters
    ----------
    outlook
        Processes that could have made the history.
    slow_time
        Slow time of each reading.
    value
        Readings; NaN where missing.
    sd
        Their standard deviations, in the unit of the readings.
    known
        Events that were told, in any order; those before the first reading say nothing.

    Returns
    -------
    History with its processes, ready to be continued.
    """
    time, values, sds = history(slow_time, value, sd)
    readings = time, values, _floored(outlook, sds)
    told = [jump for jump in outlook.jumps if jump[0] < time[-1]]
    events = sorted((e for e in known if e.time >= time[0]), key=lambda event: event.time)
    begun = outlook.family.start(float(time[0]))
    smooth = _followed(outlook.family, begun, readings, told, events)
    wave = None
    if outlook.wave is not None:
        begun = outlook.wave.start(float(time[0]))
        wave = _followed(outlook.wave, begun, readings, told, events)
    left = tuple(event for event in events if event.time >= time[-1])
    return Continuation(outlook, smooth, wave, left)


def _followed(
    process: SlowProcess | Sum,
    belief: Belief,
    readings: tuple[np.ndarray, np.ndarray, np.ndarray],
    jumps: Sequence[Jump] = (),
    known: Sequence[KnownEvent] = (),
) -> Belief:
    """Carry a belief through readings, and through the events that some of these follow."""
    time = readings[0]
    first = 0
    for event in (*known, None):
        end = len(time) if event is None else int(np.searchsorted(time, event.time, "right"))
        if end > first:
            part = tuple(each[first:end] for each in readings)
            places = np.searchsorted(time, [at for at, _ in jumps], "right")
            own = [j for j, k in zip(jumps, places.tolist(), strict=True) if first <= k < end]
            belief = filtering.filtered(process, *part, jumps=own, belief=belief).belief
        if event is None or end == len(time):
            break
        belief, first = apply_event(process, belief, event), end
    return belief


def _floored(outlook: Outlook, sds: np.ndarray) -> np.ndarray:
    return np.asarray(np.maximum(sds, 1e-6 * np.min(outlook.family.sd)))
