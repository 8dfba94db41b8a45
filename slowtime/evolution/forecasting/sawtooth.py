"""Sawtooth histories: positions of the edges, and a process with them.

Beside trend, Matérn process and smooth wave stands a sawtooth of the same period. Its edges
lie between readings, so that what is known of period and edge is a set of places, not a peak.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from slowtime.estimation import filtering
from slowtime.estimation.hyperparameters import HyperparameterPrior
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.processes import Sum
from slowtime.estimation.sawtooth import Sawtooth
from slowtime.estimation.state_space import Jump

from . import periodicity
from .parameter_posterior import ParameterPosterior, learn_parameters
from .periodicity import Repeating

Usable = Float[np.ndarray, " usable"]
Places = Float[np.ndarray, "place 2"]
"""Period, and time of the edge nearest the middle of the history; one place a row."""

_FEWEST = 4.0
"""Readings a tooth, below which no edge is looked for."""

_EDGES, _ASIDE = 2, 3.0
"""Edges that a history must hold, and gaps between readings on either side: one is a jump."""

_FINE = 0.25
"""How far an edge is moved from one place to the next, in gaps between readings, where a
history holds two teeth. With more of them an edge can be told more finely: those that leave
all of n edges between the right readings fill a space of about 1/n by 1/n² gaps."""

_FINER, _FOLLOWED = 5, 16
"""Parts a step is cut in at a time, and places about which: the best of the wider grid."""

_TRIED = 192
"""Places whose likelihood is asked for: the best by least squares."""

_PAIRS = 96
"""Members of the family that is learnt."""


def places(time: Usable, value: Usable, sd: Usable, period: float) -> Places:
    """Candidate places of the edges, the likeliest first.

    Least squares of a sawtooth beside a parabola and two harmonics, over all edges and periods
    about the given one.

    Parameters
    ----------
    time
        Times of the readings [slow time].
    value
        Readings; NaN where there is none.
    sd
        Standard deviations of the readings, in their unit.
    period
        Period [slow time].

    Returns
    -------
    Places; none with too few readings per tooth.
    """
    span, gap = float(time[-1] - time[0]), float(np.median(np.diff(time)))
    if period < _FEWEST * gap:
        return np.zeros((0, 2))
    weight = 1.0 / np.maximum(sd, 1e-6 * np.std(value))
    middle = 0.5 * (time[0] + time[-1])
    inside = 0.5 * span - _ASIDE * gap

    def judged(one: float, edges: Float[np.ndarray, " edge"]) -> Float[np.ndarray, "seen 3"]:
        """Period, edge, and the squares left, of those edges that come often enough."""
        before, after = middle - edges, edges - middle
        seen = 1 + np.floor((inside - before) / one) + np.floor((inside - after) / one)
        edges = edges[seen >= _EDGES]
        rest = _left_by(time, value, weight, one, edges)
        return np.column_stack([np.full(len(edges), one), edges, rest])

    step, apart = _FINE * gap, 2.0 * _FINE * gap * period / span
    periods = period + np.arange(-10.0, 10.5) * apart
    found = np.concatenate(
        [
            judged(one, middle + np.arange(-0.5 * one, 0.5 * one, step))
            for one in periods[periods > 0.5 * period]
        ]
    )
    for parts in _cuts(span / period):
        step, apart = step / parts, apart / parts
        near = found[np.argsort(found[:, 2], kind="stable")[:_FOLLOWED], :2]
        moves = np.arange(-(parts // 2), parts // 2 + 1.0)
        # Periods are rounded, as neighbours share most of their finer places.
        finer: dict[float, list[np.ndarray]] = {}
        for one, edge in near:
            for other in one + apart * moves:
                finer.setdefault(round(other / apart), []).append(edge + step * moves)
        found = np.concatenate(
            [
                judged(
                    count * apart, np.unique(np.round(np.concatenate(all_edges) / step)) * step
                )
                for count, all_edges in sorted(finer.items())
            ]
        )
    order = np.argsort(found[:, 2], kind="stable")
    return np.asarray(found[order[:_TRIED], :2])


def _cuts(rounds: float) -> list[int]:
    """In how many parts the steps are cut, one time after the other, for so many teeth."""
    cuts, finer = [], rounds / _EDGES
    while finer > 1.0:
        cuts.append(_FINER)
        finer /= _FINER
    return cuts


def _left_by(
    time: Usable,
    value: Usable,
    weight: Usable,
    period: float,
    edges: Float[np.ndarray, " edge"],
) -> Float[np.ndarray, " edge"]:
    """Squares that a sawtooth with each edge leaves beside a parabola and two harmonics.

    At the phase p of a reading and e of an edge, in rounds, a tooth is p - e, and one more
    where p < e: sums over all readings are polynomials of e, and sums over those before it.
    """
    phase = 2.0 * np.pi * time / period
    unit = (time - time[0]) / (time[-1] - time[0])
    smooth = np.column_stack(
        [np.vander(unit, 3), *(f(k * phase) for k in (1, 2) for f in (np.cos, np.sin))]
    )
    base, _ = np.linalg.qr(smooth * weight[:, None])
    left = value * weight - base @ (base.T @ (value * weight))
    rounds, places = _fraction((time - time[0]) / period), _fraction((edges - time[0]) / period)
    order = np.argsort(rounds, kind="stable")
    before = np.searchsorted(rounds[order], places)
    columns = np.column_stack([weight**2, left * weight, base * weight[:, None]])
    along = columns * rounds[:, None]
    summed = along.sum(axis=0) - places[:, None] * columns.sum(axis=0)
    products = summed + _cumulated(columns[order])[before]
    squares = (
        float(along[:, 0] @ rounds)
        - places * (along[:, 0].sum() + summed[:, 0])
        + 2.0 * _cumulated(along[order, :1])[before, 0]
        + (1.0 - 2.0 * places) * _cumulated(columns[order, :1])[before, 0]
    )
    size = squares - np.sum(products[:, 2:] ** 2, axis=1)
    return np.asarray(left @ left - products[:, 1] ** 2 / np.maximum(size, 1e-300))


def _fraction(rounds: np.ndarray) -> np.ndarray:
    return np.asarray(rounds - np.floor(rounds))


def _cumulated(columns: np.ndarray) -> np.ndarray:
    """Return sums of none, of the first, of the first two rows, and so on."""
    return np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns, axis=0)])


def members(
    base: SlowProcess, points: Float[np.ndarray, "family parameter"], where: Places
) -> Sum:
    """Family of sawtooth processes, the level first in the state.

    `points` are logarithms of length, spread, drift, size of the smooth wave, its roughness,
    memory, and half the height of the teeth; one place for each of them, or one for all.

    Parameters
    ----------
    base
        Process without a wave.
    points
        Parameters, one row per member.
    where
        Places of the edges.

    Returns
    -------
    Family.
    """
    period, edge = np.broadcast_to(where, (len(points), 2)).T
    whole = np.column_stack([points[:, :3], np.log(period), points[:, 3:6]])
    smooth = periodicity.members(base, whole)
    memory, height = np.exp(points[:, 5]), np.exp(points[:, 6])
    saw = Sawtooth(period=period.copy(), edge=edge.copy(), sd=height, memory=memory)
    return Sum((*smooth.terms, saw))


def trial(trial_of_wave: Float[np.ndarray, "family parameter"]) -> np.ndarray:
    """Parameter points at which a sawtooth is tried, from those of a wave.

    Parameters
    ----------
    trial_of_wave
        Points of the wave.

    Returns
    -------
    One row per point.
    """
    points = np.delete(trial_of_wave, 3, axis=1)
    height = points[:, 3].copy()
    points[:, 3] -= np.log(4.0)
    return np.column_stack([points, height])


def learn_teeth(
    readings: tuple[Usable, Usable, Usable],
    told: Sequence[Jump],
    base: SlowProcess,
    wave_prior: HyperparameterPrior,
    where: Places,
    begin: Float[np.ndarray, " parameter"],
) -> Repeating:
    """Fit sawtooth processes to a history.

    Parameters
    ----------
    readings, told
        Slow times, values and standard deviations; jumps that are taken for given.
    wave_prior
        Of the parameters of a wave without teeth.
    where
        Places from `places`.
    begin
        The best of `trial`.

    Returns
    -------
    Processes with teeth, and their evidence.

    Notes
    -----
    Sizes and memory are learnt with the edges where they are likeliest, then the places are
    weighed with the likeliest sizes; both together are taken for independent.
    """
    prior = HyperparameterPrior(
        np.append(np.delete(wave_prior.centre, 3), wave_prior.centre[4]),
        np.append(np.delete(wave_prior.sd, 3), wave_prior.sd[4]),
    )

    def likelihood(points: np.ndarray, at: Places) -> np.ndarray:
        family = members(base, points, at)
        return np.asarray(filtering.log_likelihood(family, *readings, jumps=told))

    def of_places(point: np.ndarray) -> np.ndarray:
        return likelihood(np.broadcast_to(point, (len(where), len(point))), where)

    best = int(of_places(begin).argmax())
    first = where[best : best + 1]
    learnt = learn_parameters(lambda points: likelihood(points, first), prior, iterations=6)
    logs = of_places(learnt.best) + _log_prior(where, wave_prior, readings[0])
    here = float(likelihood(learnt.best[None], first)[0])
    together = float(logsumexp(logs))
    family = _paired(base, learnt, where, np.exp(logs - together))
    even = np.full(_PAIRS, 1.0 / _PAIRS)
    return Repeating(family, even, learnt.log_evidence + together - here)


def _log_prior(
    where: Places, wave_prior: HyperparameterPrior, time: Usable
) -> Float[np.ndarray, " place"]:
    """Probability of each place before the readings: any edge within a period is as likely."""
    period, span = where[:, 0], float(time[-1] - time[0])
    centre, width = float(wave_prior.centre[3]), float(wave_prior.sd[3])
    away = (np.log(period) - centre) / width
    density = -0.5 * away**2 - np.log(np.sqrt(2.0 * np.pi) * width * period)
    rounds = span / np.exp(centre)
    step = _FINE * float(np.median(np.diff(time))) / np.prod(_cuts(rounds))
    return np.asarray(density + np.log(2.0 * step / rounds * step / period))


def _paired(
    base: SlowProcess,
    learnt: ParameterPosterior,
    where: Places,
    share: Float[np.ndarray, " place"],
) -> Sum:
    """Draw sizes and places with their probabilities, the same at every call."""
    even = (np.arange(_PAIRS) + 0.5) / _PAIRS
    mixed = (0.5 + np.arange(_PAIRS) * 0.6180339887498949) % 1.0
    sizes = np.searchsorted(np.cumsum(learnt.weights), even).clip(max=len(learnt.weights) - 1)
    edges = np.searchsorted(np.cumsum(share), mixed).clip(max=len(share) - 1)
    return members(base, learnt.points[sizes], where[edges])
