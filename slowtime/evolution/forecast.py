"""Where a change is heading: a drifting trend plus a Matérn process, continued with its doubt.

What is learnt is a handful of processes with weights, spread over what the history allows, not
the single likeliest one: a band that takes its own length scale for certain is too narrow.
Where a history seems to repeat itself, processes with a wave stand beside those without; where
it seems to have jumped, histories with a jump beside those without; evidence weighs them.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from slowtime.estimation import hyperparameters, kernels, matern, streaming, sweeps
from slowtime.estimation.hyperparameters import Prior
from slowtime.estimation.matern import Belief, Jump, SlowProcess
from slowtime.estimation.processes import Process, Sum

from . import mixture, repeating, selection
from .change import Series, check_level
from .learning import NET, Learnt, learn

Usable: TypeAlias = Float[np.ndarray, " usable"]

Choice: TypeAlias = Literal["evidence", "smooth", "repeating"]
"""Whether a history repeats itself: as the readings say, or as somebody knows."""

_UNLIKELY = 0.01
"""Probability below which a kind of process is left out."""

_SCORING = 12
"""Members of a family by which jumps are scored once it is learnt: the likeliest."""

_RELEARNT = 3
"""How often processes are learnt anew with jumps before these must have settled."""


@dataclasses.dataclass(frozen=True, slots=True)
class Outlook:
    """Processes that the history allows, and the weight of each.

    Parameters
    ----------
    family
        A `SlowProcess` whose parameters are arrays, one entry per member.
    weights
        Posterior probability of each member among them; they sum to one.
    wave, wave_weights
        Likewise a family of processes that repeat themselves; None where none is likely.
    wave_share
        Posterior probability of the processes with a wave, all together [1].
    jumps
        Slow times after which the level of the history has gone elsewhere, and how far it may
        have gone.
    """

    family: SlowProcess
    weights: Float[np.ndarray, " family"]
    wave: Sum | None = None
    wave_weights: Float[np.ndarray, " wave"] | None = None
    wave_share: float = 0.0
    jumps: tuple[Jump, ...] = ()

    @property
    def likeliest(self) -> SlowProcess:
        """The most probable process without a wave, to watch by (`jumps.Watch`)."""
        found = member(self.family, int(self.weights.argmax()))
        assert isinstance(found, SlowProcess)
        return found

    @property
    def period(self) -> float | None:
        """Likeliest period, in the unit of slow time; None where nothing repeats itself."""
        if self.wave is None or self.wave_weights is None or self.wave_share < 0.5:
            return None
        place = list(self.wave.free).index("period")
        return float(np.exp(self.wave_weights @ self.wave.logs[:, place]))


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


def forecast(
    slow_time: Series,
    value: Series,
    sd: Series,
    horizon_times: Float[np.ndarray, " later"],
    *,
    level: float = 0.95,
) -> Forecast:
    """`fit`, then `predict`. Keep what `fit` gives if you ask again soon: it costs the most.

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
) -> Outlook:
    """Learn from a history which processes could have made it.

    Parameters
    ----------
    slow_time, value, sd
        The history in any order: slow times, values, and their known standard deviations;
        entries that are not finite are passed over.
    process
        ``"smooth"`` leaves waves out, ``"repeating"`` takes one for certain where least squares
        finds a period; by default their evidence decides.
    suspected
        Slow times after which somebody has seen a jump (`jumps.Watch`): tried first, however
        few readings there are since.

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
    sds = np.maximum(sds, 1e-6 * base.sd)
    readings = time, values, sds
    plain = _smooth(readings, prior, base, ())
    seen = np.searchsorted(time, [at for at in suspected if time[0] <= at < time[-1]], "right")
    scored = selection.Scored(*readings, 3.0 * float(base.sd), tuple(sorted(seen.tolist())))
    stepped = _with_jumps(scored, base)
    if stepped is None:
        return _with_waves(readings, plain, process)[0]
    places, smooth = stepped
    odds = selection.penalty(len(time), len(places))
    there = _with_waves(readings, smooth, process)
    without = Outlook(plain.family, plain.learnt.weights), plain.learnt.log_evidence
    if process == "repeating":
        without = _with_waves(readings, plain, process)
    elif selection.keeps_a_beat(scored, places):
        without = _with_waves(readings, plain, process, there[1] - odds)
    return there[0] if there[1] - odds > without[1] else without[0]


@dataclasses.dataclass(frozen=True, slots=True)
class _Smooth:
    """Processes without a wave, with jumps given, as they were learnt."""

    told: tuple[Jump, ...]
    prior: Prior
    base: SlowProcess
    family: SlowProcess
    learnt: Learnt


def _smooth(
    readings: tuple[Usable, Usable, Usable],
    prior: Prior,
    base: SlowProcess,
    told: tuple[Jump, ...],
) -> _Smooth:
    """Learn processes without a wave, with jumps given."""

    def plain(points: np.ndarray, smoothness: float) -> np.ndarray:
        family = _members(base, smoothness, points)
        return np.asarray(sweeps.log_likelihood(family, *readings, jumps=told))

    net = prior.net(NET)
    scores = {s: plain(net, s) for s in kernels.SMOOTHNESSES}
    density = prior.log_density(net)
    smoothness = max(scores, key=lambda s: float((scores[s] + density).max()))
    learnt = learn(lambda points: plain(points, smoothness), prior, scores[smoothness])
    return _Smooth(told, prior, base, _members(base, smoothness, learnt.points), learnt)


def _with_jumps(
    scored: selection.Scored, base: SlowProcess
) -> tuple[selection.Places, _Smooth] | None:
    """Learn processes with the jumps that are selected; None where none is.

    First by processes that are calm between jumps, then by those learnt with these jumps.
    """
    time, values = scored.time, scored.value
    places = selection.begin(scored, base)
    scored = scored.like_those(places)
    best: tuple[float, selection.Places, _Smooth] | None = None
    for _ in range(_RELEARNT):
        if not places:
            break
        told = scored.jumps(places)
        # With the jumps out of it, what is left scatters less, and the prior must know.
        inner = prior_of(time, _levelled(time, values, [at for at, _ in told]))
        found = _smooth((time, values, scored.sd), inner[0], _vague(inner[1], base), told)
        score = found.learnt.log_evidence - selection.penalty(len(time), len(places))
        if best is not None and score <= best[0]:
            break
        best = score, places, found
        top = np.argsort(-found.learnt.weights, kind="stable")[:_SCORING]
        family = _members(found.base, float(found.family.smoothness), found.learnt.points[top])
        before = np.log(found.learnt.weights[top]) - np.asarray(
            sweeps.log_likelihood(family, time, values, scored.sd, jumps=told)
        )
        again, _ = selection.select(scored, family, before, places)
        if again == places:
            break
        places = again
    return None if best is None else best[1:]


def _with_waves(
    readings: tuple[Usable, Usable, Usable],
    smooth: _Smooth,
    process: Choice,
    beaten: float = -np.inf,
) -> tuple[Outlook, float]:
    """Set processes with a wave beside those without; and the evidence for all of them."""
    time, values, _ = readings
    told, learnt, family = smooth.told, smooth.learnt, smooth.family
    wave = None
    if process != "smooth":
        levelled = _levelled(time, values, [at for at, _ in told])
        wave = repeating.learn_wave(
            readings, levelled, smooth.prior, smooth.base, told, learnt.best, beaten=beaten
        )
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
    """
    tail = float(ndtr(-check_level(level)))
    time, values, sds = history(slow_time, value, sd)
    if horizon_times.size and not horizon_times.min() >= time[-1]:
        raise ValueError(
            f"A forecast was asked for slow time {horizon_times.min():g}, before the last "
            f"reading at {time[-1]:g}. Ask for later times; for the past there is "
            "slowtime.estimation.matern.smooth."
        )
    sds = np.maximum(sds, 1e-6 * np.min(outlook.family.sd))
    kinds = list(beliefs(outlook, time, values, sds))
    all_means, all_spreads = zip(
        *(streaming.predict(process, belief, horizon_times) for process, belief, _ in kinds),
        strict=True,
    )
    weights = np.concatenate([own for _, _, own in kinds])
    means, spreads = np.concatenate(all_means), np.concatenate(all_spreads)
    mean = weights @ means
    spread = np.sqrt(weights @ (spreads**2 + (means - mean) ** 2))
    lo, hi = (mixture.quantile(share, weights, means, spreads) for share in (tail, 1.0 - tail))
    return Forecast(mean, spread, lo, hi, float(time[-1] + _memory(outlook, kinds)))


