"""Forecast of a change: a drifting trend plus a Matérn process.

What is learnt is a handful of processes with weights, spread over what the history allows, not
the single likeliest one: a band that takes its own length scale for certain is too narrow.
Where a history seems to repeat itself, processes with a wave stand beside those without; where
it seems to have jumped, histories with a jump beside those without; evidence weighs them.
"""

import dataclasses
from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from slowtime.estimation import filtering, hyperparameters, kernels
from slowtime.estimation.hyperparameters import HyperparameterPrior
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.state_space import Jump
from slowtime.evolution.change import Series
from slowtime.evolution.events import jump_selection
from slowtime.evolution.events.known_events import KnownEvent, is_jump

from . import continuation, wave_choice
from .continuation import Forecast
from .outlook import JumpLaw, Outlook, history, member
from .parameter_posterior import NET, ParameterPosterior, learn_parameters

Usable: TypeAlias = Float[np.ndarray, " usable"]

__all__ = ["Choice", "Forecast", "Outlook", "fit", "forecast", "predict", "prior_of"]

Choice: TypeAlias = Literal["evidence", "smooth", "repeating"]
"""Whether a history repeats itself: as the readings say, or as somebody knows."""

_UNLIKELY = 0.01
"""Probability below which a kind of process is left out."""

_MAYBE_REGULAR = 0.8
"""Regularity of jumps from which a wave is asked for beside them [1]. Twenty at random reach
0.6 at some period."""

_REGULAR, _FEWEST_REGULAR = 0.95, 5
"""Regularity, and number of jumps, from which they are edges of something that repeats itself,
as far as a wave is found at all: teeth whose height wanders by a third reach 0.98."""

_SCORING = 12
"""Members of a family by which jumps are scored once it is learnt: the likeliest."""

_FEWEST_TO_COME = 2
"""Jumps from which others are expected to come at the same rate."""

_SAME = 1
"""Readings by which jumps may move without the processes being learnt anew."""

_RELEARNT = 3
"""How often processes are learnt anew with jumps before these must have settled."""


def forecast(
    slow_time: Series,
    value: Series,
    sd: Series,
    horizon_times: Float[np.ndarray, " later"],
    *,
    level: float = 0.95,
) -> Forecast:
    """Forecast a history: `fit`, then `predict`.

    Parameters
    ----------
    slow_time
        Times of the readings [slow time].
    value
        Readings; NaN where there is none.
    sd
        Standard deviations of the readings, in their unit.
    horizon_times
        Future times [slow time].
    level
        Probability of the interval.

    Returns
    -------
    Means, standard deviations and intervals at the future times.

    Examples
    --------
    >>> t = np.arange(40.0)
    >>> ahead = forecast(t, -0.002 * t, np.full(40, 0.001), np.array([45.0]))
    >>> bool(ahead.lo[0] < -0.09 < ahead.hi[0])
    True
    """
    outlook = fit(slow_time, value, sd)
    return predict(outlook, slow_time, value, sd, horizon_times, level=level)


