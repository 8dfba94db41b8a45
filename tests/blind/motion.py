"""Motion under given equations, by two integrators that share nothing.

Continuous laws go to LSODA, of variable order. Dry friction is followed from event to event: it
slips one way until its speed is zero, sticks until more is asked than it can hold.
"""

import dataclasses
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import ODEintWarning, odeint

from .equations import System

Array = NDArray[np.float64]
State = tuple[float, ...]
TOLERANCE = 1e-8
"""Of a step, relative to the size of the motion."""
SLIPS = 1e-9
"""Speeds below this, relative to their size, are zero."""
BEYOND = 1e3
"""Times its typical size beyond which a motion has left all bounds."""


class Diverged(ArithmeticError):
    """A motion that leaves all bounds, as that of a spring without resistance does."""


@dataclasses.dataclass(frozen=True, eq=False)
class Motion:
    """Relative to the base, one row a sample."""

    displacement: Array
    velocity: Array
    acceleration: Array
    inner: Array
    """States within effects."""
    base: Array
    """Acceleration of the base, all of it."""
    mode: Array
    """Of friction: the sign of its slip, 0 where it sticks."""


def move(
    system: System,
    times: Array,
    start: Sequence[float] | None = None,
    *,
    scale: tuple[float, float] = (1e-3, 1e-1),
    tolerance: float = TOLERANCE,
) -> Motion:
    """Integrate from time 0 and give the motion at `times`.

    Parameters
    ----------
    start
        All states at time 0; at rest where not given.
    scale
        Typical displacement and velocity, to which errors are related.

    Raises
    ------
    Diverged
        Where the motion grows beyond a thousand times `scale`, or cannot be followed.
    """
    n = system.rig.size
    first = tuple(start) if start is not None else (0.0,) * system.states
    sizes = np.array([scale[0]] * n + [scale[1]] * n + [scale[0]] * (system.states - 2 * n))
    follow = _smoothly if system.friction is None else _by_events
    states, mode = follow(system, times, first, sizes, tolerance)
    if not np.isfinite(states).all() or np.abs(states[:, :n]).max() > BEYOND * scale[0]:
        raise Diverged("the motion grew beyond all bounds")
    rates = np.array(
        [
            system.rates(t, m, *y)
            for t, m, y in zip(times.tolist(), mode, states.tolist(), strict=True)
        ]
    )
    base = np.zeros(len(times))
    for signal in system.base:
        base += signal.at(times)
    return Motion(
        states[:, :n], states[:, n : 2 * n], rates[:, n : 2 * n], states[:, 2 * n :], base,
        np.array(mode, float),
    )  # fmt: skip


def _smoothly(
    system: System, times: Array, first: State, sizes: Array, tolerance: float
) -> tuple[Array, list[int]]:
    rates = system.rates
    breaks = [
        placed.parameters["t_jump_s"] - system.campaign_s
        for placed in system.effects
        if placed.law.name == "stiffness_jump"
    ]
    inside = [t for t in breaks if 0 < t < times[-1]]
    grid = times if times[0] == 0 else np.concatenate([[0.0], times])
    with warnings.catch_warnings():
        warnings.simplefilter("error", ODEintWarning)
        try:
            states: Array = odeint(  # type: ignore[call-overload]
                lambda y, t: rates(t, 0, *y.tolist()), first, grid,
                rtol=tolerance, atol=tolerance * sizes, mxstep=20_000, tcrit=inside or None,
            )  # fmt: skip
        except (ODEintWarning, ArithmeticError, ValueError, IndexError) as error:
            raise Diverged(str(error)) from error
    return states[len(grid) - len(times) :], [0] * len(times)


def _by_events(
    system: System, times: Array, first: State, sizes: Array, tolerance: float
) -> tuple[Array, list[int]]:
    slider = _Slider(system, first, sizes, tolerance)
    states = np.empty((len(times), len(first)))
    modes = []
    for row, until in zip(states, times.tolist(), strict=True):
        slider.advance(until)
        row[:] = slider.state
        modes.append(slider.mode)
    return states, modes


