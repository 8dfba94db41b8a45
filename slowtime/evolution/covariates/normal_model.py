"""Normal dependence of a frequency on temperature and load, learnt from training data."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from slowtime.evolution.change import PerReading, Series

from . import filter as recursion
from .basis import Basis, Law
from .filter import CovariateBelief
from .residual_process import ResidualProcess, log_evidence

_FEWEST = 30
_SIDE = 0.05  # share of the training below freezing, and above, that makes a bend worth trying
_NEAR = 5.0  # degrees about freezing within which the bend is sought
_OUTLIER = 5.0  # standard deviations beyond which a reading is not learnt from
_BLUNT = 1.2  # times the lesser spread of a foretold reading, beyond which it has no say
_PASSES = 4
# Where the search may begin, in prior sds: a long memory has a false summit of its own.
_MEMORIES, _SPREADS = np.linspace(-1.2, 1.2, 5), np.linspace(-1.0, 1.0, 3)
_BOUNDED = 4.0  # prior standard deviations that a logarithm may be from its prior centre


@dataclasses.dataclass(frozen=True, slots=True)
class CandidateLaw:
    """A law that was tried, and the logarithm of its evidence.

    Each parameter that was fitted rather than integrated over has cost half the logarithm of
    the number of readings.
    """

    law: Law
    log_evidence: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class NormalModel:
    """What is normal for one frequency.

    Parameters
    ----------
    basis, wander
        The law of covariates, and what they leave.
    centre
        Mean of the logarithm of the frequency in training.
    belief
        Coefficients and wandering part at the end of training.
    candidates
        All laws tried, most evident first; the first was taken.
    rejected
        Number of readings that were not usable, or outliers.
    """

    basis: Basis
    wander: ResidualProcess
    centre: float
    belief: CovariateBelief
    candidates: tuple[CandidateLaw, ...]
    rejected: int

    @property
    def law(self) -> Law:
        """The law that was taken."""
        return self.basis.law

    def expected(
        self, covariates: Float[np.ndarray, "time covariate"]
    ) -> tuple[Series, Series]:
        """Predict the normal frequency at covariates, and its relative standard deviation.

        The wandering part is in the standard deviation, noise of readings is not.

        Parameters
        ----------
        covariates
            Temperature and loads, one column each.

        Returns
        -------
        Frequency [Hz], and relative standard deviation [1].
        """
        features = self.basis.features(covariates)
        mean, covariance = self.belief.mean[:-1], self.belief.covariance[:-1, :-1]
        variance = np.sum((features @ covariance) * features, axis=1) + self.wander.sd**2
        return np.exp(self.centre + features @ mean), np.sqrt(variance)

    def removed(
        self,
        frequency: Series,
        covariates: Float[np.ndarray, "time covariate"],
        reference: Float[np.ndarray, " covariate"],
    ) -> Series:
        """Frequencies corrected to reference covariates.

        Parameters
        ----------
        frequency
            Frequencies [Hz].
        covariates
            Temperature and loads, one column each.
        reference
            Reference temperature and loads.

        Returns
        -------
        Corrected frequencies [Hz].
        """
        moved = self.basis.features(covariates) - self.basis.features(reference[None, :])
        return np.asarray(frequency * np.exp(-moved @ self.belief.mean[:-1]))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Training:
    """Usable readings of the training span, ascending in time."""

    time: Series
    value: Series
    sd: Series
    covariates: Float[np.ndarray, "time covariate"]

    def only(self, which: np.ndarray) -> "_Training":
        return _Training(
            self.time[which], self.value[which], self.sd[which], self.covariates[which]
        )


def learn_normal(
    slow_time: Series,
    frequency: Series,
    frequency_sd: PerReading,
    covariates: Float[np.ndarray, "time covariate"],
    *,
    temperature: int | None = 0,
    freezing: float = 0.0,
) -> NormalModel:
    """Learn how a frequency depends on covariates while the structure is as it should be.

    Parameters
    ----------
    slow_time, frequency, frequency_sd
        Readings of the training span, in any one unit each; NaN where missing. The span must
        hold the covariates that will come later: a year, for the weather.
    covariates
        One column each; none at all to learn what a frequency does by itself.
    temperature
        Column of the temperature, along which a bend near freezing is tried; None for none.
    freezing
        Where to expect the bend, in the unit of that column.

    Returns
    -------
    The model.

    Notes
    -----
    For each law, the memory and the spread of the wandering part, the noise beyond the stated
    one, and what is not linear in the law, are those of greatest likelihood under weak priors.
    """
    training, unusable = _usable(slow_time, frequency, frequency_sd, covariates)
    centre = float(np.median(training.value))
    training = dataclasses.replace(training, value=training.value - centre)
    agreed = _without_outliers(training, temperature, freezing)
    laws = _laws(agreed, temperature, freezing)
    fits = {law: _fit(law, agreed, temperature or 0, freezing) for law in laws}
    rejected = unusable + len(training.time) - len(agreed.time)
    return _conclude(agreed, centre, fits, rejected)


def _without_outliers(
    training: _Training, temperature: int | None, freezing: float
) -> _Training:
    """Leave out readings that the most flexible law finds far out of line."""
    law = _laws(training, temperature, freezing)[-1]
    kept = np.ones(len(training.time), dtype=bool)
    for _ in range(_PASSES):
        basis, wander, _ = _fit(law, training.only(kept), temperature or 0, freezing)
        agreeing = _agreeing(training, kept, basis, wander)
        if (agreeing == kept).all():
            break
        kept = agreeing
    return training.only(kept)


def _conclude(
    training: _Training,
    centre: float,
    fits: dict[Law, tuple[Basis, ResidualProcess, float]],
    rejected: int,
) -> NormalModel:
    candidates = [CandidateLaw(law, evidence) for law, (_, _, evidence) in fits.items()]
    candidates.sort(key=lambda candidate: -candidate.log_evidence)
    basis, wander, _ = fits[candidates[0].law]
    features = basis.features(training.covariates)
    belief = recursion.initial_belief(features.shape[1], wander, float(training.time[0]))
    for i in range(len(training.time)):
        belief = recursion.predict(belief, wander, float(training.time[i]))
        reading = recursion.innovation(
            belief, wander, float(training.value[i]), float(training.sd[i]), features[i]
        )
        belief = recursion.update(belief, reading)
    return NormalModel(basis, wander, centre, belief, tuple(candidates), rejected)


def _usable(
    slow_time: Series,
    frequency: Series,
    frequency_sd: PerReading,
    covariates: Float[np.ndarray, "time covariate"],
) -> tuple[_Training, int]:
    sd = np.broadcast_to(np.asarray(frequency_sd, dtype=np.float64), frequency.shape)
    fine = np.isfinite(slow_time) & np.isfinite(frequency) & np.isfinite(sd)
    fine &= (frequency > 0.0) & (sd >= 0.0) & np.isfinite(covariates).all(axis=1)
    if fine.sum() < _FEWEST or np.ptp(slow_time[fine]) <= 0.0:
        raise ValueError(
            f"{int(fine.sum())} of {len(frequency)} readings have a positive frequency, its "
            f"standard deviation and all covariates. At least {_FEWEST} at different times are "
            "needed; train for longer, or leave out a covariate that is missing."
        )
    order = np.flatnonzero(fine)[np.argsort(slow_time[fine], kind="stable")]
    value = np.log(frequency[order])
    relative = np.maximum(sd[order] / frequency[order], 1e-4 * np.std(value) + 1e-12)
    training = _Training(slow_time[order], value, relative, covariates[order])
    return training, len(frequency) - len(order)


def _laws(training: _Training, temperature: int | None, freezing: float) -> tuple[Law, ...]:
    if training.covariates.shape[1] == 0:
        return ("constant",)
    if temperature is None:
        return ("constant", "linear", "Gaussian process")
    below = np.mean(training.covariates[:, temperature] < freezing)
    if not _SIDE < below < 1.0 - _SIDE:
        return ("constant", "linear", "Gaussian process")
    return ("constant", "linear", "bilinear", "Gaussian process")


def _fit(
    law: Law, training: _Training, temperature: int, freezing: float
) -> tuple[Basis, ResidualProcess, float]:
    """Likeliest of one law, and its evidence."""
    spread = 3.0 * float(np.std(training.value)) + 1e-12
    base = Basis(
        law=law,
        low=training.covariates.min(axis=0),
        high=training.covariates.max(axis=0),
        spread=spread,
        hinge=temperature,
        bend=freezing,
    )
    centre, sd, build = _parametrised(base, training)

    def cost(whitened: np.ndarray) -> float:
        basis, wander = build(centre + sd * whitened)
        features = basis.features(training.covariates)
        evidence = log_evidence(wander, training.time, training.value, training.sd, features)
        return 0.5 * float(whitened @ whitened) - evidence

    net = np.zeros((_MEMORIES.size * _SPREADS.size, len(centre)))
    net[:, :2] = np.stack(np.meshgrid(_MEMORIES, _SPREADS), axis=-1).reshape(-1, 2)
    found = minimize(
        cost,
        min(net, key=cost),
        method="L-BFGS-B",
        bounds=[(-_BOUNDED, _BOUNDED)] * len(centre),
        options={"maxiter": 60, "ftol": 1e-9},
    )
    basis, wander = build(centre + sd * found.x)
    own = len(centre) - 3
    return basis, wander, -float(found.fun) - 0.5 * own * float(np.log(len(training.time)))


def _parametrised(
    base: Basis, training: _Training
) -> tuple[np.ndarray, np.ndarray, Callable[[np.ndarray], tuple[Basis, ResidualProcess]]]:
    """Prior centres and standard deviations of what is fitted, and what is made of it."""
    scatter, noise = float(np.std(training.value)), float(np.median(training.sd))
    gap = float(np.median(np.diff(training.time))) or 1e-12 * float(training.time[-1])
    centre = [np.log(10.0 * gap), np.log(0.1 * scatter + noise), np.log(0.3 * noise)]
    sd = [2.0, 1.5, 1.5]
    if base.law == "bilinear":
        centre.append(base.bend)
        sd.append(_NEAR / 2.0)
    if base.law == "Gaussian process":
        centre += [np.log(0.7), np.log(0.5 * scatter)]
        sd += [0.7, 1.0]

    def build(point: np.ndarray) -> tuple[Basis, ResidualProcess]:
        wander = ResidualProcess(*np.exp(point[:3]).tolist())
        if base.law == "bilinear":
            return dataclasses.replace(base, bend=float(point[3])), wander
        if base.law == "Gaussian process":
            length, spread = np.exp(point[3:]).tolist()
            return dataclasses.replace(base, length=length, sd=spread), wander
        return base, wander

    return np.array(centre), np.array(sd), build


def _agreeing(
    training: _Training, kept: np.ndarray, basis: Basis, wander: ResidualProcess
) -> np.ndarray:
    """Which readings are in line with those before them or with those after.

    Only a side that foretells about as well as the other has a say: at the first readings the
    future knows better, and behind a wrong one the past may take long to recover.
    """
    back = training.only(np.arange(len(training.time))[::-1])
    back = dataclasses.replace(back, time=-back.time)
    before, its_spread = _foretold(training, kept, basis, wander)
    after, other_spread = (part[::-1] for part in _foretold(back, kept[::-1], basis, wander))
    score, spread = np.abs([before, after]), np.array([its_spread, other_spread])
    score[spread > _BLUNT * spread.min(axis=0)] = np.inf
    best = score.min(axis=0)
    # By the scatter of the middle half: outliers have widened what the fit calls noise.
    return np.asarray(best <= _OUTLIER * 1.4826 * np.median(best))


def _foretold(
    training: _Training, kept: np.ndarray, basis: Basis, wander: ResidualProcess
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals of a filter fed with what was kept so far, in their spreads, and these."""
    features = basis.features(training.covariates)
    belief = recursion.initial_belief(features.shape[1], wander, float(training.time[0]))
    score, spread = np.zeros(len(features)), np.zeros(len(features))
    for i in range(len(features)):
        belief = recursion.predict(belief, wander, float(training.time[i]))
        reading = recursion.innovation(
            belief, wander, float(training.value[i]), float(training.sd[i]), features[i]
        )
        spread[i] = np.sqrt(reading.variance)
        score[i] = reading.residual / spread[i]
        if kept[i]:
            belief = recursion.update(belief, reading)
    return score, spread