def fit(
    slow_time: Series,
    value: Series,
    sd: Series,
    *,
    process: Choice = "evidence",
    suspected: Sequence[float] = (),
    known: Sequence[KnownEvent] = (),
) -> Outlook:
    """Learn which processes could have made a history.

    Parameters
    ----------
    slow_time, value, sd
        The history in any order: slow times, values, and their known standard deviations;
        entries that are not finite are passed over.
    process
        ``"smooth"`` leaves waves out, ``"repeating"`` takes one for certain where least squares
        finds a period; by default their evidence decides.
    suspected
        Slow times after which somebody has seen a jump (`ChangeDetector`): tried first, however
        few readings there are since.
    known
        Events that were told. At those that move the level it may go anywhere here; how far it
        should have gone is for `continuation.begin`, which is given them too.

    Returns
    -------
    Processes with their probabilities.

    Notes
    -----
    The smoothness is the one whose best member of a net over the prior is likeliest. Length
    scale, spread, and drift of the trend then follow by Newton's method, and their posterior
    by importance sampling from fixed points about the optimum and of the net together: the
    same history gives the same outlook, to the last bit. Waves and jumps are only asked for
    where least squares finds a trace of them; a wave may have edges, as a sawtooth has.
    """
    time, values, sds = history(slow_time, value, sd)
    prior, base = prior_of(time, values)
    jump_sd = 3.0 * float(base.sd)
    given = _jumps_at_events(time, known, jump_sd)
    if given:
        prior, inner = prior_of(time, _levelled(time, values, [at for at, _ in given]))
        base = _vague(inner, base)
    sds = np.maximum(sds, 1e-6 * base.sd)
    readings = time, values, sds
    plain = _smooth(readings, prior, base, given)
    scored = jump_selection.ScoredHistory(*readings, jump_sd, known=given)
    scored = dataclasses.replace(scored, seeds=_detected_jumps(scored, suspected))
    stepped = _with_jumps(scored, base)
    if stepped is None:
        return _without_known(_with_evidence(*_with_waves(readings, plain, process)), given)
    found = _weighed(scored, plain, stepped, process)
    return _without_known(found, given)


def _weighed(
    scored: jump_selection.ScoredHistory,
    plain: "_Smooth",
    stepped: tuple[jump_selection.Places, "_Smooth"],
    process: Choice,
) -> Outlook:
    """Take the processes with jumps, or those without, as their evidence says."""
    time, readings = scored.time, (scored.time, scored.value, scored.sd)
    places, smooth = stepped
    odds = jump_selection.log_prior_odds(len(time), len(places))
    there = _with_waves(readings, smooth, process)
    without = (
        Outlook(plain.family, plain.learnt.weights, jumps=plain.told),
        plain.learnt.log_evidence,
    )
    if process == "repeating":
        without = _with_waves(readings, plain, process)
        # What is known to repeat itself has teeth where its jumps are regular.
        if (
            without[0].wave_share > 0.5
            and jump_selection.regularity(scored, places) > _MAYBE_REGULAR
        ):
            return _with_evidence(*without)
    elif (regular := jump_selection.regularity(scored, places)) > _MAYBE_REGULAR:
        surely = regular > _REGULAR and len(places) >= _FEWEST_REGULAR
        least = -np.inf if surely else there[1] - odds
        # Edges come back: a history with two of them has jumped twice.
        edges = len(places) > 1
        without = _with_waves(readings, plain, process, least, edges=edges)
        if surely and without[0].wave_share > 0.5:
            return _with_evidence(*without)
    if there[1] - odds <= without[1]:
        return _with_evidence(*without)
    further = _further(scored, places, smooth)
    return dataclasses.replace(there[0], further=further, log_evidence=there[1] - odds)


def _with_evidence(outlook: Outlook, log_evidence: float) -> Outlook:
    return dataclasses.replace(outlook, log_evidence=log_evidence)


def _jumps_at_events(
    time: Usable, known: Sequence[KnownEvent], jump_sd: float
) -> tuple[Jump, ...]:
    """Jumps at the known events that have readings on either side, one between two readings."""
    at = [e.time for e in known if is_jump(e) and time[0] <= e.time < time[-1]]
    places = np.unique(np.searchsorted(time, at, "right"))
    return tuple((float(time[place - 1]), jump_sd) for place in places.tolist())


def _detected_jumps(
    scored: jump_selection.ScoredHistory, suspected: Sequence[float]
) -> jump_selection.Places:
    """Find the readings before which a jump was seen that nobody has told of."""
    time = scored.time
    seen = np.searchsorted(time, [at for at in suspected if time[0] <= at < time[-1]], "right")
    told = scored.known_places
    return tuple(
        sorted(
            s for s in seen.tolist() if all(abs(s - k) >= jump_selection.APART for k in told)
        )
    )


