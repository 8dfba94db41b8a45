r"""Laws fitted to a measured force along a measured motion, and their evidence.

.. math:: f = k e + c v + b + \sum_i F_i(e - e_0, v, z; p_i) + r

The noise of the force is not known beforehand: its variance is estimated from what a law
leaves, so that a law outside the list makes every other less certain. What is left is
correlated, within a cycle and from cycle to cycle: it counts for as many samples as it has
independent ones.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
import scipy
import scipy.fft
import scipy.optimize
from jaxtyping import Bool, Float

from slowtime.discrepancy.candidates.library_fit import is_applicable
from slowtime.dynamics.description import Description, Tolerance
from slowtime.dynamics.effects import (
    Effect,
    Friction,
    Kind,
    Law,
    Motion,
    Parameter,
    Place,
    force_along,
)

from .records import ForceRecord, ImposedRig
from .standstill import informative

AT_BOUND = 1e-3
"""[share of a bound] Within which a parameter stands at it. Source: docs/what_decides.md: half
and double change no answer."""
MAX_EVALUATIONS = 30
"""[evaluations] Of a fit of one law from one start. Source: least squares of few parameters
end within twenty."""
DIFFERENCE_STEP = 1e-3
"""[1] Relative step of a parameter for differences. Source: laws with kinks change by samples,
so that smaller steps tell nothing."""
ROUGH_SAMPLES = 4000
"""[samples] That the shapes of a law are ranked on. Source: all are used after."""
VALIDATION_EVALUATIONS = 20
"""[evaluations] Of a fit that starts from that to all samples. Source: docs/what_decides.md:
half and double change no answer."""
STEP_SHARE = 0.003
"""[share of the range of motion] That internal states are integrated over at most. Source:
Runge and Kutta's rule is stable up to 2.8 lengths of memory; dampers have shown lengths of
0.01 ranges."""
MOST_STEPS = 12
"""[steps] Of internal states between two samples. Source: a bound on the time taken."""
LEAST_MEMORY = 0.6
"""[steps] Length over which a law builds up its force at least. Source: below it Runge and
Kutta's rule is off by more than a tenth, and the law is dry friction for these records."""
MEMORY_LENGTHS = frozenset({"presliding_m", "zy_m"})
OFFSET_SHARE = 0.05
"""[share of the range of motion] Standard deviation of the elongation at which the transducer
of displacement reads zero. Source: a decision: rigs are centred by eye."""
CENTRED = frozenset({
    "hardening", "softening", "asymmetric stiffness", "polynomial stiffness",
    "damping by elongation", "negative damping",
})  # fmt: skip
"""Families whose force depends on where the middle of the motion is."""
MIN_INDEPENDENT = 8.0
"""[samples] That any series of what is left counts for. Source: a loop has two ends and two
branches, each with a slope."""
CORRELATED_SDS = 3.0
"""[standard deviations] From which a correlation is no chance. Source: three-sigma rule."""

