"""Prediction of later readings by a mixture of laws, and the bands of these.

Each member predicts by exact filtering with its coefficients integrated out; the mixture gives
mean and standard deviation of the band.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from slowtime.evolution.change import check_level
from slowtime.history_diagnosis.data.history import (
    Covariate,
    FilledCovariate,
    Series,
    checked_history,
    fill_covariate,
)
from slowtime.history_diagnosis.laws.terms import design, gap_variance, solve
from slowtime.history_diagnosis.likelihood.whitening import (
    FilterResult,
    MaternProcess,
    continue_whitening,
)

from .mixture import EnsembleMember, MixtureModel

_WILD_SDS = 5.0
"""[standard deviations] From the prediction, beyond which a reading is not learnt from. Source:
docs/what_decides.md: half and double change no answer."""
_MOST_WILD = 0.04
"""[share of the readings] Up to which the band is widened to hold outliers. Source:
docs/what_decides.md: half and double change no answer."""
_WILD_IN_A_ROW = 3
"""[readings] After which wild readings are taken for a change and learnt from. Source:
docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class PredictionBand:
    """Prediction of readings, their noise included.

    Parameters
    ----------
    mean, sd, lo, hi
        In the unit of the values.
    accepted
        True for readings that were learnt from; false where none was given or it was wild.
    """

    mean: Float[np.ndarray, " later"]
    sd: Float[np.ndarray, " later"]
    lo: Float[np.ndarray, " later"]
    hi: Float[np.ndarray, " later"]
    accepted: Bool[np.ndarray, " later"]


def forecast(
    model: MixtureModel,
    slow_time: Series,
    sd: Series,
    covariates: tuple[Covariate, ...] = (),
    *,
    level: float = 0.95,
) -> PredictionBand:
    """Predict later readings from the history alone.

    Parameters
    ----------
    model
        An adopted or nominal model.
    slow_time, sd
        Of the readings to come, ascending, none before the history ends.
    covariates
        As then read or expected, with the names of those of the history.
    level
        Probability of the band [1], outliers included at the rate of the history.

    Raises
    ------
    ValueError
        If times are not ascending after the history, a covariate that the model follows is
        missing, or the level is no probability.
    """
    nothing = np.full(len(slow_time), np.nan)
    return follow(model, slow_time, nothing, sd, covariates, level=level)


def follow(
    model: MixtureModel,
    slow_time: Series,
    value: Series,
    sd: Series,
    covariates: tuple[Covariate, ...] = (),
    *,
    level: float = 0.95,
) -> PredictionBand:
    """Predict each later reading from all before it.

    Parameters
    ----------
    model, slow_time, sd, covariates, level
        As for `forecast`, which also says what is refused.
    value
        The readings; NaN where there is none.
    """
    check_level(level)
    outliers = min(1.0 - float(model.readings.mask.mean()), _MOST_WILD)
    quantile = check_level(min(level / (1.0 - outliers), 0.5 + 0.5 * level))
    later = _later_epochs(model, slow_time, sd, covariates)
    everyone = (*model.members, *model.rivals)
    filters = [_MemberFilter.start(model, member, later) for member in everyone]
    weights = np.array([member.weight for member in everyone])
    weights /= weights.sum()
    past = model.readings.past
    mean, spread = np.empty(len(slow_time)), np.empty(len(slow_time))
    accepted = np.zeros(len(slow_time), dtype=bool)
    wild = 0
    scaled = (value - past.centre) / past.scale
    for i in range(len(slow_time)):
        each = np.array([one.predict(i) for one in filters])
        mean[i] = weights @ each[:, 0]
        spread[i] = np.sqrt(weights @ (each[:, 1] + (each[:, 0] - mean[i]) ** 2))
        known = np.isfinite(scaled[i])
        wild = wild + 1 if known and abs(scaled[i] - mean[i]) > _WILD_SDS * spread[i] else 0
        accepted[i] = known and (wild == 0 or wild > _WILD_IN_A_ROW)
        for one in filters:
            one.update(i, float(scaled[i]) if accepted[i] else None)
    mean, spread = past.centre + past.scale * mean, past.scale * spread
    reach = quantile * spread
    return PredictionBand(mean, spread, mean - reach, mean + reach, accepted)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _LaterEpochs:
    """Later epochs in the scale of the history, whose own epochs come first."""

    time: Float[np.ndarray, " whole"]
    sd: Float[np.ndarray, " later"]
    covariates: tuple[FilledCovariate, ...]
    past: int