def _without_known(outlook: Outlook, given: tuple[Jump, ...]) -> Outlook:
    """Leave known jumps out of an outlook: `continuation.begin` takes the events instead."""
    return dataclasses.replace(
        outlook, jumps=tuple(jump for jump in outlook.jumps if jump not in given)
    )


@dataclasses.dataclass(frozen=True, slots=True)
class _Smooth:
    """Processes without a wave, with jumps given, as they were learnt."""

    told: tuple[Jump, ...]
    prior: HyperparameterPrior
    base: SlowProcess
    family: SlowProcess
    learnt: ParameterPosterior


def _smooth(
    readings: tuple[Usable, Usable, Usable],
    prior: HyperparameterPrior,
    base: SlowProcess,
    told: tuple[Jump, ...],
    among: Sequence[float] = kernels.SMOOTHNESSES,
) -> _Smooth:
    """Learn processes without a wave, with jumps given, of one smoothness `among` these."""

    def plain(points: np.ndarray, smoothness: float) -> np.ndarray:
        family = _members(base, smoothness, points)
        return np.asarray(filtering.log_likelihood(family, *readings, jumps=told))

    net = prior.net(NET)
    scores = {s: plain(net, s) for s in among}
    density = prior.log_density(net)
    smoothness = max(scores, key=lambda s: float((scores[s] + density).max()))
    learnt = learn_parameters(
        lambda points: plain(points, smoothness), prior, scores[smoothness]
    )
    return _Smooth(told, prior, base, _members(base, smoothness, learnt.points), learnt)


def _with_jumps(
    scored: jump_selection.ScoredHistory, base: SlowProcess
) -> tuple[jump_selection.Places, _Smooth] | None:
    """Learn processes with the jumps that are selected; None where none is.

    First by processes that are calm between jumps, then by those learnt with these jumps.
    """
    time, values = scored.time, scored.value
    places = jump_selection.initial_jumps(scored, base)
    scored = scored.like_those(places)
    best: tuple[float, jump_selection.Places, _Smooth] | None = None
    among: Sequence[float] = kernels.SMOOTHNESSES
    for _ in range(_RELEARNT):
        if not places:
            break
        told = scored.jumps(places)
        # With the jumps out of it, what is left scatters less, and the prior must know.
        inner = prior_of(time, _levelled(time, values, [at for at, _ in told]))
        readings, vague = (time, values, scored.sd), _vague(inner[1], base)
        found = _smooth(readings, inner[0], vague, told, among)
        score = found.learnt.log_evidence - jump_selection.log_prior_odds(
            len(time), len(places)
        )
        if best is not None and score <= best[0]:
            break
        best = score, places, found
        top = np.argsort(-found.learnt.weights, kind="stable")[:_SCORING]
        family = _members(found.base, float(found.family.smoothness), found.learnt.points[top])
        before = np.log(found.learnt.weights[top]) - np.asarray(
            filtering.log_likelihood(family, time, values, scored.sd, jumps=told)
        )
        again, _ = jump_selection.select_jumps(scored, family, before, places)
        moved = [abs(one - other) for one, other in zip(again, places, strict=False)]
        if len(again) == len(places) and max(moved) <= _SAME:
            break
        places, among = again, (found.family.smoothness,)
    return None if best is None else best[1:]


def _further(
    scored: jump_selection.ScoredHistory, places: jump_selection.Places, smooth: _Smooth
) -> JumpLaw | None:
    """Tell how further jumps come: as often, and of such sizes, as those that were found.

    Of one nothing is told: an event that happened once need not happen again.
    """
    if len(places) < _FEWEST_TO_COME:
        return None
    sds = np.array([jump[1] for jump in smooth.told if jump not in scored.known])
    likeliest = member(smooth.family, int(smooth.learnt.weights.argmax()))
    passes = filtering.Passes(likeliest, scored.time)
    found = passes.interventions(scored.value, scored.sd, jumps=smooth.told)
    # Of a jump with variance v beforehand, given all readings: v s, and v - v S v.
    sizes = sds**2 * found.score[0, list(places)]
    mean = float(sizes.mean())
    spread = float(np.sqrt(np.sum((sizes - mean) ** 2) / (len(sizes) - 1)))
    span = float(scored.time[-1] - scored.time[0])
    return JumpLaw(len(places) / span, mean, spread, len(places))


