r"""Gamma process: damage that only grows, by independent gamma increments, read with noise.

.. math:: D(t + \Delta) - D(t) \sim \mathrm{Ga}(\text{shape } \alpha \Delta, \text{rate } \beta)

The parameters are the mean rate :math:`r = \alpha / \beta` and the size of a jump
:math:`\theta = 1 / \beta`. Given these, the density of the level after each reading is carried
on a grid: increments by their characteristic function :math:`(1 - i \omega \theta)^{-\alpha
\Delta}`, readings by Bayes' rule, so that no path is sampled.
"""

import dataclasses

import numpy as np
import scipy.fft
from jaxtyping import Float
from scipy.special import chdtrc, logsumexp

from .fleet import FleetPrior
from .history import LEVEL_WIDTH, History, Series
from .law import Drawn
from .sampling import WeightedPoints, importance_sample

CELLS = 256
"""Cells of the grid of the level [1]."""

POINTS, ROUNDS = 40, 2
"""Parameter points of each proposal, and proposals after the first [1]."""

MOST = 40
"""Readings that are carried one by one [1]; of a longer history, neighbours are averaged."""

COARSEST = 0.8
"""Least sd of a reading over the width of a cell [1]: below, the grid would alias it."""

THETA_CENTRE, THETA_WIDTH = 0.3, 1.2
"""Prior of the size of a jump: its centre over the scatter, and the sd of its logarithm [1]."""

AMBIGUOUS = 3.0
"""Slope over its sd below which both directions are learnt [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class GammaLaw:
    """Gamma process as a law that learns: see `law.Law`."""

    name: str = "gamma process"

    def learn(self, history: History, fleet: FleetPrior | None = None) -> "GammaPosterior":
        """Sample rate and size of jumps, with a grid of the level for each."""
        slope, error = history.slope
        signs = [1.0 if slope > 0 else -1.0]
        if abs(slope) < AMBIGUOUS * error:
            signs.append(-signs[0])
        parts = tuple(_direction(history, sign, slope, error, fleet) for sign in signs)
        return GammaPosterior(history, parts)


@dataclasses.dataclass(frozen=True, slots=True)
class Direction:
    """What is believed of a gamma process that grows in one direction.

    Parameters
    ----------
    sign
        1 where the quantity grows, -1 where it falls.
    sample
        Logarithms of r [reading / time] and theta [reading], with importance weights.
    low, cell
        Lower end of the grid of the level times sign, and the width of a cell.
    log_likelihood, misfit, count
        As for `curve_posterior.CurvePosterior`.
    """

    sign: float
    sample: WeightedPoints
    low: float
    cell: float
    time: float
    density: Float[np.ndarray, "point cell"]
    log_likelihood: Float[np.ndarray, " point"]
    misfit: Float[np.ndarray, " point"]
    count: int


@dataclasses.dataclass(frozen=True, slots=True)
class GammaPosterior:
    """What is believed of a gamma process: see `law.Posterior`."""

    history: History
    parts: tuple[Direction, ...]

    @property
    def log_evidence(self) -> float:
        """See `law.Posterior`."""
        each = [logsumexp(_log_weight(one)) for one in self.parts]
        return float(logsumexp(each) - np.log(2.0))

    @property
    def p_value(self) -> float:
        """See `law.Posterior`."""
        weight = self._weights()
        freedom = max(self.parts[0].count - 2, 1)
        return float(
            weight @ chdtrc(freedom, np.concatenate([one.misfit for one in self.parts]))
        )

    def _weights(self) -> Float[np.ndarray, " point"]:
        """Posterior probability of each point of all directions."""
        log = np.concatenate([_log_weight(one) for one in self.parts])
        weight = np.exp(log - log.max())
        return np.asarray(weight / weight.sum())

    def follow(self, time: Series, value: Series, sd: Series) -> "GammaPosterior":
        """Update the belief by further readings, at a constant cost each."""
        parts = tuple(_followed(self.history, one, time, value, sd) for one in self.parts)
        return dataclasses.replace(self, parts=parts)

    def draw(
        self, later: Float[np.ndarray, " later"], count: int, rng: np.random.Generator
    ) -> Drawn:
        """Sample paths at future slow times, the first of which is the last reading's."""
        owners = rng.choice(len(weight := self._weights()), size=count, p=weight)
        density = np.concatenate([one.density for one in self.parts])[owners]
        sizes = [len(one.sample.points) for one in self.parts]
        sign, low, cell = (
            np.repeat([getattr(one, name) for one in self.parts], sizes)[owners]
            for name in ("sign", "low", "cell")
        )
        rate, theta = np.exp(
            np.concatenate([one.sample.points for one in self.parts])[owners]
        ).T
        below = np.cumsum(density, axis=1)
        at = rng.random(count) * below[:, -1]
        place = np.minimum((below < at[:, None]).sum(axis=1), density.shape[1] - 1)
        level = low + (place + rng.random(count)) * cell
        steps = np.diff(later, prepend=later[0])
        shape = np.outer(rate / theta, steps)
        jumps = rng.standard_gamma(np.maximum(shape, 1e-12)) * theta[:, None]
        paths = sign[:, None] * (level[:, None] + np.cumsum(jumps, axis=1))
        return Drawn(paths, np.zeros(count))

    def hyperparameters(self) -> FleetPrior | None:
        """Give the signed rate, and the logarithm of the size of a jump."""
        weight = self._weights()
        points = np.concatenate(
            [
                np.column_stack(
                    (one.sign * np.exp(one.sample.points[:, 0]), one.sample.points[:, 1])
                )
                for one in self.parts
            ]
        )
        mean = weight @ points
        around = points - mean
        return FleetPrior("gamma process", mean, (around * weight[:, None]).T @ around)


