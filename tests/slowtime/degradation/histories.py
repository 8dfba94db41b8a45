"""Hidden degradation histories: drawn without any code of the laws that are to learn them."""

import dataclasses

import numpy as np

KINDS = ("fade", "linear drift", "gamma process", "crack", "logistic", "wander")
TRUE_LAW = {
    "fade": "exponential fade",
    "linear drift": "linear drift",
    "gamma process": "gamma process",
    "crack": "Paris crack",
    "logistic": "logistic",
    "wander": "Gaussian process",
}
FINE = 4000
"""Steps of the fine grid on which paths are made."""

LONGEST = 8.0
"""Unit lives after which a path that has not reached its threshold is drawn anew."""


@dataclasses.dataclass(frozen=True)
class Hidden:
    """One asset from new to failure; readings only of the first half of its life."""

    kind: str
    time: np.ndarray
    value: np.ndarray
    sd: np.ndarray
    threshold: float
    life: float

    @property
    def now(self):
        """Half of the true life."""
        return 0.5 * self.life

    @property
    def horizon(self):
        """Twice the true life: three times the age that was seen, beyond it."""
        return 2.0 * self.life


def hidden(kind: str, rng: np.random.Generator) -> Hidden:
    """Draw a history of 60 to 150 readings in the first half, noise 2 to 20 % of the threshold.

    Time is in units of 50 to 5,000; the threshold is a loss of 5 to 40 %.
    """
    limit = rng.uniform(0.05, 0.4)
    while True:
        grid, damage = MAKERS[kind](rng, limit)
        across = damage >= limit
        if across.any() and not across[0]:
            k = int(across.argmax())
            break
    if damage[k] - damage[k - 1] > 0 and kind != "gamma process":
        part = (limit - damage[k - 1]) / (damage[k] - damage[k - 1])
    else:
        part = 1.0
    life = grid[k - 1] + part * (grid[k] - grid[k - 1])
    count, half = int(rng.integers(60, 151)), 0.5 * life
    times = np.linspace(0.0, half, count)
    if rng.random() < 0.5:
        times = np.sort(rng.uniform(0.0, half, count))
    sd = np.full(len(times), limit * np.exp(rng.uniform(np.log(0.02), np.log(0.2))))
    value = -np.interp(times, grid, damage) + sd * rng.standard_normal(len(times))
    unit = np.exp(rng.uniform(np.log(50.0), np.log(5000.0)))
    return Hidden(kind, unit * times, value, sd, -limit, unit * life)


def _fade(rng, limit):
    grid = np.linspace(0.0, 2.0, FINE)
    rate = -np.log1p(-limit) * rng.uniform(0.7, 1.4)
    return grid, 1.0 - np.exp(-rate * grid)


def _linear(rng, limit):
    grid = np.linspace(0.0, 2.0, FINE)
    return grid, limit * rng.uniform(0.6, 1.7) * grid


def _gamma(rng, limit):
    grid = np.linspace(0.0, LONGEST, 4 * FINE)
    jump = limit * np.exp(rng.uniform(np.log(0.003), np.log(0.08)))
    rate = limit * rng.uniform(0.5, 2.0)
    steps = rng.gamma(rate / jump * np.diff(grid), jump)
    return grid, np.concatenate([[0.0], np.cumsum(steps)])


def _crack(rng, limit):
    """Paris' law of a centre crack, integrated by small steps; secant geometry factor.

    The threshold is the loss at which the crack has grown by a factor of 1.3 to 3.
    """
    exponent = rng.uniform(2.5, 4.5)
    depth, growth = rng.uniform(0.04, 0.2), rng.uniform(1.3, 3.0)
    softness = rng.uniform(0.5, 3.0)
    depths = np.linspace(depth, 0.97, FINE)
    factor = np.sqrt(depths / np.cos(0.5 * np.pi * depths))
    pace = factor**-exponent
    ages = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(depths))])
    flexible = -softness * np.log(np.cos(0.5 * np.pi * depths))
    lost = flexible / (1.0 + flexible)
    lost -= lost[0]
    return ages / ages[-1], limit * lost / np.interp(depth * growth, depths, lost)


def _logistic(rng, limit):
    """Growth that begins slowly: its middle comes 2 to 6 time constants after the start."""
    top = limit * rng.uniform(1.1, 2.0)
    rate = rng.uniform(2.0, 6.0)
    grid = np.linspace(0.0, 4.0, FINE)
    curve = top / (1.0 + np.exp(-rate * (grid - 1.0)))
    return grid, curve - curve[0]


def _wander(rng, limit):
    """A drift with an Ornstein-Uhlenbeck process on its rate, or on the damage itself."""
    grid = np.linspace(0.0, LONGEST, 2 * FINE)
    step = grid[1]
    memory, spread = rng.uniform(0.1, 0.6), rng.uniform(0.2, 0.8)
    on_the_rate = rng.random() < 0.5
    size = spread if on_the_rate else 0.2 * spread
    keep = np.exp(-step / memory)
    shocks = size * np.sqrt(1.0 - keep**2) * rng.standard_normal(len(grid))
    now, around = (size * rng.standard_normal() if on_the_rate else 0.0), np.empty(len(grid))
    for i, shock in enumerate(shocks):
        around[i] = now
        now = keep * now + shock
    mean = rng.uniform(0.7, 1.4)
    if on_the_rate:
        return grid, limit * step * np.cumsum(mean + around)
    return grid, limit * (mean * grid + around)


MAKERS = {
    "fade": _fade,
    "linear drift": _linear,
    "gamma process": _gamma,
    "crack": _crack,
    "logistic": _logistic,
    "wander": _wander,
}