def _with_waves(
    readings: tuple[Usable, Usable, Usable],
    smooth: _Smooth,
    process: Choice,
    beaten: float = -np.inf,
    *,
    edges: bool = True,
) -> tuple[Outlook, float]:
    """Set processes with a wave beside those without; and the evidence for all of them."""
    time, values, _ = readings
    told, learnt, family = smooth.told, smooth.learnt, smooth.family
    wave = None
    if process != "smooth":
        levelled = _levelled(time, values, [at for at, _ in told])
        wave = wave_choice.learn_periodic_process(
            readings, levelled, smooth.prior, smooth.base, told, learnt.best,
            beaten=beaten, edges=edges,
        )  # fmt: skip
    if wave is None:
        return Outlook(family, learnt.weights, jumps=told), learnt.log_evidence
    if process == "repeating":
        outlook = Outlook(family, learnt.weights, wave.family, wave.weights, 1.0, told)
        return outlook, wave.log_evidence
    both = float(np.logaddexp(learnt.log_evidence, wave.log_evidence) - np.log(2.0))
    share = float(np.exp(wave.log_evidence - np.log(2.0) - both))
    if share < _UNLIKELY:
        return Outlook(family, learnt.weights, jumps=told), both
    return Outlook(family, learnt.weights, wave.family, wave.weights, share, told), both


def predict(
    outlook: Outlook,
    slow_time: Series,
    value: Series,
    sd: Series,
    horizon_times: Float[np.ndarray, " later"],
    *,
    level: float = 0.95,
) -> Forecast:
    """Continue a history; `outlook` may come from an earlier part of it.

    Parameters
    ----------
    outlook
        What `fit` has learnt.
    slow_time, value, sd
        The history, as for `fit`.
    horizon_times
        Future slow times, ascending or not, none before the last reading.
    level
        Probability of the bands [1].

    Returns
    -------
    Mean, standard deviation and interval, in the unit of the readings.
    """
    return continuation.begin(outlook, slow_time, value, sd).predict(horizon_times, level=level)


def prior_of(time: Series, values: Series) -> tuple[HyperparameterPrior, SlowProcess]:
    """Prior of ln length, ln spread and ln drift, and a process with a vague trend.

    Parameters
    ----------
    time
        Times of the readings [slow time].
    values
        Readings.

    Returns
    -------
    Prior, and process.
    """
    prior, base = hyperparameters.weak_prior(time, values, straight=True)
    span = time[-1] - time[0]
    # The drift that would move the level by a tenth of the scatter over the whole history.
    drift = np.log(0.1 * np.sqrt(3.0) * base.sd / span**1.5)
    return HyperparameterPrior(np.append(prior.centre, drift), np.append(prior.sd, 1.5)), base


def _members(
    base: SlowProcess, smoothness: float, points: Float[np.ndarray, "family parameter"]
) -> SlowProcess:
    length, spread, drift = np.exp(points.T)
    return dataclasses.replace(
        base, smoothness=smoothness, length=length, sd=spread, slope_drift=drift
    )


def _vague(inner: SlowProcess, base: SlowProcess) -> SlowProcess:
    """Process of little scatter about a trend as vague as that of the whole history."""
    return dataclasses.replace(
        inner, centre=base.centre, level_sd=base.level_sd, slope_sd=base.slope_sd
    )


def _levelled(time: Usable, values: Usable, after: Sequence[float]) -> Usable:
    """Values with jumps taken out by least squares, about a straight line."""
    if not after:
        return values
    places = np.unique(np.searchsorted(time, after, side="right"))
    sizes = jump_selection.step_sizes(time, values, tuple(places.tolist()))
    return np.asarray(values - (np.arange(len(time))[:, None] >= places) @ sizes)
