r"""Laws fitted to a measured force along a measured motion, and their evidence.

.. math:: f = k e + c v + b + \sum_i F_i(e, v, z; p_i) + r

The noise of the force is not known beforehand: its variance is estimated from what a law
leaves, so that a law outside the list makes every other less certain. What is left is
correlated from sample to sample; they count for :math:`N (1 - \rho)/(1 + \rho)`, with their
correlation from one to the next :math:`\rho`.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import scipy.optimize
from jaxtyping import Float

from slowtime.dynamics.description import Tolerance
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

AT_BOUND = 1e-3
"""[share of a bound] Within which a parameter stands at it. Source: judgement."""
STARTS = 3
"""[shapes] From which the parameters of a law are fitted. Source: judgement."""
MAX_EVALUATIONS = 60
"""[evaluations] Of a fit of one law from one start. Source: least squares of few parameters
end within twenty."""
DIFFERENCE_STEP = 1e-3
"""[1] Relative step of a parameter for differences. Source: laws with kinks change by samples,
so that smaller steps tell nothing."""
ROUGH_SAMPLES = 4000
"""[samples] That the shapes of a law are ranked on. Source: judgement; all are used after."""

Series = Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ForceFit:
    """A spring, a damper, a constant and laws, fitted to force records.

    Parameters
    ----------
    constants, constants_sd
        Stiffness [N/m], damping [N s/m] and a constant force [N].
    effects
        With fitted parameters.
    sds
        Standard deviations of the fitted parameters of each effect, by name.
    residuals
        Of each record [N].
    pulls
        Sum of squared deviations of the constants from the model's claims, in tolerances.
    """

    constants: Float[np.ndarray, "3"]
    constants_sd: Float[np.ndarray, "3"]
    effects: tuple[Effect, ...]
    sds: tuple[Mapping[str, float], ...]
    residuals: tuple[Series, ...]
    pulls: float

    @property
    def rms(self) -> float:
        """Root mean square of what is left [N]."""
        return float(np.sqrt(np.mean(np.concatenate(self.residuals) ** 2)))

    @property
    def numbers(self) -> int:
        """Number of fitted parameters of laws."""
        return sum(len(one) for one in self.sds)


def log_evidence(fit: ForceFit, left: float, count: float) -> float:
    """Return Schwarz's criterion, with the variance of the noise maximised out [nats].

    Parameters
    ----------
    fit
        Of the force.
    left
        Root mean square that it leaves of records which it was not fitted to [N].
    count
        Independent samples of these, the same for all fits that are compared.
    """
    square = max(left**2, np.finfo(float).tiny)
    return -count / 2 * math.log(square) - fit.pulls / 2 - fit.numbers / 2 * math.log(count)


def independent_samples(residuals: Sequence[Series]) -> float:
    """Return the number of samples that what is left counts for, at least 8."""
    total = 0.0
    for one in residuals:
        power = float(one @ one)
        near = float(one[1:] @ one[:-1]) / power if power > 0 else 0.0
        near = min(max(near, 0.0), 1 - 1 / len(one))
        total += len(one) * (1 - near) / (1 + near)
    return max(total, 8.0)


class ForceRegression:
    """Least squares of laws along measured motions.

    Parameters
    ----------
    rig
        The model's rig.
    tolerance
        Relative standard deviations of the model's constants.
    records
        Force records to fit.
    kinds
        Catalogue of effects by name.
    """

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
        self.ends = np.cumsum([len(one.force) for one in records])[:-1]
        self.linear = np.concatenate(
            [
                np.stack([one.motion.e, one.motion.v, np.ones(len(one.force))], axis=1)
                for one in records
            ]
        )
        claimed = np.array([rig.spring.stiffness_n_per_m, rig.spring.damping_n_s_per_m, 0.0])
        given = tolerance or Tolerance()
        share = np.array([given.stiffness, given.damping, 0.0])
        self.mean = claimed
        # What the model says nothing of is free.
        self.sd = np.where(share * claimed > 0, share * claimed, np.inf)

    def bare(self) -> ForceFit:
        """Fit the spring, the damper and a constant alone."""
        found = self._fit(())
        if found is None:
            raise np.linalg.LinAlgError("a measured force that is not finite")
        return found

    def fit_from(self, fit: ForceFit) -> ForceFit | None:
        """Fit the laws of another fit again, from its parameters; None where that fails."""
        return self._fit(fit.effects)

    def as_given(self, records: Sequence[ForceRecord]) -> list[Series]:
        """Return what the model as given leaves of other records [N]."""
        return [
            one.force - self.mean[0] * one.motion.e - self.mean[1] * one.motion.v
            for one in records
        ]

    def predict(self, fit: ForceFit, record: ForceRecord) -> Series:
        """Force of a fit along another motion [N]."""
        k, c, b = fit.constants
        force = k * record.motion.e + c * record.motion.v + b
        for effect in fit.effects:
            force = force + force_along(
                self.kinds[effect.kind], effect.parameters, record.motion
            )
        return np.asarray(force)

    def with_one_more(self, fit: ForceFit, kind: Kind) -> ForceFit | None:
        """Fit a law beside those of a fit, from the likeliest of its shapes.

        Returns
        -------
        The best; None where no shape gives a finite force.
        """
        found = [
            one
            for start in self._starts(fit, kind)
            if (one := self._fit((*fit.effects, start))) is not None
        ]
        return min(found, key=lambda one: one.rms, default=None)

    def is_at_bound(self, fit: ForceFit) -> bool:
        """Whether a parameter of the last law of a fit stands at an end of its range.

        Zero is none: it is where a part of the law is absent.
        """
        effect = fit.effects[-1]
        for parameter in self.kinds[effect.kind].parameters:
            value = effect.parameters[parameter.name]
            for end in (parameter.low, parameter.high):
                near = abs(value - end) < AT_BOUND * max(abs(end), np.finfo(float).tiny)
                if parameter.fitted and end != 0 and math.isfinite(end) and near:
                    return True
        return False

    def _starts(self, fit: ForceFit, kind: Kind) -> Iterator[Effect]:
        """List shapes of a law that explain most of what a fit leaves."""
        step = max(len(self.force) // ROUGH_SAMPLES, 1)
        whole = _joined([one.motion for one in self.records])
        shapes = list(kind.shapes(whole)) or [{}]
        left = np.concatenate(fit.residuals)[::step]
        ranked: list[tuple[float, dict[str, float]]] = []
        for shape in shapes:
            unit = dict(shape)
            if kind.strength is not None:
                unit[kind.strength] = 1.0
            try:
                force = self._along(kind, unit)[::step]
            except ValueError:
                continue
            if not np.isfinite(force).all() or not force.any():
                continue
            columns = np.column_stack([force, self.linear[::step]])
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
        for _, parameters in ranked[:STARTS]:
            yield Effect(kind.name, self.place, parameters)

    def _along(self, kind: Kind, parameters: Mapping[str, float]) -> Series:
        return np.concatenate(
            [force_along(kind, parameters, one.motion) for one in self.records]
        )

    def _fit(self, effects: tuple[Effect, ...]) -> ForceFit | None:
        """Fit all parameters of effects, with the constants eliminated linearly."""
        free = [
            (i, p.name)
            for i, effect in enumerate(effects)
            for p in self.kinds[effect.kind].parameters
            if p.fitted
        ]
        start = np.array([effects[i].parameters[name] for i, name in free])
        scale = np.where(start != 0, np.abs(start), 1.0)
        low, high = (
            np.array([getattr(self._parameter(effects, i, n), end) for i, n in free]) / scale
            for end in ("low", "high")
        )
        # A law that explodes is as bad as this, and its squares stay numbers.
        bound = 1e6 * max(float(np.std(self.force)), np.finfo(float).tiny)

        def laws(values: Float[np.ndarray, " free"]) -> tuple[Effect, ...]:
            changed = [dict(effect.parameters) for effect in effects]
            for (i, name), value in zip(free, (values * scale).tolist(), strict=True):
                changed[i][name] = value
            return tuple(
                dataclasses.replace(effect, parameters=parameters)
                for effect, parameters in zip(effects, changed, strict=True)
            )

        def residual(values: Float[np.ndarray, " free"]) -> Series:
            left = self.force.copy()
            for effect in laws(values):
                left = left - self._along(self.kinds[effect.kind], effect.parameters)
            left = np.clip(np.nan_to_num(left, nan=bound), -bound, bound)
            constants = self._constants(left, level[0])[0]
            rows = (constants - self.mean) / self.sd * level[0]
            return np.concatenate([left - self.linear @ constants, rows])

        level = [float(np.std(self.force)) * 0.1]
        values = start / scale
        for _round in range(2):
            if len(free):
                inside = np.clip(values, low + 1e-9, high - 1e-9)
                found = scipy.optimize.least_squares(
                    residual,
                    inside,
                    bounds=(low, high),
                    diff_step=DIFFERENCE_STEP,
                    max_nfev=MAX_EVALUATIONS,
                )
                values = found.x
            left = residual(values)[: len(self.force)]
            level[0] = max(float(np.sqrt(np.mean(left**2))), np.finfo(float).tiny)
        return self._result(laws, residual, values, scale, free, level[0])

    def _result(
        self,
        laws: Callable[[Float[np.ndarray, " free"]], tuple[Effect, ...]],
        residual: Callable[[Float[np.ndarray, " free"]], Series],
        values: Float[np.ndarray, " free"],
        scale: Float[np.ndarray, " free"],
        free: Sequence[tuple[int, str]],
        level: float,
    ) -> ForceFit | None:
        effects = laws(values)
        whole = residual(values)
        left = whole[: len(self.force)]
        if not np.isfinite(left).all():
            return None
        residuals = tuple(np.split(left, self.ends))
        count = independent_samples(residuals)
        force = self.force.copy()
        for effect in effects:
            force -= self._along(self.kinds[effect.kind], effect.parameters)
        constants, inner = self._constants(force, level)
        inflated = level * math.sqrt(len(left) / max(count, 1.0))
        columns = [
            (residual(values + step)[: len(left)] - left) / size
            for step, size in (
                (1e-4 * np.eye(len(values))[i] * max(abs(values[i]), 1e-3),
                 1e-4 * max(abs(values[i]), 1e-3))
                for i in range(len(values))
            )
        ]  # fmt: skip
        sds: list[dict[str, float]] = [{} for _ in effects]
        if columns:
            jacobian = np.stack(columns, axis=1)
            if not np.isfinite(jacobian).all():
                return None
            covariance = np.linalg.pinv(jacobian.T @ jacobian)
            spread = inflated * np.sqrt(np.maximum(np.diag(covariance), 0.0)) * scale
            for (i, name), sd in zip(free, spread.tolist(), strict=True):
                sds[i][name] = sd
        return ForceFit(
            constants=constants,
            constants_sd=inflated / level * np.sqrt(np.diag(np.linalg.pinv(inner))),
            effects=effects,
            sds=tuple(sds),
            residuals=residuals,
            pulls=float(np.sum(((constants - self.mean) / self.sd) ** 2)),
        )

    def _constants(
        self, force: Series, level: float
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """Stiffness, damping and constant, under their priors; and their information."""
        inner = self.linear.T @ self.linear / level**2 + np.diag(1 / self.sd**2)
        right = self.linear.T @ force / level**2 + self.mean / self.sd**2
        return np.linalg.solve(inner + 1e-12 * np.diag(np.diag(inner)), right), inner

    def _parameter(self, effects: Sequence[Effect], number: int, name: str) -> Parameter:
        return self.kinds[effects[number].kind].parameter(name)


def _joined(motions: Sequence[Motion]) -> Motion:
    return Motion(
        e=np.concatenate([m.e for m in motions]),
        v=np.concatenate([m.v for m in motions]),
        a=np.concatenate([m.a for m in motions]),
        times=np.concatenate([m.times for m in motions]),
    )


def applicable_kinds(kinds: Mapping[str, Kind]) -> list[Kind]:
    """List laws of elements that depend on motion alone, neither on time nor on tones."""
    return [
        kind
        for kind in kinds.values()
        if kind.where == "element"
        and isinstance(kind.action, Law | Friction)
        and not kind.is_surface
        and kind.quadrature is None
        and not (isinstance(kind.action, Law) and kind.action.switches)
        and not any(p.unit == "s" and "t_" in p.name for p in kind.parameters)
    ]
