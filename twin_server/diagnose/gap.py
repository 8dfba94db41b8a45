r"""Measures the gap between a model's free run and a record, and learns its usual size.

The gap of a record is the error of the free run over the scatter of the measurement, averaged
over sensors; the initial state is that which the first fifth of the record says. Its logarithm
:math:`g` is taken to be normal as long as nothing changes, with mean and spread learnt from
:math:`n` records. Two in a row beyond :math:`\bar g + c\,s` are a disagreement, with :math:`c`
such that

.. math:: E\left[\,\Phi(-(\bar g - \mu + c\,s)/\sigma)^2\,\right] = 1 / N

over all that :math:`\bar g` and :math:`s` of :math:`n` records may be: by chance that happens
once in :math:`N` records. The model's constants are first fitted, within the tolerance that it
states, so that plain retuning is never called a disagreement. Where weather and age go on
changing the stiffness, they are fitted to each record again; effects stay as they were adopted.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.special import chdtri, ndtr, ndtri

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.calibration.prior import prior_of
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.discrepancy.validation.free_run import relative_errors
from slowtime.dynamics.plant import Plant
from slowtime_schemas.files.model_v2 import line_model
from slowtime_services.diagnose import Source, campaign_of
from slowtime_services.files import Record
from slowtime_services.models import description_of, model_file_of
from slowtime_services.plugins.effect_kinds import kinds_for

IN_A_ROW = 2
"""Records in a row beyond the limit, or within it again, that change the state."""

START = 0.2
"""Share of a record from which its initial state is estimated [1]."""

_WORST = 1e3
"""Gap at which larger ones are cut off [1], so that a diverging run stays a number."""

_SPREADS, _MEANS = 4_000, 40
"""Nodes of the grid over spreads and means by which `limit_factor` integrates."""


@dataclasses.dataclass(frozen=True, slots=True)
class GapSample:
    """The gap of one record.

    Parameters
    ----------
    gaps
        Of each model that was asked for.
    level
        Root mean square of the measurement, over sensors, each in its unit.
    """

    gaps: tuple[float, ...]
    level: float


@dataclasses.dataclass(frozen=True, slots=True)
class GapBaseline:
    """The usual gap of a model, and its limit.

    Parameters
    ----------
    expected, limit
        Median gap, and the one beyond which two in a row are a disagreement.
    level
        Typical of the records that it was learnt from.
    """

    expected: float
    limit: float
    level: float
    readings: int

    def limit_at(self, level: float) -> float:
        """Limit for a record of another level: the same noise weighs more in a weaker one.

        Parameters
        ----------
        level
            Level of the record [unit of the measurement].

        Returns
        -------
        Limit of the gap [1].
        """
        return self.limit * max(1.0, self.level / max(level, 1e-300))


def measure(
    models: Sequence[str], record: Record, refitted: bool = False, effects: tuple[str, ...] = ()
) -> GapSample:
    """Compute the gap of each model on one record.

    Parameters
    ----------
    models
        Model files as JSON.
    refitted
        Whether the constants of each, without those of its effects, are first fitted to the
        record within tolerance.
    effects
        Installed parts that hold kinds of effect beside the catalogue's.

    Raises
    ------
    ValueError
        Where record and model do not go together.
    """
    found = []
    for text in models:
        plant = _plant(text, effects)
        trial = _trial(plant, record)
        found.append(_refitted_gap(plant, trial) if refitted else _gap(plant, trial))
    return GapSample(tuple(found), float(np.sqrt(np.mean(trial.measured**2))))


def tune(model: str, records: Sequence[Record], effects: tuple[str, ...] = ()) -> str:
    """Fit a model's constants to records, within the tolerance that it states.

    Parameters
    ----------
    model
        A model file as JSON.
    effects
        Installed parts that hold kinds of effect beside the catalogue's.

    Returns
    -------
    The fitted model file as JSON.
    """
    plant = _plant(model, effects)
    fit = refit(plant, tuple(_trial(plant, record) for record in records))
    values = dict(zip(plant.parameters, fit.values.tolist(), strict=True))
    return model_file_of(with_values(plant.description, values)).model_dump_json()


def learn(readings: Sequence[tuple[float, float]], between_false_alarms: float) -> GapBaseline:
    """Learn the usual gap from records on which nothing has changed.

    Parameters
    ----------
    readings
        Gap [1] and level of each record [unit of the measurement].
    between_false_alarms
        Records between two false alarms, on average.
    """
    logs = np.log([max(gap, 1e-12) for gap, _ in readings])
    mean, spread = float(logs.mean()), max(float(logs.std(ddof=1)), 0.02)
    factor = limit_factor(len(logs), between_false_alarms)
    limit = math.exp(min(mean + factor * spread, math.log(_WORST)))
    level = math.exp(np.mean([math.log(max(level, 1e-300)) for _, level in readings]))
    return GapBaseline(math.exp(mean), limit, level, len(logs))


@functools.lru_cache(maxsize=32)
def limit_factor(count: int, between: float) -> float:
    """Return how many spreads the limit is above the mean of `count` readings.

    Parameters
    ----------
    count
        Readings from which mean and spread were learnt.
    between
        Records between two false alarms, on average.

    Examples
    --------
    >>> limit_factor(1_000, 1e4) < limit_factor(10, 1e4) < limit_factor(10, 1e6)
    True
    """
    # Small spreads are rare and matter most: the grid is as fine there as it need be.
    share = (np.arange(_SPREADS) + 0.5) / _SPREADS
    edges = share**3
    weights = np.diff(np.concatenate([[0.0], 0.5 * (edges[1:] + edges[:-1]), [1.0]]))
    spread = np.sqrt(chdtri(count - 1, 1.0 - edges) / (count - 1))
    mean = ndtri((np.arange(_MEANS) + 0.5) / _MEANS) / math.sqrt(count)

    def excess(factor: float) -> float:
        beyond = ndtr(-mean[:, None] - factor * spread[None, :]) ** IN_A_ROW
        return math.log(float(beyond.mean(axis=0) @ weights) * between + 1e-300)

    return float(brentq(excess, 0.0, 1e3))


def _gap(plant: Plant, trial: Trial) -> float:
    count = max(round(START * len(trial.outputs)), MIN_SAMPLES)
    first = refit(plant, (trial.part(0, count),), free=[], horizons=(1.0,))
    run = plant.simulate(
        plant.values, trial.inputs, trial.rate_hz,
        state0=first.states[0], start_s=trial.start_s,
    )  # fmt: skip
    return _error(trial, run)


def _refitted_gap(plant: Plant, trial: Trial) -> float:
    own = [name for name in prior_of(plant).names if name[0] != "effect"]
    fit = refit(plant, (trial,), free=own)
    run = plant.simulate(
        fit.values, trial.inputs, trial.rate_hz, state0=fit.states[0], start_s=trial.start_s
    )
    return _error(trial, run)


def _error(trial: Trial, run: Float[np.ndarray, "time sensor"]) -> float:
    with np.errstate(all="ignore"):
        return min(float(relative_errors([trial], [run]).mean()), _WORST)


def _trial(plant: Plant, record: Record) -> Trial:
    campaign, _ = campaign_of(plant.description, [Source("what arrived", record)])
    return max(campaign.trials, key=lambda trial: len(trial.outputs))


@functools.lru_cache(maxsize=8)
def _plant(model: str, effects: tuple[str, ...]) -> Plant:
    description = description_of(line_model(model))
    used = frozenset(str(entry["effect"]) for entry in description.effects)
    return Plant.of(description, kinds=kinds_for(used, effects))
