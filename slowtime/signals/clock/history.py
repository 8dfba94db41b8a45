"""Delay points of a clock, kept, merged and restarted at breaks."""

import dataclasses
from typing import Literal

import numpy as np

from .breaks import breaks_of, change_among, doubted
from .line_fit import ClockSpan, Line, envelope, fit, fit_points, spread_of
from .lower_hull import Point, extend, joined, lowest
from .state import ClockState
from .tolerances import ClockTolerances

MEMORY = 32
"""Shortest spans over which their typical distance from the line is averaged."""
MOST_WAITING = 240
"""Shortest spans that wait; a longer queue, drained late, says nothing of the clock."""
TURNING = 0.5
"""Share of its distance by which a waiting line must turn away to be a change of rate."""
NOTABLE = 4.0
"""Typical distances from which on a span is late, or early."""


class ClockHistory:
    """A state that takes messages; between messages, `state` is all that it knows.

    The span at hand is held apart while it grows, so that a message costs one vertex.
    """

    def __init__(
        self,
        state: ClockState,
        nominal_rate_hz: float,
        stamps: Literal["arrival", "device"],
        given: ClockTolerances,
    ) -> None:
        self._state, self._rate_hz, self._stamps = state, nominal_rate_hz, stamps
        self._given = given
        filling = state.filling
        self._number = filling.number if filling else None
        self._hull: list[Point] = list(filling.hull) if filling else []
        self._count, self._sum_x, self._sum_y = (
            (filling.count, filling.sum_x, filling.sum_y) if filling else (0, 0.0, 0.0)
        )
        self._first = (state.first_index, state.first_arrival_ns)
        self._last, self._messages, self._ignored = (
            state.last_index,
            state.messages,
            state.ignored,
        )

    @property
    def state(self) -> ClockState:
        """What is known after the last message."""
        return dataclasses.replace(
            self._state,
            filling=self._span(),
            first_index=self._first[0],
            first_arrival_ns=self._first[1],
            last_index=self._last,
            messages=self._messages,
            ignored=self._ignored,
        )

    def take(self, index: int, arrival_ns: int) -> None:
        """Take one message."""
        if self._last is None:
            self._first = (index, arrival_ns)
        elif index <= self._last:
            self._ignored += 1
            return
        self._last = index
        self._messages += 1
        x = (index - self._first[0]) / self._rate_hz
        y = (arrival_ns - self._first[1]) / 1e9 - x
        number = int(x // self._given.span_s)
        if number != self._number:
            if (span := self._span()) is not None:
                self._judge(span)
            self._number, self._hull = number, []
            self._count, self._sum_x, self._sum_y = 0, 0.0, 0.0
        extend(self._hull, (x, y))
        self._count += 1
        self._sum_x += x
        self._sum_y += y

    def _span(self) -> ClockSpan | None:
        if self._number is None:
            return None
        return ClockSpan(self._number, tuple(self._hull), self._count, self._sum_x, self._sum_y)

    def _judge(self, span: ClockSpan) -> None:
        """Take a complete shortest span in, or let it wait where it is far from the line."""
        state, line, given = self._state, self._state.line, self._given
        since_s = span.hull[-1][0] - state.history[0].hull[0][0] if state.history else 0.0
        if line is None or since_s < given.patience_s:
            self._commit((span,))
            return
        usual = not self._unusual(span, line)
        if usual:
            far_s, rough = abs(_far_s(span, line)), state.roughness_s
            rough += (min(far_s, 8 * rough + given.resolution_s) - rough) / MEMORY
            self._state = dataclasses.replace(state, roughness_s=rough)
        # One usual span after unusual ones may be a late one of a clock that was set back.
        if usual and not (state.waiting and self._unusual(state.waiting[-1], line)):
            self._state = dataclasses.replace(self._state, waiting=())
            self._commit((*state.waiting, span))
            return
        waiting = (*state.waiting, span)[-MOST_WAITING:]
        self._state = dataclasses.replace(self._state, waiting=waiting)
        since = [self._unusual(one, line) for one in reversed(waiting)]
        after = waiting[len(waiting) - since.index(False) :] if False in since else waiting
        if len(after) >= 2 * given.fewest:
            if sum(after[-1].hull[-1]) - sum(after[0].hull[0]) >= given.patience_s:
                self._begin_anew(after, line)

    def _unusual(self, span: ClockSpan, line: Line) -> bool:
        """Whether a shortest span is farther from the line than usual."""
        drift_s = 3 * line.slope_sd * abs(span.hull[-1][0] - line.x)
        usual_s = max(NOTABLE * self._state.roughness_s, 5 * self._given.resolution_s)
        return abs(_far_s(span, line)) > usual_s + drift_s

    def _begin_anew(self, waiting: tuple[ClockSpan, ...], line: Line) -> None:
        """Leave the old line: the host's clock has stepped, or the device's has changed."""
        given = self._given
        points = envelope(waiting, line.slope, given.rate_limit)
        fresh = fit_points(points, given.resolution_s)
        turned = 0.0 if fresh is None else fresh.slope - line.slope
        doubt = 0.0 if fresh is None else float(np.hypot(fresh.slope_sd, line.slope_sd))
        moved_s = abs(turned) * (waiting[-1].hull[-1][0] - waiting[0].hull[0][0])
        apart_s = float(np.median([abs(_far_s(span, line)) for span in waiting]))
        grows = moved_s > TURNING * apart_s and abs(turned) > 4 * doubt
        if not grows:
            # A change of rate since the history began would have turned the line by so much.
            since_s = waiting[-1].hull[-1][0] - self._state.history[0].hull[0][0]
            least = apart_s / since_s
            turned = max(abs(turned), least) if least < 3 * doubt else 0.0
        self._reset(waiting, 1, "rate" if grows else "step", turned)
        self._refit()

    def _reset(
        self, history: tuple[ClockSpan, ...], width: int, kind: str, turned: float
    ) -> None:
        """Keep only `history`; of what was before, what it says of the rate."""
        slope, sd, _ = self._state.posterior()
        stepped = kind == "step"
        self._state = dataclasses.replace(
            self._state,
            history=history,
            width=width,
            waiting=(),
            line=None,
            told=None,
            slope=slope,
            slope_sd=max(3 * abs(turned), sd),
            steps=self._state.steps + stepped,
            rate_changes=self._state.rate_changes + (not stepped),
            began="stepped" if stepped else "rate_changed",
        )

    def _commit(self, spans: tuple[ClockSpan, ...]) -> None:
        """Add shortest spans to the history."""
        for span in spans:
            history, width = self._state.history, self._state.width
            if history and history[-1].number == span.number // width:
                history = (*history[:-1], _merged(history[-1], span))
                self._state = dataclasses.replace(self._state, history=history)
                continue
            fresh = dataclasses.replace(span, number=span.number // width)
            self._state = dataclasses.replace(self._state, history=(*history, fresh))
            self._shorten()
            self._refit()

    def _shorten(self) -> None:
        """Make two spans one where they are too many; forget beyond the horizon."""
        state, given = self._state, self._given
        if len(state.history) <= given.spans + 1:
            return
        if given.spans * state.width * given.span_s >= given.horizon_s:
            self._state = dataclasses.replace(state, history=state.history[1:])
            return
        merged: list[ClockSpan] = []
        for span in state.history:
            half = dataclasses.replace(span, number=span.number // 2)
            if merged and merged[-1].number == half.number:
                merged[-1] = _merged(merged[-1], half)
            else:
                merged.append(half)
        self._state = dataclasses.replace(state, history=tuple(merged), width=2 * state.width)

    def _refit(self) -> None:
        """Fit the complete spans; begin anew where they hold a change."""
        given, state = self._given, self._state
        complete, told = state.history[:-1], None
        guess = state.line.slope if state.line is not None else state.slope
        line = fit(complete, given.rate_limit, given.resolution_s, guess)
        if line is not None:
            points = envelope(complete, line.slope, given.rate_limit)
            breaks = breaks_of(points, line, fewest=given.fewest, least_s=given.patience_s / 3)
            change = change_among(breaks, points, given.change)
            if change is not None:
                before = fit(complete[: change.first], given.rate_limit, given.resolution_s)
                self._state = dataclasses.replace(state, line=before, told=before)
                self._reset(
                    state.history[change.first :], state.width, change.kind, change.turned
                )
                self._refit()
                return
            told = doubted(line, breaks, len(points.x))
            if self._stamps == "arrival":
                line = _lowered(line, complete, points.kept)
        rough = self._state.roughness_s
        if line is not None and rough == 0.0:
            rough = line.scatter
        self._state = dataclasses.replace(self._state, line=line, told=told, roughness_s=rough)


def _lowered(line: Line, spans: tuple[ClockSpan, ...], kept: tuple[int, ...]) -> Line:
    """Line of the same slope through the least delays, which are the nearest to none."""
    least = np.array([spans[at].least_s(line.slope) for at in kept])
    level = float(np.sort(least)[len(least) // 2])
    scatter = spread_of(least - level)
    return dataclasses.replace(
        line,
        level=level + line.slope * line.x,
        level_sd=scatter / len(least) ** 0.5,
        scatter=scatter,
    )


def _far_s(span: ClockSpan, line: Line) -> float:
    """Least delay of a span beyond the line [s]; negative where it is early."""
    x, y = lowest(span.hull, line.slope)
    return y - line.at(x)


def _merged(left: ClockSpan, right: ClockSpan) -> ClockSpan:
    return ClockSpan(
        left.number,
        joined(left.hull, right.hull),
        left.count + right.count,
        left.sum_x + right.sum_x,
        left.sum_y + right.sum_y,
    )