Kind: TypeAlias = tuple[SlowProcess | Sum, Belief, np.ndarray]
"""A family of processes, what is believed of it, and the probability of each member."""


def beliefs(outlook: Outlook, time: Usable, values: Usable, sds: Usable) -> Iterator[Kind]:
    """Tell what is believed after the history, of each kind of process."""
    told = [jump for jump in outlook.jumps if jump[0] < time[-1]]
    belief, _ = matern.run(outlook.family, time, values, sds, jumps=told)
    yield outlook.family, belief, (1.0 - outlook.wave_share) * outlook.weights
    if outlook.wave is not None and outlook.wave_weights is not None:
        belief, _ = streaming.run(outlook.wave, time, values, sds, jumps=told)
        yield outlook.wave, belief, outlook.wave_share * outlook.wave_weights


def _memory(outlook: Outlook, kinds: Sequence[Kind]) -> float:
    """Length scale, times the share of the Matérn process that the readings determine.

    A wave is remembered longer: as long as it keeps its form, by the same rule.
    """
    family, belief, weights = outlook.family, kinds[0][1], kinds[0][2]
    share = 1.0 - belief.covariance[..., 2, 2] / np.square(family.sd)
    reach = float(weights @ (np.clip(share, 0.0, 1.0) * family.length))
    if outlook.wave is not None and outlook.wave_weights is not None:
        place = list(outlook.wave.free).index("length", 5)
        memory = float(np.exp(outlook.wave_weights @ outlook.wave.logs[:, place]))
        reach += outlook.wave_share * memory
    return reach