def _log_weight(one: Direction) -> Float[np.ndarray, " point"]:
    return np.asarray(one.sample.log_base + one.log_likelihood)


def _direction(
    history: History, sign: float, slope: float, error: float, fleet: FleetPrior | None
) -> Direction:
    """Learn parameters of a process that grows in one direction."""
    thinned = _thinned(history)
    level = sign * thinned.value
    margin = 5.0 * float(np.median(thinned.sd))
    reach = float(np.ptp(level))
    low, high = level.min() - margin - 0.1 * reach, level.max() + margin + 0.5 * reach
    cell = (high - low) / CELLS
    wide = LEVEL_WIDTH * history.scatter / history.span
    centre = np.log(
        [max(sign * slope, 0.5 * error) / history.span, THETA_CENTRE * history.scatter]
    )
    width = np.array([min(0.5 + error / max(abs(slope), error), 1.0), THETA_WIDTH])

    def log_prior(points: np.ndarray) -> np.ndarray:
        rate = np.exp(points[:, 0])
        jump = (points[:, 1] - centre[1]) / THETA_WIDTH
        if fleet is not None:
            around = np.column_stack((sign * rate, points[:, 1])) - fleet.mean
            covariance = fleet.covariance + 1e-12 * np.diag(np.diag(fleet.covariance))
            square = np.einsum("pi,ij,pj->p", around, np.linalg.inv(covariance), around)
            shared = np.linalg.slogdet(2.0 * np.pi * covariance)[1]
            return np.asarray(-0.5 * (square + shared) + points[:, 0] + np.log(2.0))
        of_rate = (
            -0.5 * (rate / wide) ** 2 - np.log(0.5 * np.sqrt(2.0 * np.pi) * wide) + points[:, 0]
        )
        of_jump = -0.5 * jump**2 - np.log(np.sqrt(2.0 * np.pi) * THETA_WIDTH)
        return np.asarray(of_rate + of_jump)

    def log_first(points: np.ndarray) -> np.ndarray:
        scaled = (points - centre) / width
        return np.asarray(
            -0.5 * np.sum(scaled**2, axis=1) - np.log(width).sum() - np.log(2.0 * np.pi)
        )

    def begun(sample: WeightedPoints) -> Direction:
        number = len(sample.points)
        vague = np.exp(-0.5 * ((low + (np.arange(CELLS) + 0.5) * cell - sign * history.centre)
                               / (LEVEL_WIDTH * history.scatter)) ** 2)  # fmt: skip
        vague *= cell / (np.sqrt(2.0 * np.pi) * LEVEL_WIDTH * history.scatter)
        zero = np.zeros(number)
        return Direction(
            sign, sample, float(low), float(cell), float(thinned.time[0]),
            np.tile(vague, (number, 1)), zero, zero, 0,
        )  # fmt: skip

    def log_likelihood(points: np.ndarray) -> np.ndarray:
        one = begun(WeightedPoints(points, np.zeros(len(points))))
        return _followed(history, one, thinned.time, thinned.value, thinned.sd).log_likelihood

    sample = importance_sample(
        log_likelihood, log_prior, lambda n: centre + width * n, log_first, 2,
        points=POINTS, rounds=ROUNDS,
    )  # fmt: skip
    found = _followed(history, begun(sample), thinned.time, thinned.value, thinned.sd)
    # What averages of neighbours lack of the density of all readings: their scatter within.
    return dataclasses.replace(found, log_likelihood=found.log_likelihood + thinned.log_within)


@dataclasses.dataclass(frozen=True, slots=True)
class _Thinned:
    time: Series
    value: Series
    sd: Series
    log_within: float


