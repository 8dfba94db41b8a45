r"""Choice of the widest frequency band in which a single mode explains the spectrum.

A wide band knows the damping best, but the model of one mode under a white force with white
noise ends where a second mode, coloured force or an anti-aliasing filter begins, and what is
fitted beyond is taken for damping. So the band grows outwards from the resonance, ring by ring;
a side ends where the ordinates no longer scatter about the fit as they must (their means over
rings are gamma distributed), or where the damping moves by more than a wider band of the same
truth could move it [1]_,

.. math:: \mathrm{var}(\hat\theta_{narrow} - \hat\theta_{wide})
          = \mathrm{var}\,\hat\theta_{narrow} - \mathrm{var}\,\hat\theta_{wide} .

References
----------
.. [1] J. A. Hausman, "Specification tests in econometrics", Econometrica 46 (1978).
"""

import dataclasses
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from .whittle import (
    DAMPING,
    FREQUENCY,
    Periodogram,
    ResonanceFit,
    fit_resonance,
    group_ordinates,
)

INNER = 8.0
"""Initial half-width of the band [half-bandwidths]; a narrower band cannot separate the floor
from the skirts."""

FEWEST_BINS = 12.0
"""Initial half-width of the band, at least [ordinates]: five parameters are fitted."""

REACH = 60.0
"""Largest half-width of the band [half-bandwidths]: more adds under 2 % of information."""

GROWTH = 1.3
"""Ratio of successive half-widths."""

MISFIT = 5e-4
"""Probability of a misfit as large under a true model, below which the band is rejected; about
ten bands are tested."""

OUTLYING = 3.5
"""Score of one ring above which the band is rejected [standard deviations]."""

MOVED = 3.5
"""Change of ln f or ln zeta with the band above which it is rejected [standard deviations]."""

SHOWN = 0.5
"""Distance of a resonance from the end of the spectrum, at least [half-bandwidths]."""

WORTH = 6.0
"""Rings with fewer ordinates are joined to their inner neighbour."""

CONTRAST = 2.0
"""Ratio of band widths that are compared for the error of the band choice."""

