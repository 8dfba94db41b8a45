"""Choice between smooth, edged and sawtooth periodic processes."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.estimation import filtering
from slowtime.estimation.hyperparameters import HyperparameterPrior
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.processes import Sum
from slowtime.estimation.state_space import Jump

from . import periodicity, sawtooth
from .parameter_posterior import learn_parameters
from .periodicity import Repeating

Usable = Float[np.ndarray, " usable"]

_HOPE = 20.0
"""Log-evidence that learning adds to the best trial of a wave. Measured: 15 at most on waves
and teeth of many sizes; its prior mostly takes more than it adds."""


def learn_periodic_process(
    readings: tuple[Usable, Usable, Usable],
    levelled: Usable,
    prior: HyperparameterPrior,
    base: SlowProcess,
    told: Sequence[Jump],
    smooth: Float[np.ndarray, " parameter"],
    *,
    only_teeth: bool = False,
    beaten: float = -np.inf,
    edges: bool = True,
) -> Repeating | None:
    """Fit processes with a wave; None where least squares find no period.

    Of smooth waves, waves with edges and teeth, that one is learnt of which a few trials are
    likelier. Its evidence counts how many periods were looked at.

    Parameters
    ----------
    readings, told
        Slow times, values and standard deviations; jumps that are taken for given.
    levelled
        The values with these jumps taken out.
    prior, base
        As without a wave.
    smooth
        The likeliest parameters without a wave.
    only_teeth
        Whether None is the answer where another wave is likelier than teeth.
    edges
        Whether it may jump at all.
    beaten
        Log-evidence of what else explains the history: None is the answer where all trials of
        waves are so much less likely that learning would not make up for it.

    Returns
    -------
    Processes with a wave, and their evidence; None where there is no period.
    """
    time, values, sds = readings
    period = periodicity.period_of(time, levelled, sds)
    if period is None:
        return None
    span = float(time[-1] - time[0])

    def likelihood(family: Sum) -> np.ndarray:
        return np.asarray(filtering.log_likelihood(family, time, values, sds, jumps=told))

    start = periodicity.trial(period, base, smooth, span)
    kinds = (0, periodicity.EDGED) if edges else (0,)
    scores = [float(likelihood(periodicity.members(base, start, kind)).max()) for kind in kinds]
    wave_prior = periodicity.prior_of(period, time, levelled, base, prior)
    sought = periodicity.log_sought(time, period)
    where = sawtooth.places(time, levelled, sds, period) if edges else np.zeros((0, 2))
    if len(where):
        edged = sawtooth.trial(start)
        of_teeth = likelihood(sawtooth.members(base, edged, where[:1]))
        if max(*scores, float(of_teeth.max())) < beaten - _HOPE:
            return None
        if of_teeth.max() > max(scores):
            begin = edged[int(of_teeth.argmax())]
            found = sawtooth.learn_teeth(readings, told, base, wave_prior, where, begin)
            return Repeating(found.family, found.weights, found.log_evidence - sought)
    if only_teeth or max(scores) < beaten - _HOPE:
        return None
    kind = kinds[int(np.argmax(scores))]
    learnt = learn_parameters(
        lambda points: likelihood(periodicity.members(base, points, kind)),
        wave_prior,
        iterations=6,
    )
    family = periodicity.members(base, learnt.points, kind)
    return Repeating(family, learnt.weights, learnt.log_evidence - sought)