def _thinned(history: History) -> _Thinned:
    """Average neighbours by their precision, until at most `MOST` readings are left."""
    number = len(history.time)
    if number <= MOST:
        return _Thinned(history.time, history.value, history.sd, 0.0)
    begins = np.unique(np.linspace(0, number, MOST + 1).astype(int)[:-1])
    weight = 1.0 / history.sd**2
    total = np.add.reduceat(weight, begins)
    time, value = (
        np.add.reduceat(weight * one, begins) / total for one in (history.time, history.value)
    )
    sd = total**-0.5
    owner = np.searchsorted(begins, np.arange(number), side="right") - 1
    square = (history.value - value[owner]) ** 2 * weight
    within = -0.5 * (square.sum() + np.log(2.0 * np.pi / weight).sum())
    within += 0.5 * np.log(2.0 * np.pi * sd**2).sum()
    return _Thinned(time, value, sd, float(within))


def _followed(
    history: History, one: Direction, time: Series, value: Series, sd: Series
) -> Direction:
    """Carry the density of the level through readings, for every point at once."""
    rate, theta = np.exp(one.sample.points).T
    # Beyond what floats hold in the grid's unit, a jump is as good as none or as all.
    omega = 2.0 * np.pi * scipy.fft.rfftfreq(CELLS, one.cell)
    base = np.log1p(1j * theta[:, None] * omega)
    shape = (rate / theta)[:, None]
    density, low = one.density, one.low
    total, misfit, now, count = (
        one.log_likelihood.copy(),
        one.misfit.copy(),
        one.time,
        one.count,
    )
    least = COARSEST * one.cell
    kernels: dict[float, np.ndarray] = {}

    def moved(density: np.ndarray, step: float) -> np.ndarray:
        if step <= 0.0:
            return density
        key = float(f"{step:.12g}")
        if key not in kernels:
            kernels.clear()
            kernels[key] = np.exp(-shape * key * base)
        spectrum = scipy.fft.rfft(density, axis=1) * kernels[key]
        return np.maximum(scipy.fft.irfft(spectrum, CELLS, axis=1), 0.0)

    for at, seen, spread in zip(time.tolist(), value.tolist(), sd.tolist(), strict=True):
        if not (np.isfinite(seen) and np.isfinite(spread)):
            continue
        for event in history.events:
            if now < event.time <= at:
                density = moved(density, event.time - now)
                density = _changed(density, low, one, history, event.restored, event.sd, omega)
                now = event.time
        density = moved(density, at - now)
        now, level = at, one.sign * seen
        beyond = int(np.ceil((level + 6.0 * max(spread, least) - low) / one.cell)) - CELLS
        if beyond > 0:
            shift = min(beyond + CELLS // 8, CELLS)
            density = np.pad(density[:, shift:], ((0, 0), (0, shift)))
            low += shift * one.cell
        wide = max(spread, least)
        places = low + (np.arange(CELLS) + 0.5) * one.cell
        like = np.exp(-0.5 * ((level - places) / wide) ** 2) / (np.sqrt(2.0 * np.pi) * wide)
        if count >= 2:
            mass = np.maximum(density.sum(axis=1), 1e-300)
            mean = density @ places / mass
            variance = density @ places**2 / mass - mean**2 + wide**2
            misfit += (level - mean) ** 2 / np.maximum(variance, 1e-300)
        density = density * like
        own = np.maximum(density.sum(axis=1), 1e-300)
        density = density / own[:, None]
        total += np.log(own)
        count += 1
    return dataclasses.replace(
        one,
        low=low,
        time=now,
        density=density,
        log_likelihood=total,
        misfit=misfit,
        count=count,
    )


def _changed(
    density: np.ndarray,
    low: float,
    one: Direction,
    history: History,
    restored: float,
    sd: float,
    omega: np.ndarray,
) -> np.ndarray:
    """Move the level by an event: a share of the damage restored, and a shift of sd."""
    places = low + (np.arange(CELLS) + 0.5) * one.cell
    if restored > 0.0:
        left, base = (
            max(1.0 - restored, 2.0 * one.cell / (CELLS * one.cell)),
            one.sign * float(history.value[0]),
        )
        source = base + (places - base) / left
        density = np.array([np.interp(source, places, row, 0.0, 0.0) for row in density]) / left
        sd = float(np.hypot(sd, COARSEST * one.cell))
    if sd > 0.0:
        spectrum = scipy.fft.rfft(density, axis=1) * np.exp(-0.5 * (omega * sd) ** 2)
        density = np.maximum(scipy.fft.irfft(spectrum, CELLS, axis=1), 0.0)
    return density