EXCUSED = 3.84
"""Squared score that is attributed to chance in this comparison (95 % quantile of chi-square
with one degree of freedom)."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FitBand:
    """Ordinates of the chosen band, the fit to them, and the error of having chosen it.

    Parameters
    ----------
    choice
        Variances that the choice of the band adds to those of (ln f, ln zeta).
    reach
        Half-bandwidths of the wider side.
    holds
        Whether the ordinates scatter about the fit as they must.
    """

    data: Periodogram
    fit: ResonanceFit
    choice: Float[np.ndarray, "2"]
    reach: float
    holds: bool
    edges_hz: tuple[float, float]

    @property
    def on_edge(self) -> bool:
        """Whether the resonance lies so near an end of the spectrum that it shows no peak."""
        frequency, damping = np.exp(self.fit.parameters[:2])
        inside = min(frequency - self.edges_hz[0], self.edges_hz[1] - frequency)
        return bool(inside < SHOWN * damping * frequency)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """One band: how far it goes on both sides, in rings, and what was fitted."""

    rings: tuple[int, int]
    data: Periodogram
    fit: ResonanceFit


def widest_fit_band(whole: Periodogram, start: Float[np.ndarray, "5"]) -> FitBand:
    """Grow the band of a resonance as far as a single mode explains the spectrum.

    It starts from (ln f [Hz], ln zeta, ln peak, ln floor, colour).
    """
    frequency, damping = np.exp(start[[FREQUENCY, DAMPING]])
    distances = _distances(frequency * damping, whole)
    last = len(distances) - 1
    history = [_trial(whole, frequency, distances, (0, 0), start)]
    growing = [_room(whole, frequency, distances, side) for side in (0, 1)]
    while any(growing):
        best = history[-1]
        options = [tuple(growing)]
        if all(growing):
            options += [(True, False), (False, True)]
        # One ring that scatters widely is chance; misfit that matters grows with the band.
        for step, option in product((1, 2), options):
            low, high = best.rings
            rings = (min(low + step * option[0], last), min(high + step * option[1], last))
            trial = _trial(whole, frequency, distances, rings, best.fit.parameters)
            if trial.fit.converged and _holds(trial, history[0], frequency, distances):
                history.append(trial)
                growing = [
                    on and _room(whole, frequency, distances[rings[side] :], side)
                    for side, on in enumerate(option)
                ]
                break
        else:
            growing = [False, False]
    holds = _holds(history[-1], history[0], frequency, distances)
    edges = float(whole.frequency_hz[0]), float(whole.frequency_hz[-1])
    return _extent(history, frequency * damping, distances, holds, edges)


def _distances(half_width: float, whole: Periodogram) -> np.ndarray:
    """Distances from the resonance at which rings end [Hz]."""
    inner = max(INNER * half_width, FEWEST_BINS / whole.duration_s)
    rings = int(np.ceil(np.log(max(REACH * half_width / inner, 1.0)) / np.log(GROWTH)))
    return np.asarray(inner * GROWTH ** np.arange(rings + 1))


def _room(whole: Periodogram, frequency: float, distances: np.ndarray, side: int) -> bool:
    """Whether the spectrum goes on beyond the first of the distances, on a side."""
    if len(distances) < 2:
        return False
    if side == 0:
        return bool(whole.frequency_hz[0] < frequency - distances[0])
    return bool(whole.frequency_hz[-1] > frequency + distances[0])


def _trial(
    whole: Periodogram,
    frequency: float,
    distances: np.ndarray,
    rings: tuple[int, int],
    start: np.ndarray,
) -> _Trial:
    low, high = frequency - distances[rings[0]], frequency + distances[rings[1]]
    data = group_ordinates(whole.within(low, high), float(np.exp(start[FREQUENCY])))
    return _Trial(rings, data, fit_resonance(data, start))


def _holds(trial: _Trial, inner: _Trial, frequency: float, distances: np.ndarray) -> bool:
    """Whether the ordinates of a band scatter about its fit as they must."""
    scores = ring_scores(trial.data, trial.fit.expected, frequency, distances)
    freedom = max(len(scores) - len(trial.fit.parameters), 1)
    if chdtrc(freedom, float(scores @ scores)) < MISFIT:
        return False
    if np.abs(scores).max() > OUTLYING + 0.5 * np.log10(len(scores) / 10):
        return False
    moved, gained = _contrast(inner.fit, trial.fit)
    return bool((moved**2 <= MOVED**2 * gained).all())


def ring_scores(
    data: Periodogram,
    expected: Float[np.ndarray, " frequency"],
    frequency: float,
    distances: Float[np.ndarray, " ring"],
) -> Float[np.ndarray, " score"]:
    """Score the mean ratio of ordinates to their expectation, ring by ring.

    Distances are the outer radii of the rings [Hz]; under a true model the scores are standard
    normal.
    """
    offset = data.frequency_hz - frequency
    ring = np.searchsorted(distances, np.abs(offset)) + 1
    core = np.abs(offset) < 0.25 * distances[0]
    label = np.where(core, 0, np.sign(offset) * ring).astype(int)
    ratio = data.number * data.density / expected
    scores = []
    count = total = 0.0
    for side in (-1, 0, 1):
        labels = np.unique(label[np.sign(label) == side])
        for k in sorted(labels.tolist(), key=abs):
            inside = label == k
            count, total = count + data.number[inside].sum(), total + ratio[inside].sum()
            if count >= WORTH:
                # Means of n ratios are gamma distributed; their cube roots are Gaussian (Wilson
                # and Hilferty), with variance 1 / 9 n about 1 - 1 / 9 n.
                root = (total / count) ** (1 / 3)
                scores.append(3 * np.sqrt(count) * (root - 1 + 1 / (9 * count)))
                count = total = 0.0
        count = total = 0.0
    return np.array(scores) if scores else np.zeros(1)


def _contrast(narrow: ResonanceFit, wide: ResonanceFit) -> tuple[np.ndarray, np.ndarray]:
    """Change of (ln f, ln zeta) from a narrow band to a wide one, and its variance."""
    two = slice(0, 2)
    moved = wide.parameters[two] - narrow.parameters[two]
    before, after = np.diag(narrow.covariance)[two], np.diag(wide.covariance)[two]
    # A narrower band that knows nearly as much still differs by rounding and non-linearity.
    return moved, np.maximum(before - after, 0.05 * after)


def _extent(
    history: list[_Trial],
    half_width: float,
    distances: np.ndarray,
    holds: bool,
    edges: tuple[float, float],
) -> FitBand:
    best = history[-1]
    reach = float(distances[max(best.rings)])
    narrower = [t for t in history if distances[max(t.rings)] <= reach / CONTRAST]
    choice = np.zeros(2)
    if narrower:
        moved, gained = _contrast(narrower[-1].fit, best.fit)
        choice = np.maximum(moved**2 - EXCUSED * gained, 0.0)
    return FitBand(best.data, best.fit, choice, reach / half_width, holds, edges)
