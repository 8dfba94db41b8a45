r"""Removes the effect of covariates from one frequency, and tests the residual for changes.

With the law :math:`\ln f = \bar y + \phi(c)^T \beta + a + \varepsilon` that training has left,
a frequency as it would have been at the reference is

.. math:: f \, e^{-(\phi(c) - \phi(c_0))^T \beta}

and it is off by what the law leaves, :math:`\sigma_a^2 + \sigma_w^2`, afresh in each reading or
nearly so, and by the error of the law, :math:`\phi(c)^T P \phi(c)`, which is much the same in
readings under the same covariates.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from slowtime.evolution.covariates import ChangeEstimate, NormalModel, Watch, learn_normal
from slowtime_schemas.messages import Features
from twin_server.history import states as st
from twin_server.registration.nominal import Covariates

from .stored import StoredNormal, StoredWatch
from .training import Training

SPANS = 10.0
"""Spans of training between false alarms, where the registration does not say."""

CALM = 0.1
"""Share of the limit below which evidence must fall for an alarm to end."""

_LEAST_SD = 1e-9
"""Least standard deviation of a frequency over the frequency [1]: keeps weights finite."""


class NotLearntError(ValueError):
    """No law could be learnt from the training readings."""


class Removed(NamedTuple):
    """Effect of some covariates on a frequency, with its standard deviation.

    Parameters
    ----------
    factor
        What the frequency is multiplied with; NaN where a covariate is missing.
    own_sd
        Relative sd of what the law leaves of a reading.
    law_sd, difference_sd
        Relative sd of the law itself at these covariates, and of its difference to that at
        the reference.
    reasons
        Bits that stand against the reading.
    """

    factor: float
    own_sd: float
    law_sd: float
    difference_sd: float
    reasons: int


class Verdict(NamedTuple):
    """Start or end of a change that covariates do not explain."""

    holds: bool
    entry: ChangeEstimate
    evidence: float
    limit: float


@dataclasses.dataclass(frozen=True, slots=True)
class Condition:
    """Normal behaviour of one frequency under covariates, and the state of its watch.

    Parameters
    ----------
    reference
        Covariates at which frequencies are compared.
    frequency_hz
        Normal frequency there.
    readings
        How many it was learnt from.
    limit
        Least mean time between false alarms of this frequency.
    raised
        Whether an alarm is.
    """

    normal: StoredNormal
    reference: tuple[float, ...]
    frequency_hz: float
    readings: int
    limit: float
    watch: StoredWatch
    raised: bool = False

    @property
    def law_sd(self) -> float:
        """Relative standard deviation of `frequency_hz`."""
        return self.remove(np.array(self.reference)).law_sd

    @property
    def law_share(self) -> float:
        """Share of the variance of an exact reading at the reference that the law has."""
        removed = self.remove(np.array(self.reference))
        law, own = removed.law_sd**2, removed.own_sd**2
        return law / (law + own) if own > 0.0 else 1.0

    def freed(self, training: Training) -> Float[np.ndarray, "reading 4"]:
        """Frequency at the reference, its sd, damping ratio and its sd of each reading."""
        table = training.table()
        table[:, 1:3] *= np.array([[self.remove(row[5:]).factor] for row in table])
        return table[:, 1:5]

    def remove(self, covariates: Float[np.ndarray, " covariate"]) -> Removed:
        """Return the effect of covariates on a frequency.

        Parameters
        ----------
        covariates
            Value of each covariate, in its own unit; NaN where missing.

        Returns
        -------
        Factor on the frequency and relative standard deviations.
        """
        if not np.isfinite(covariates).all():
            return Removed(math.nan, math.nan, math.nan, math.nan, st.NO_COVARIATE)
        normal = self.normal.read()
        here, there = _features(normal, covariates), _features(normal, np.array(self.reference))
        moved = here - there
        wander = normal.wander
        inside = bool(normal.basis.within(covariates[None, :])[0])
        return Removed(
            math.exp(-float(moved @ normal.belief.mean[:-1])),
            math.hypot(wander.sd, wander.noise),
            _prediction_sd(normal, here),
            _prediction_sd(normal, moved),
            0 if inside else st.BEYOND_COVARIATES,
        )

    def judge(
        self,
        slow_time: float,
        frequency: float,
        sd: float,
        covariates: Float[np.ndarray, " covariate"],
        wanted: Covariates,
    ) -> tuple["Condition", Verdict | None]:
        """Watch one more reading; readings from before the last one are not judged.

        Parameters
        ----------
        slow_time
            Slow time of the reading.
        frequency
            Natural frequency [Hz].
        sd
            Its standard deviation [Hz].
        covariates
            Value of each covariate, in its own unit.
        wanted
            Settings of the alarm.

        Returns
        -------
        The condition after the reading, and the verdict if the alarm was raised or cleared.
        """
        state = self.watch.read()
        if not slow_time >= state.belief.time:
            return self, None
        watch = self._watcher(wanted)
        after, judgement = watch.step(state, slow_time, frequency, sd, covariates)
        if judgement.left_out is not None and after is state:
            return self, None
        raised = judgement.evidence >= self.limit * (CALM if self.raised else 1.0)
        condition = dataclasses.replace(self, watch=StoredWatch.of(after), raised=raised)
        if raised == self.raised:
            return condition, None
        return condition, Verdict(raised, watch.entry(after), judgement.evidence, self.limit)

    def entered(self, wanted: Covariates) -> ChangeEstimate | None:
        """Size and onset of a detected change, from all readings so far."""
        return self._watcher(wanted).entry(self.watch.read()) if self.raised else None

    def _watcher(self, wanted: Covariates) -> Watch:
        return Watch(
            normal=self.normal.read(),
            time_between_false_alarms=self.limit,
            entered=wanted.entered,
            size=wanted.size,
        )


def condition_of(content: dict[str, Any] | None) -> Condition | None:
    """Read a condition from the JSON of `dataclasses.asdict`."""
    if content is None:
        return None
    watch = content["watch"]
    parts = {
        "normal": StoredNormal(**content["normal"]),
        "reference": tuple(content["reference"]),
        "watch": StoredWatch(**{**watch, "held": tuple(watch["held"])}),
    }
    return Condition(**{**content, **parts})


def covariates_of(message: Features, wanted: Covariates) -> Float[np.ndarray, " covariate"]:
    """Take the covariates asked for; NaN where one is missing."""
    given = message.covariates
    return np.array([given.get(name, math.nan) for name in wanted.names])


def conclude(training: Training, wanted: Covariates, *, together: int = 1) -> Condition:
    """Learn the normal behaviour from a span of training.

    Parameters
    ----------
    together
        How many frequencies are watched for the same change; false alarms of each are so many
        times rarer.

    Raises
    ------
    NotLearntError
        Where no law can be made of it.
    """
    table = training.table()
    covariates = np.ascontiguousarray(table[:, 5:])
    time, frequency, sd = (np.ascontiguousarray(column) for column in table[:, :3].T)
    try:
        with np.errstate(all="ignore"):
            normal = learn_normal(
                time,
                frequency,
                np.maximum(sd, _LEAST_SD * frequency),
                covariates,
                temperature=wanted.hinge,
                freezing=wanted.freezing_c,
            )
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise NotLearntError(str(error)) from error
    means = dict(zip(wanted.names, covariates.mean(axis=0).tolist(), strict=True))
    reference = tuple((means | dict(wanted.reference or {}))[name] for name in wanted.names)
    kept = StoredNormal.of(normal)
    between = wanted.time_between_false_alarms or SPANS * (training.last - training.first)
    start = Watch(normal=normal, time_between_false_alarms=1.0).start()
    there = _features(kept.read(), np.array(reference))
    known = math.exp(normal.centre + float(there @ normal.belief.mean[:-1]))
    numbers = [known, normal.wander.sd, normal.wander.noise, *normal.belief.mean.tolist()]
    if not np.isfinite(numbers).all():
        raise NotLearntError("The law that was learnt is not finite.")
    return Condition(
        kept, reference, known, len(table), together * between, StoredWatch.of(start)
    )


def _features(
    normal: NormalModel, covariates: Float[np.ndarray, " covariate"]
) -> Float[np.ndarray, " coefficient"]:
    return np.asarray(normal.basis.features(covariates[None, :])[0])


def _prediction_sd(normal: NormalModel, features: Float[np.ndarray, " coefficient"]) -> float:
    covariance = normal.belief.covariance[:-1, :-1]
    return math.sqrt(max(float(features @ covariance @ features), 0.0))