def _later_epochs(
    model: MixtureModel, slow_time: Series, sd: Series, covariates: tuple[Covariate, ...]
) -> _LaterEpochs:
    past = model.readings.past
    if len(slow_time):
        ascending = np.all(np.diff(slow_time) >= 0.0)
        if not (slow_time[0] >= model.past.time[-1] and ascending):
            raise ValueError(
                f"Later epochs begin at {slow_time[0]:g} or go back in time; the history ends "
                f"at {model.past.time[-1]:g}. Give ascending slow times after it."
            )
        checked_history(slow_time, np.zeros(len(slow_time)), sd, covariates, fewest=1)
    named = {covariate.name: covariate for covariate in covariates}
    followed = {
        past.covariates[term.law.covariate].name
        for member in (*model.members, *model.rivals)
        for term in member.terms
        if term.law.covariate is not None
    }
    if needed := sorted(followed - set(named)):
        raise ValueError(
            f"The model follows {needed}, but later values were given of {sorted(named)}. Give "
            "them too, NaN where they were not read."
        )
    time = np.concatenate([past.time, (slow_time - past.start) / past.span])
    continued = tuple(
        _continue(time, covariate, named.get(covariate.name), len(past.time))
        for covariate in past.covariates
    )
    return _LaterEpochs(time, sd / past.scale, continued, len(past.time))


def _continue(
    time: Series, past: FilledCovariate, later: Covariate | None, count: int
) -> FilledCovariate:
    """Append later values to a covariate, in the scale that it had in the history."""
    new = np.full(len(time) - count, np.nan) if later is None else later.values
    values = np.concatenate([past.centre + past.scale * past.values, new])
    whole = fill_covariate(time, Covariate(past.name, values, past.unit, past.role))
    scaled = (whole.centre + whole.scale * whole.values - past.centre) / past.scale
    sd = np.concatenate([past.sd, whole.sd[count:] * whole.scale / past.scale])
    return dataclasses.replace(past, values=scaled, sd=sd)


@dataclasses.dataclass(slots=True, eq=False)
class _MemberFilter:
    """Filter of one member, with recursive least squares for its coefficients."""

    process: MaternProcess
    columns: Float[np.ndarray, "later coefficient"]
    variance: Float[np.ndarray, " later"]
    time: Float[np.ndarray, " later"]
    state: FilterResult
    mean: Float[np.ndarray, " coefficient"]
    covariance: Float[np.ndarray, "coefficient coefficient"]
    noise: float

    @classmethod
    def start(
        cls, model: MixtureModel, member: EnsembleMember, later: _LaterEpochs
    ) -> "_MemberFilter":
        """Solve for the coefficients at the end of the history."""
        found, state = solve(model.readings, member.terms, member.process)
        columns = design(member.terms, later.time, later.covariates)[later.past :]
        time = later.time[later.past :]
        variance = later.sd**2
        for term in member.terms:
            variance = variance * term.law.variance_factor(time, term.shape)
        gaps = gap_variance(member.terms, later.time, later.covariates, found.mean)
        return cls(
            member.process, columns, variance + gaps[later.past :], time, state,
            found.mean, found.covariance, found.noise_variance,
        )  # fmt: skip

    def predict(self, i: int) -> tuple[float, float]:
        """Return mean and variance of a reading before it is read."""
        # A row of infinite variance only moves the state on in time.
        ahead = self._advance(i, 0.0, np.inf)
        seen = self.columns[i] - ahead.mean[0, 1:]
        own = float(ahead.covariance[0, 0] + self.variance[i])
        value = float(ahead.mean[0, 0] + seen @ self.mean)
        return value, self.noise * own + float(seen @ self.covariance @ seen)

    def update(self, i: int, value: float | None) -> None:
        """Go on to a reading, and learn from it if there is one."""
        if value is None:
            self.state = self._advance(i, 0.0, np.inf)
            return
        self.state = self._advance(i, value, self.variance[i])
        seen = self.state.white[0]
        shared = self.covariance @ seen[1:]
        gain = shared / (self.noise + float(seen[1:] @ shared))
        self.mean = self.mean + gain * float(seen[0] - seen[1:] @ self.mean)
        self.covariance = self.covariance - np.outer(gain, shared)

    def _advance(self, i: int, value: float, variance: float) -> FilterResult:
        row = np.concatenate([[value], self.columns[i]])[None, :]
        return continue_whitening(
            self.process, self.state, self.time[i : i + 1], np.array([variance]), row
        )