Series = Float[np.ndarray, " time"]
Mask = Bool[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ForceFit:
    """A spring, a damper, a constant and laws, fitted to force records.

    Parameters
    ----------
    constants
        Stiffness [N/m], damping [N s/m] and a constant force [N].
    constants_sd
        Their standard deviations, by the independent samples; zeros of a fit to a part.
    centre, centre_sd
        Elongation at which laws of elongation have their middle, and its standard deviation
        [m].
    left
        What the fit leaves of all samples of all records [N].
    rms
        Root mean square of what it leaves of the samples fitted [N].
    pulls
        Sum of squared deviations of the constants from the model's claims, in tolerances.
    """

    constants: Float[np.ndarray, "3"]
    constants_sd: Float[np.ndarray, "3"]
    effects: tuple[Effect, ...]
    sds: tuple[Mapping[str, float], ...]
    centre: float
    centre_sd: float
    left: Series
    rms: float
    numbers: int
    pulls: float


def log_evidence(fit: ForceFit, left: float, count: float) -> float:
    """Return Schwarz's criterion, with the variance of the noise maximised out [nats].

    `left` are samples [N] that it was not fitted to, of which `count` are independent.
    """
    square = max(left**2, np.finfo(float).tiny)
    return -count / 2 * math.log(square) - fit.pulls / 2 - fit.numbers / 2 * math.log(count)


def independent_samples(left: Series) -> float:
    r"""Return the number of independent samples of what is left.

    .. math:: N / (1 + 2 \sum_k \rho_k)

    The sum is over all lags with a correlation above chance: what returns each cycle is the
    error of a law, however many cycles were recorded.

    References
    ----------
    Bayley and Hammersley 1946, for the variance of the mean of a correlated series.
    """
    count = len(left)
    size = scipy.fft.next_fast_len(2 * count)
    power = np.abs(scipy.fft.rfft(left, size)) ** 2
    correlation = scipy.fft.irfft(power, size)[:count]
    if not correlation[0] > 0:
        return float(count)
    correlation = correlation / correlation[0]
    chance = CORRELATED_SDS / math.sqrt(count)
    total = float(correlation[1:][correlation[1:] > chance].sum())
    return max(count / (1 + 2 * total), MIN_INDEPENDENT)


class ForceRegression:
    """Least squares of laws along measured motions."""

    def __init__(
        self,
        rig: ImposedRig,
        tolerance: Tolerance | None,
        records: Sequence[ForceRecord],
        kinds: Mapping[str, Kind],
    ) -> None:
        self.rig, self.records, self.kinds = rig, tuple(records), kinds
        self.place = Place("element", rig.spring.id)
        self.force = np.concatenate([one.force for one in records])
        self.used = np.concatenate([informative(one.motion) for one in records])
        self.linear = np.concatenate(
            [
                np.stack([one.motion.e, one.motion.v, np.ones(len(one.force))], axis=1)
                for one in records
            ]
        )
        path = max(float(np.abs(np.diff(one.motion.e)).max()) for one in records)
        span = max(float(np.ptp(one.motion.e)) for one in records)
        self.step_m = max(STEP_SHARE * span, path / MOST_STEPS)
        self.steps = [_finer(one.motion, self.step_m) for one in records]
        self.centre_sd = OFFSET_SHARE * float(np.ptp(self.linear[:, 0]))
        self.constants = ClaimedConstants.of(rig, tolerance)

    def bare(self) -> ForceFit:
        """Fit the spring, the damper and a constant alone."""
        found = self.fit((), 0.0)
        if found is None:
            raise np.linalg.LinAlgError("a measured force that is not finite")
        return found

    def as_given(self, records: Sequence[ForceRecord]) -> list[Series]:
        """Return what the model as given leaves of other records [N]."""
        k, c, _ = self.constants.mean
        return [one.force - k * one.motion.e - c * one.motion.v for one in records]

    def predict(self, fit: ForceFit, record: ForceRecord) -> Series:
        """Force of a fit along another motion [N]."""
        k, c, b = fit.constants
        force = k * record.motion.e + c * record.motion.v + b
        return np.asarray(force + self.laws(fit, record.motion))

    def laws(self, fit: ForceFit, motion: Motion) -> Series:
        """Force of the laws of a fit, without its constants, along a motion [N]."""
        steps, force = _finer(motion, self.step_m), np.zeros(len(motion.e))
        for one in fit.effects:
            kind = self.kinds[one.kind]
            force += _force(kind, one.parameters, motion, steps, fit.centre)
        return force

    def with_one_more(self, fit: ForceFit, starts: Sequence[Effect]) -> ForceFit | None:
        """Fit a law beside those of a fit, from several starts; None where all fail."""
        found = [
            one
            for start in starts
            if (one := self.fit((*fit.effects, start), fit.centre)) is not None
        ]
        return min(found, key=lambda one: one.rms, default=None)

    def is_at_bound(self, fit: ForceFit) -> bool:
        """Whether a parameter of the last law of a fit stands at an end of its range."""
        effect = fit.effects[-1]
        for parameter in self.kinds[effect.kind].parameters:
            value = effect.parameters[parameter.name]
            for end in (parameter.low, parameter.high):
                # Zero is no bound: it is where a part of the law is absent.
                near = abs(value - end) < AT_BOUND * max(abs(end), np.finfo(float).tiny)
                if parameter.fitted and end != 0 and math.isfinite(end) and near:
                    return True
        return False

    def fit(
        self,
        effects: tuple[Effect, ...],
        centre: float,
        kept: Mask | None = None,
        level: float | None = None,
    ) -> ForceFit | None:
        """Fit all parameters of effects, with the constants eliminated linearly.

        It starts from the elongation `centre` [m]. A fit that is known to leave `level` [N] is
        not made twice, and tells no standard deviations. None where it has no finite force.
        """
        problem = _LeastSquares(
            self, effects, centre, self.used if kept is None else kept & self.used
        )
        return problem.solve(level)

    def along(self, kind: Kind, parameters: Mapping[str, float], centre: float) -> Series:
        """Force of one law along the motion of all records [N]."""
        return np.concatenate(
            [
                _force(kind, parameters, one.motion, steps, centre)
                for one, steps in zip(self.records, self.steps, strict=True)
            ]
        )

    def laws_along(self, fit: ForceFit) -> Series:
        """Force of the laws of a fit along the motion of all records [N]."""
        return np.concatenate([self.laws(fit, one.motion) for one in self.records])

    def motion(self) -> Motion:
        """Motion of all records, one after the other."""
        motions = [one.motion for one in self.records]
        return Motion(
            e=np.concatenate([m.e for m in motions]),
            v=np.concatenate([m.v for m in motions]),
            a=np.concatenate([m.a for m in motions]),
            times=np.concatenate([m.times for m in motions]),
        )

    def starts(self, fit: ForceFit, kind: Kind, count: int) -> tuple[float, list[Effect]]:
        """List the `count` best shapes of a law, and the squares [N²] that the first leaves."""
        rows = np.flatnonzero(self.used)
        rows = rows[:: max(len(rows) // ROUGH_SAMPLES, 1)]
        shapes = list(kind.shapes(self.motion())) or [{}]
        left = fit.left[rows]
        ranked: list[tuple[float, dict[str, float]]] = []
        for shape in shapes:
            unit = dict(shape)
            if kind.strength is not None:
                unit[kind.strength] = 1.0
            try:
                force = self.along(kind, unit, fit.centre)[rows]
            except ValueError:
                continue
            if not np.isfinite(force).all() or not force.any():
                continue
            columns = np.column_stack([force, self.linear[rows]])
            weights, *_ = np.linalg.lstsq(columns, left, rcond=None)
            strength = float(weights[0]) if kind.strength is not None else 1.0
            scaled = {
                name: value * (strength if name in (kind.strength, *kind.scales) else 1.0)
                for name, value in unit.items()
            }
            if any(kind.parameter(n).refuses(v) for n, v in scaled.items()):
                continue
            rest = left - columns @ weights
            ranked.append((float(rest @ rest), scaled))
        ranked.sort(key=lambda one: one[0])
        found = [Effect(kind.name, self.place, told) for _, told in ranked[:count]]
        return (ranked[0][0] if ranked else math.inf), found


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ClaimedConstants:
    """Claims of the model: stiffness [N/m], damping [N s/m] and no constant force [N].

    What the model says nothing of is free. A damper that a model has drives nothing.
    """

    mean: Float[np.ndarray, "3"]
    sd: Float[np.ndarray, "3"]

    @staticmethod
    def of(rig: ImposedRig, tolerance: Tolerance | None) -> "ClaimedConstants":
        """Return the claims of a model, with its tolerances."""
        mean = np.array([rig.spring.stiffness_n_per_m, rig.spring.damping_n_s_per_m, 0.0])
        given = tolerance or Tolerance()
        spread = np.array([given.stiffness, given.damping, 0.0]) * mean
        return ClaimedConstants(mean, np.where(spread > 0, spread, np.inf))

    def fit(
        self, linear: Float[np.ndarray, "time 3"], force: Series, level: float
    ) -> Float[np.ndarray, "3"]:
        """Fit the constants to a force [N], under their claims; damping is not negative."""
        inner = linear.T @ linear / level**2 + np.diag(1 / self.sd**2)
        right = linear.T @ force / level**2 + self.mean / self.sd**2
        inner = inner + 1e-12 * np.diag(np.diag(inner))
        found = np.linalg.solve(inner, right)
        if found[1] < 0:
            others = np.array([0, 2])
            found = np.zeros(3)
            found[others] = np.linalg.solve(inner[np.ix_(others, others)], right[others])
        return np.asarray(found)

    def spread(
        self, linear: Float[np.ndarray, "time 3"], level: float
    ) -> Float[np.ndarray, "3"]:
        """Return standard deviations of the fitted constants, for noise of a level [N]."""
        inner = linear.T @ linear / level**2 + np.diag(1 / self.sd**2)
        return np.asarray(
            np.sqrt(np.maximum(np.diag(np.linalg.pinv(inner, hermitian=True)), 0))
        )

    def pulls(self, constants: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Return by how many stated standard deviations constants are off; 0 if unstated."""
        return np.asarray((constants - self.mean) / self.sd)


class _LeastSquares:
    """One nonlinear least-squares problem: parameters of laws, and the centre of the motion."""

    def __init__(
        self,
        regression: ForceRegression,
        effects: tuple[Effect, ...],
        centre: float,
        kept: Mask,
    ) -> None:
        self.regression, self.effects, self.kept = regression, effects, kept
        kinds = regression.kinds
        self.free = [
            (i, p.name)
            for i, effect in enumerate(effects)
            for p in kinds[effect.kind].parameters
            if p.fitted
        ]
        self.centred = any(kinds[one.kind].family in CENTRED for one in effects)
        start = [effects[i].parameters[name] for i, name in self.free]
        low, high = ([getattr(self._parameter(i, n), end) for i, n in self.free]
                     for end in ("low", "high"))  # fmt: skip
        shortest = LEAST_MEMORY * regression.step_m
        low = [
            max(one, shortest) if name in MEMORY_LENGTHS else one
            for one, (_, name) in zip(low, self.free, strict=True)
        ]
        scale = [abs(one) if one != 0 else 1.0 for one in start]
        if self.centred:
            start.append(centre)
            scale.append(regression.centre_sd)
            low.append(-math.inf)
            high.append(math.inf)
        self.scale = np.array(scale)
        self.start = np.array(start) / self.scale
        self.low, self.high = np.array(low) / self.scale, np.array(high) / self.scale
        spread = float(np.std(regression.force[kept]))
        # A law that goes beyond this has exploded.
        self.most = 1e6 * max(spread, np.finfo(float).tiny)
        self.level = max(0.1 * spread, np.finfo(float).tiny)

    def _parameter(self, number: int, name: str) -> Parameter:
        return self.regression.kinds[self.effects[number].kind].parameter(name)

    def solve(self, level: float | None) -> ForceFit | None:
        """Minimise, estimate the noise, and minimise again under the claims' due weight."""
        values = self.start
        self.level = level or self.level
        for _round in range(2 if level is None else 1):
            if len(values):
                inside = np.clip(values, self.low + 1e-9, self.high - 1e-9)
                values = scipy.optimize.least_squares(
                    self._residual,
                    inside,
                    bounds=(self.low, self.high),
                    diff_step=np.full(len(inside), DIFFERENCE_STEP),
                    max_nfev=MAX_EVALUATIONS if level is None else VALIDATION_EVALUATIONS,
                ).x
            left = self._left(values)[0][self.kept]
            rms = float(np.sqrt(np.mean(left**2)))
            self.level = max(rms, np.finfo(float).tiny)
        return self._result(values, spread=level is None)

    def _laws(self, values: Float[np.ndarray, " free"]) -> tuple[tuple[Effect, ...], float]:
        told = (values * self.scale).tolist()
        centre = told.pop() if self.centred else 0.0
        changed = [dict(effect.parameters) for effect in self.effects]
        for (i, name), value in zip(self.free, told, strict=True):
            changed[i][name] = value
        effects = tuple(
            dataclasses.replace(effect, parameters=parameters)
            for effect, parameters in zip(self.effects, changed, strict=True)
        )
        return effects, centre

    def _left(
        self, values: Float[np.ndarray, " free"]
    ) -> tuple[Series, Float[np.ndarray, "3"]]:
        """Return what the laws and the constants leave of all samples [N]; the constants."""
        regression = self.regression
        left = regression.force.copy()
        effects, centre = self._laws(values)
        for effect in effects:
            left -= regression.along(regression.kinds[effect.kind], effect.parameters, centre)
        if not (np.abs(left) < self.most).all():
            return 1e3 * self.level * np.cos(np.arange(len(left))), np.zeros(3)
        constants = regression.constants.fit(
            regression.linear[self.kept], left[self.kept], self.level
        )
        return left - regression.linear @ constants, constants

    def _residual(self, values: Float[np.ndarray, " free"]) -> Series:
        left, constants = self._left(values)
        claims = self.regression.constants
        rows = [claims.pulls(constants) * self.level]
        if self.centred:
            rows.append(values[-1:] * self.level)
        return np.concatenate([left[self.kept], *rows])

    def _result(self, values: Float[np.ndarray, " free"], *, spread: bool) -> ForceFit | None:
        effects, centre = self._laws(values)
        left, constants = self._left(values)
        sd = self._spread(values, left) if spread else np.zeros(len(values))
        if sd is None:
            return None
        told = (sd * self.scale).tolist()
        centre_sd = told.pop() if self.centred else 0.0
        sds: list[dict[str, float]] = [{} for _ in effects]
        for (i, name), one in zip(self.free, told, strict=True):
            sds[i][name] = one
        claims = self.regression.constants
        pulls = float(np.sum(claims.pulls(constants) ** 2))
        linear = self.regression.linear[self.kept]
        noise = self._independent_level(left[self.kept]) if spread else 0.0
        return ForceFit(
            constants=constants,
            constants_sd=claims.spread(linear, noise) if spread else np.zeros(3),
            effects=effects,
            sds=tuple(sds),
            centre=centre,
            centre_sd=centre_sd,
            left=left,
            rms=self.level,
            numbers=len(values),
            pulls=pulls + (float(values[-1] ** 2) if self.centred else 0.0),
        )

    def _independent_level(self, left: Series) -> float:
        """Return the noise [N] that as many independent samples would have to leave as much."""
        return self.level * math.sqrt(len(left) / independent_samples(left))

    def _spread(
        self, values: Float[np.ndarray, " free"], left: Series
    ) -> Float[np.ndarray, " free"] | None:
        """Return standard deviations, by the independent samples; None if not finite."""
        if not len(values):
            return np.zeros(0)
        base = self._residual(values)
        inflated = self._independent_level(left[self.kept])
        columns = []
        for i, value in enumerate(values):
            step = DIFFERENCE_STEP * max(abs(value), DIFFERENCE_STEP)
            moved = values.copy()
            moved[i] += step if value + step <= self.high[i] else -step
            columns.append((self._residual(moved) - base) / (moved[i] - value))
        jacobian = np.stack(columns, axis=1)
        if not np.isfinite(jacobian).all():
            return None
        covariance = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
        return np.asarray(inflated * np.sqrt(np.maximum(np.diag(covariance), 0.0)))


def _force(
    kind: Kind,
    parameters: Mapping[str, float],
    motion: Motion,
    steps: tuple[int, Motion],
    centre: float,
) -> Series:
    """Force of one law along a motion; internal states are integrated in its finer steps."""
    many, finer = steps
    seen = finer if isinstance(kind.action, Law) and kind.action.rates else motion
    force = force_along(kind, parameters, dataclasses.replace(seen, e=seen.e - centre))
    return np.asarray(force[::many] if seen is finer else force)


def _finer(motion: Motion, step_m: float) -> tuple[int, Motion]:
    """Return how many steps a sample has, and the motion at all of them."""
    path = float(np.abs(np.diff(motion.e)).max())
    many = max(math.ceil(path / max(step_m, np.finfo(float).tiny)), 1)
    if many == 1:
        return 1, motion
    numbers = np.arange((len(motion.e) - 1) * many + 1) / many
    times = np.interp(numbers, np.arange(len(motion.e)), motion.times)
    # Between samples, elongation is the cubic through its values and rates.
    cubic = scipy.interpolate.CubicHermiteSpline(motion.times, motion.e, motion.v)
    rate = scipy.interpolate.CubicHermiteSpline(motion.times, motion.v, motion.a)
    finer = Motion(e=cubic(times), v=rate(times), a=rate(times, 1), times=times)
    return many, finer


def applicable_kinds(kinds: Mapping[str, Kind], description: Description) -> list[Kind]:
    """List laws of elements that depend on motion alone, neither on time nor on tones."""
    (element,) = description.elements
    place = Place("element", element.id)
    return [
        kind
        for kind in kinds.values()
        if is_applicable(kind, place, description)
        and isinstance(kind.action, Law | Friction)
        and not kind.is_surface
        and not kind.is_by_record
        and kind.quadrature is None
        and not (isinstance(kind.action, Law) and kind.action.switches)
        and not any(p.unit == "s" and "t_" in p.name for p in kind.parameters)
    ]
