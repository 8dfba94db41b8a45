r"""Selection of the jumps of a history: forward selection, backward elimination.

A jump after a reading is a shift of the level of a process. Its gain in log-likelihood follows
for all readings from one pass there and back (`estimation.filtering.Passes`), so that no
process is fitted anew for a jump that is only tried.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaln

from slowtime.estimation.filtering import Interventions, Passes
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.state_space import Jump

Usable = Float[np.ndarray, " usable"]
Places = tuple[int, ...]
"""Readings before which the level jumps, ascending."""

JUMP_ODDS = 100.0
"""How much likelier a history must be with jumps than without: what a single jump had to show
before several were sought, kept for the same rate of false ones."""

APART = 3
"""Readings between two jumps, and between a jump and either end: of one or two readings that
stand apart it cannot be told whether they are outliers."""

_OUTLIER = 4.0
"""Standard deviations of a reading from what all others say of it (with its own error) beyond
which it is passed over while jumps are sought: 1 in 16,000 of Gaussian readings."""

_BESIDE = 8
"""Readings on either side of a jump whose gain it explains: what else is there waits for the
next pass."""

_ROUNDS = 12
"""Passes of one forward selection, each of which takes in all maxima that are apart."""

_CALM = ((0.5, 0.3), (0.5, 1.0), (0.1, 0.3), (0.1, 1.0), (0.03, 1.0))
"""Processes without memory of jumps from which a selection begins: length over the span of the
history, and spread over the scatter from one reading to the next."""


@dataclasses.dataclass(frozen=True, slots=True)
class ScoredHistory:
    """Readings as jumps are sought in them.

    Parameters
    ----------
    jump_sd
        Standard deviation of the size of a jump.
    seeds
        Readings before which somebody has seen a jump: there it may be near an end.
    known
        Jumps that were told of: these are taken for given, and none is sought beside them.
    """

    time: Usable
    value: Usable
    sd: Usable
    jump_sd: float
    seeds: Places = ()
    known: tuple[Jump, ...] = ()

    def least_gain(self, jumps: int) -> float:
        """Log-likelihood that each of several jumps must gain, given the others.

        Odds of `JUMP_ODDS`, where a jump is as likely beforehand as so many among all readings.
        """
        return float(np.log(JUMP_ODDS * len(self.time) / max(jumps, 1)))

    def jumps(self, places: Sequence[int]) -> tuple[Jump, ...]:
        """Jumps at these places, together with the known ones.

        Parameters
        ----------
        places
            Indices of the readings after the jumps.

        Returns
        -------
        Jumps.
        """
        own = [(float(self.time[place - 1]), self.jump_sd) for place in places]
        return tuple(sorted((*own, *self.known)))

    @property
    def known_places(self) -> Places:
        """Readings before which the known jumps are."""
        found = np.searchsorted(self.time, [at for at, _ in self.known], "right")
        return tuple(found.tolist())

    def sizes(self, places: Places) -> Float[np.ndarray, " jump"]:
        """Least-squares sizes of jumps, beside the known ones.

        Parameters
        ----------
        places
            Indices of the readings after the jumps.

        Returns
        -------
        Size of each jump.
        """
        every = tuple(sorted({*places, *self.known_places}))
        sizes = step_sizes(self.time, self.value, every)
        return np.asarray(sizes[[every.index(place) for place in places]])

    @property
    def scatter(self) -> float:
        """Typical error of a reading, which jumps hardly change: steps, or what is stated."""
        steps = float(np.median(np.abs(np.diff(self.value)))) / 0.954
        return max(steps, float(np.median(self.sd)), 1e-6 * self.jump_sd)

    def like_those(self, places: Places) -> "ScoredHistory":
        """History whose prior jump size is that of the jumps at these places.

        Parameters
        ----------
        places
            Indices of the readings after the jumps.
        """
        if not places:
            return self
        sizes = self.sizes(places)
        usual = max(2.0 * float(np.sqrt(np.mean(sizes**2))), 3.0 * self.scatter)
        return dataclasses.replace(self, jump_sd=min(usual, self.jump_sd))

    def allowed(self, places: Places) -> Bool[np.ndarray, " usable"]:
        """Places where a further jump may be.

        Parameters
        ----------
        places
            Places of the jumps so far.

        Returns
        -------
        Flag of each reading.
        """
        count = len(self.time)
        free = np.zeros(count, dtype=bool)
        free[APART : max(count - APART + 1, APART)] = True
        free[[place for place in self.seeds if 0 < place < count]] = True
        for place in (*places, *self.known_places):
            free[max(place - APART + 1, 0) : place + APART] = False
        # Between readings of the same time nothing can be told apart.
        free[1:] &= np.diff(self.time) > 0.0
        free[0] = False
        return free


def log_prior_odds(count: int, jumps: int) -> float:
    """Log prior odds against a number of jumps at given places.

    Parameters
    ----------
    count
        Number of readings.
    jumps
        Number of jumps.
    """
    if not jumps:
        return 0.0
    places = gammaln(count + 1) - gammaln(jumps + 1) - gammaln(count - jumps + 1)
    return float(np.log(JUMP_ODDS) + places)


def initial_jumps(scored: ScoredHistory, base: SlowProcess) -> Places:
    """Select initial jumps with processes that vary little between jumps.

    A process learnt from a history with many jumps takes them for its own restlessness. So
    each of a few calm processes selects, and the selection under which the history is
    likeliest is taken.

    Parameters
    ----------
    scored
        Readings in which jumps are sought.
    base
        Process without jumps.

    Returns
    -------
    Places; none where no jump is clear.
    """
    span = float(scored.time[-1] - scored.time[0])
    found: list[tuple[float, Places]] = [(-np.inf, ())]
    for length, sd in _CALM:
        process = dataclasses.replace(
            base,
            smoothness=1.5,
            length=np.array([length * span]),
            sd=np.array([sd * scored.scatter]),
            slope_drift=np.array([0.0]),
        )
        places, likelihood = select_jumps(scored, process, np.zeros(1), scored.seeds)
        found.append((likelihood - log_prior_odds(len(scored.time), len(places)), places))
    return max(found, key=lambda one: one[0])[1]


def select_jumps(
    scored: ScoredHistory,
    family: SlowProcess,
    log_weights: Float[np.ndarray, " family"],
    places: Sequence[int] = (),
) -> tuple[Places, float]:
    """Select jumps by adding and removing them until nothing is gained.

    Parameters
    ----------
    scored
        Readings, known jumps, and the standard deviation of a jump's size.
    family, log_weights
        Processes, and the logarithms of their probabilities before the readings.
    places
        From which the selection begins.

    Returns
    -------
    Places of the jumps, and the log-likelihood with them.
    """
    look = _Looks(scored, Passes(family, scored.time))
    here = _separate_places(sorted(set(places)))
    value, tried = scored.value, {here}
    for _ in range(_ROUNDS):
        found = look(value, here)
        value = _without_outliers(scored, found, log_weights)
        found = look(value, here)
        added = _maxima(scored, _mixed_gain(found, log_weights, scored.jump_sd), here)
        there = tuple(sorted((*here, *added)))
        there = _eliminated(scored, functools.partial(look, value), log_weights, there)
        if there in tried:
            break
        tried.add(there)
        here = there
    found = look(scored.value, here)
    return here, float(np.logaddexp.reduce(log_weights + found.log_likelihood))


@dataclasses.dataclass(slots=True, eq=False)
class _Looks:
    """Scores of shifts given some jumps; the latest are kept, as rounds ask for them again."""

    scored: ScoredHistory
    passes: Passes
    kept: list[tuple[Usable, Places, Interventions]] = dataclasses.field(default_factory=list)

    def __call__(self, value: Usable, places: Places) -> Interventions:
        for before, given, found in self.kept:
            if given == places and np.array_equal(before, value, equal_nan=True):
                return found
        found = self.passes.interventions(
            value, self.scored.sd, jumps=self.scored.jumps(places)
        )
        self.kept = [*self.kept[-1:], (value, places, found)]
        return found


def _share(found: Interventions, log_weights: np.ndarray) -> np.ndarray:
    """Logarithm of the probability of each member after the readings."""
    told = log_weights + found.log_likelihood
    return np.asarray(told - np.logaddexp.reduce(told))


def _mixed_gain(found: Interventions, log_weights: np.ndarray, sd: float) -> Usable:
    share = _share(found, log_weights)
    return np.asarray(np.logaddexp.reduce(share[:, None] + found.gain(sd), axis=0))


def _without_outliers(
    scored: ScoredHistory, found: Interventions, log_weights: np.ndarray
) -> Usable:
    """Pass over readings that stand apart from those on either side."""
    apart = np.abs(np.exp(_share(found, log_weights)) @ found.left_out)
    return np.where(apart > _OUTLIER, np.nan, scored.value)


def _maxima(scored: ScoredHistory, gain: Usable, places: Places) -> list[int]:
    """Find the places of largest gain that are apart from each other and from those known."""
    able = np.where(scored.allowed(places), gain, -np.inf)
    around = np.pad(able, _BESIDE, constant_values=-np.inf)
    highest = np.lib.stride_tricks.sliding_window_view(around, 2 * _BESIDE + 1).max(axis=1)
    tops = np.flatnonzero(
        (able == highest) & (able > scored.least_gain(len(places) + 1))
    ).tolist()
    return [place for place in tops if able[place] > able[max(place - 1, 0)]]


def _eliminated(
    scored: ScoredHistory,
    look: Callable[[Places], Interventions],
    log_weights: np.ndarray,
    places: Places,
) -> Places:
    """Take away the jump that is missed least, until each is missed."""
    while places:
        found = look(places)
        share = _share(found, log_weights)[:, None]
        without = found.loss(scored.jump_sd)[:, list(places)]
        lost = -np.logaddexp.reduce(share - without, axis=0)
        least = int(lost.argmin())
        if lost[least] >= scored.least_gain(len(places)):
            return places
        places = (*places[:least], *places[least + 1 :])
    return places


def _separate_places(places: Sequence[int]) -> Places:
    kept: list[int] = []
    for place in places:
        if not kept or place - kept[-1] >= APART:
            kept.append(place)
    return tuple(kept)


def regularity(scored: ScoredHistory, places: Places) -> float:
    r"""Regularity of the times between jumps, as of the edges of a periodic history [1].

    Of jumps :math:`\delta_j` at :math:`t_j` it is the greatest
    :math:`|\sum_j \delta_j e^{2 \pi i r t_j / T}| / \sum_j |\delta_j|` over the number r of
    rounds in the history: one where they are regular, about :math:`1 / \sqrt k` of k at random.
    Of one or two nothing can be said, and it is one.

    Parameters
    ----------
    scored
        Readings in which jumps are sought.
    places
        Indices of the readings after the jumps.

    Returns
    -------
    1 for equal times, near 0 for random ones.
    """
    if len(places) <= 2:
        return 1.0
    span = float(scored.time[-1] - scored.time[0])
    at = scored.time[list(places)] - scored.time[0]
    sizes = scored.sizes(places)
    rounds = np.arange(1.5, 4.0 * len(places), 0.125)
    turned = np.exp(2j * np.pi * rounds[:, None] * at / span) @ sizes
    return float(np.abs(turned).max() / max(float(np.abs(sizes).sum()), 1e-300))


def step_sizes(time: Usable, values: Usable, places: Places) -> Float[np.ndarray, " jump"]:
    """Least-squares sizes of jumps, beside a straight line.

    Parameters
    ----------
    time
        Times of the readings [slow time].
    values
        Readings.
    places
        Indices of the readings after the jumps.

    Returns
    -------
    Size of each jump.
    """
    design = np.column_stack(
        [
            np.ones_like(time),
            (time - time[0]) / (time[-1] - time[0]),
            np.arange(len(time))[:, None] >= np.array(places, dtype=int),
        ]
    )
    square = design.T @ design
    if APART * len(places) > len(time):
        # Events that were told may be as many as readings, which selected jumps never are.
        square[2:, 2:] += 1e-9 * np.eye(len(places))
    # A small system, well conditioned, that is solved at once and by one thread.
    found = np.linalg.solve(square, design.T @ (values - values[0]))
    return np.asarray(found[2:])