class _Slider:
    """A rig with one dry friction, at one instant."""

    def __init__(self, system: System, first: State, sizes: Array, tolerance: float) -> None:
        self.system, self.state, self.t = system, first, 0.0
        self.tolerances = (10 * tolerance * sizes).tolist()
        self.slow = SLIPS * float(sizes[system.rig.size])
        self.size, self.bound = system.rig.size, BEYOND * float(sizes[0])
        # Short enough that no slip begins and ends unseen within a step.
        self.longest_s = 1.0 / (25.0 * float(system.rig.frequencies_hz()[-1]))
        self.step_s = self.longest_s
        speed, hold, most = system.grip(0.0, *first)
        self.mode = 0
        if abs(speed) > self.slow:
            self.mode = 1 if speed > 0 else -1
        elif abs(hold) > most:
            self.mode = 1 if hold > 0 else -1
        self.rates = system.rates(0.0, self.mode, *first)

    def advance(self, until: float) -> None:
        """Go on to `until` [s], through as many events as there are."""
        while self.t < until:
            left = until - self.t
            h = min(self.step_s, left, self.longest_s)
            state, rates, error = self.system.step(
                self.t, h, self.mode, self.rates, *self.state
            )
            worst = max(abs(e) / a for e, a in zip(error, self.tolerances, strict=True))
            if not worst < 1e9:
                raise Diverged("a step with friction has no end")
            # Towards a force without end steps would grow ever shorter, and none be the last.
            if max(map(abs, self.state[: self.size])) > self.bound:
                raise Diverged("the motion grew beyond all bounds")
            if worst > 1:
                self.step_s = h * max(0.2, 0.9 * worst**-0.2)
                continue
            if h == self.step_s or worst > 1e-3:
                self.step_s = h * min(4.0, 0.9 * max(worst, 1e-4) ** -0.2)
            if self._over(self.t + h, state):
                self._event(h)
            else:
                last = h == left
                self.t = until if last else self.t + h
                self.state, self.rates = state, rates

    def _excess(self, t: float, state: State) -> float:
        """Below zero once this mode has ended: speed in its direction, or grip that is left."""
        speed, hold, most = self.system.grip(t, *state)
        return float(self.mode * speed if self.mode else most - abs(hold))

    def _over(self, t: float, state: State) -> bool:
        margin = self.slow if self.mode else 0.0
        return self._excess(t, state) < -margin

    def _event(self, h: float) -> None:
        """Find the end of the mode within a step of `h`, go there, and choose the next mode."""
        low, high = self._bracket(h)
        if high == 0:
            self._graze(h / 1024)
            return
        below, above = self._at(low)[2], self._at(high)[2]
        for _ in range(60):
            at = (low * above - high * below) / (above - below)
            if not low < at < high:
                at = (low + high) / 2
            state, _, excess = self._at(at)
            if abs(excess) < 1e-3 * self.slow or high - low < 1e-13:
                break
            if excess < 0:
                high, above, below = at, excess, below / 2
            else:
                low, below, above = at, excess, above / 2
        self.t += at
        self._switch(state)

    def _graze(self, h: float) -> None:
        """Pass an instant at which sticking and slipping are the same to the last digit."""
        hold = self.system.grip(self.t, *self.state)[1]
        self.mode = 0 if self.mode else 1 if hold > 0 else -1
        self.rates = self.system.rates(self.t, self.mode, *self.state)
        self.state, self.rates, _ = self.system.step(
            self.t, h, self.mode, self.rates, *self.state
        )
        self.t += h

    def _at(self, h: float) -> tuple[State, State, float]:
        if h == 0:
            return self.state, self.rates, self._excess(self.t, self.state)
        state, rates, _ = self.system.step(self.t, h, self.mode, self.rates, *self.state)
        return state, rates, self._excess(self.t + h, state)

    def _bracket(self, h: float) -> tuple[float, float]:
        """Parts of a step between which the mode ends; 0, 0 where it never really began."""
        if self._at(0.0)[2] > self.slow * (1 if self.mode else 0):
            return 0.0, h
        for halvings in range(1, 11):
            low = h * 2.0**-halvings
            if self._at(low)[2] > 0:
                return low, 2 * low
        return 0.0, 0.0

    def _switch(self, state: State) -> None:
        _, hold, most = self.system.grip(self.t, *state)
        if self.mode:
            still = self._stopped(state)
            _, hold, most = self.system.grip(self.t, *still)
            stays = abs(hold) <= most
            self.mode, state = (0 if stays else 1 if hold > 0 else -1), still
        else:
            self.mode = 1 if hold > 0 else -1
        self.state = state
        self.rates = self.system.rates(self.t, self.mode, *state)

    def _stopped(self, state: State) -> State:
        """Take the last trace of speed out of the friction that has come to rest."""
        friction = self.system.friction
        assert friction is not None
        element = self.system.rig.element(friction.place)
        speed = self.system.grip(self.t, *state)[0]
        values = list(state)
        values[self.size + element.second] -= speed
        return tuple(values)