def history(slow_time: Series, value: Series, sd: Series) -> tuple[Usable, Usable, Usable]:
    """Give what of a history can be used, in ascending order of slow time."""
    usable = np.isfinite(slow_time) & np.isfinite(value) & np.isfinite(sd) & (sd >= 0.0)
    order = np.argsort(slow_time[usable], kind="stable")
    return slow_time[usable][order], value[usable][order], sd[usable][order]


def prior_of(time: Series, values: Series) -> tuple[Prior, SlowProcess]:
    """Prior on the logarithms of length, spread and drift; a process with a vague trend."""
    prior, base = hyperparameters.weak_prior(time, values, straight=True)
    span = time[-1] - time[0]
    # The drift that would move the level by a tenth of the scatter over the whole history.
    drift = np.log(0.1 * np.sqrt(3.0) * base.sd / span**1.5)
    return Prior(np.append(prior.centre, drift), np.append(prior.sd, 1.5)), base


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
    span = time[-1] - time[0]
    steps = [(time > at).astype(float) for at in after]
    design = np.column_stack([np.ones_like(time), (time - time[0]) / span, *steps])
    found = np.linalg.lstsq(design, values, rcond=None)[0]
    return np.asarray(values - design[:, 2:] @ found[2:])


def member(process: SlowProcess | Sum, number: int) -> SlowProcess | Process:
    """Take one process out of a family."""
    if isinstance(process, Sum):
        return process.member(number)
    own = {
        name: float(np.broadcast_to(getattr(process, name), np.shape(process.length))[number])
        for name in ("length", "sd", "slope_drift")
    }
    return dataclasses.replace(process, **own)
