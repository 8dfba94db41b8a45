"""Parameters of an effect in physical units, with standard deviations."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.diagnosis import Number
from slowtime.history_diagnosis.data.history import ScaledHistory
from slowtime.history_diagnosis.forecasting.mixture import EnsembleMember
from slowtime.history_diagnosis.laws.terms import ScreenedHistory, Term, solve

Moments = tuple[float, float, str]
"""Value, variance and unit of a number."""


@dataclasses.dataclass(frozen=True, slots=True)
class ReportUnits:
    """Units in which values and slow times are reported.

    `factor` leads from the unit of the values to that one: 100 from ratios to per cent.
    """

    value: str
    factor: float
    time: str

    @property
    def rate(self) -> str:
        """Unit of a change over time."""
        return f"{self.value}/{self.time}"


def effect_parameters(
    readings: ScreenedHistory,
    members: tuple[EnsembleMember, ...],
    place: int,
    units: ReportUnits,
) -> dict[str, Number]:
    """Return the parameters of one term, averaged over a mixture.

    The spread of the mixture is part of each standard deviation.
    """
    told = []
    for member in members:
        found, _ = solve(readings, member.terms, member.process)
        own = columns_of(member.terms, place)
        estimate = _Estimate(
            member.terms[place],
            found.mean[own],
            found.covariance[own, own],
            readings.past,
            units,
        )
        told.append(estimate.numbers())
    weights = np.array([member.weight for member in members])
    best = {}
    for name, (_, _, unit) in told[0].items():
        values = np.array([one[name][0] for one in told])
        variances = np.array([one[name][1] for one in told])
        mean = float(weights @ values)
        sd = float(np.sqrt(weights @ (variances + (values - mean) ** 2)))
        # What is fixed, as a kink at freezing, differs by rounding only.
        sd = sd if sd > 1e-9 * abs(mean) else 0.0
        best[name] = Number(mean, sd, unit)
    return best


def columns_of(terms: tuple[Term, ...], place: int) -> slice:
    """Return the columns of the term at a place within the design matrix."""
    first = 1 + sum(term.law.width for term in terms[:place])
    return slice(first, first + terms[place].law.width)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Estimate:
    """Coefficients of one term with its shape, still in the scale of the history."""

    term: Term
    mean: Float[np.ndarray, " column"]
    covariance: Float[np.ndarray, "column column"]
    past: ScaledHistory
    units: ReportUnits

    def numbers(self) -> dict[str, Moments]:
        """Return all numbers of the term."""
        law, shape, past, units = self.term.law, self.term.shape, self.past, self.units
        if law.name == "step":
            return {"change": self._first(), "time": self._instant(shape[0])}
        if law.name == "breathing_crack":
            slope = {"opening_slope": self._slope(1)}
            return {"change": self._first(), "time": self._instant(shape[0])} | slope
        if law.family == "drift":
            return self._drift()
        if law.variant == "irregular":
            return self._irregular_sawtooth()
        if law.name == "sawtooth":
            reset = past.start + past.span * (0.5 + (1.0 - shape[1]) / shape[0])
            return {
                "height": self._first(),
                "period": (past.span / shape[0], 0.0, units.time),
                "reset_time": (reset, 0.0, units.time),
            }
        if law.name == "periodic":
            return self._periodic()
        if law.name == "sensor_noise":
            factor = (float(np.exp(shape[1])), 0.0, "1")
            return {"factor": factor, "time": self._instant(shape[0])}
        if law.name == "amplitude_dependence":
            fixed = {"quadratic": 2.0, "linear": 1.0}.get(law.variant)
            exponent = float(np.exp(shape[0])) if fixed is None else fixed
            return {"change_at_mean_level": self._first(), "exponent": (exponent, 0.0, "1")}
        if law.name.endswith("curved"):
            return {}
        return self._covariate()

    def _first(self) -> Moments:
        size = self.units.factor * self.past.scale
        return size * self.mean[0], size**2 * self.covariance[0, 0], self.units.value

    def _rate(self) -> Moments:
        value, variance, _ = self._first()
        span = self.past.span
        return value / span, variance / span**2, self.units.rate

    def _slope(self, index: int) -> Moments:
        assert self.term.law.covariate is not None
        series = self.past.covariates[self.term.law.covariate]
        size = self.units.factor * self.past.scale / series.scale
        per = "" if not series.unit else "/" + series.unit.replace("°C", "K")
        variance = size**2 * self.covariance[index, index]
        return size * self.mean[index], variance, self.units.value + per

    def _instant(self, at: float) -> Moments:
        # Anywhere between two epochs: uniform over a step from one to the next.
        past = self.past
        return past.start + past.span * at, (past.span * past.gap) ** 2 / 12.0, self.units.time

    def _drift(self) -> dict[str, Moments]:
        law, shape = self.term.law, self.term.shape
        if law.name == "drift_linear":
            return {"rate": self._rate()} | (
                {"onset": self._instant(shape[0])} if shape else {}
            )
        if law.name == "drift_exponential":
            constant = (self.past.span / shape[0], 0.0, self.units.time)
            return {"change": self._first(), "time_constant": constant}
        return {"change": self._first(), "exponent": (float(np.exp(shape[0])), 0.0, "1")}

    def _irregular_sawtooth(self) -> dict[str, Moments]:
        falls, past, units = self.term.shape, self.past, self.units
        lengths = past.span * np.diff(np.sort(falls))
        period = float(np.mean(lengths))
        value, variance, _ = self._first()
        height = value * period / past.span, variance * (period / past.span) ** 2, units.value
        return {
            "height": height,
            "rate": self._rate(),
            "period": (period, float(np.var(lengths)), units.time),
            "last_reset_time": self._instant(max(falls)),
        }

    def _periodic(self) -> dict[str, Moments]:
        mean, covariance, past, units = self.mean, self.covariance, self.past, self.units
        size = units.factor * past.scale
        amplitude = float(np.hypot(*mean))
        along, across = mean / amplitude, np.array([-mean[1], mean[0]]) / amplitude
        amplitude_variance = size**2 * float(along @ covariance @ along)
        period = past.span / float(np.exp(self.term.shape[0]))
        turn = period / (2.0 * np.pi)
        peak = past.start + 0.5 * past.span + turn * float(np.arctan2(mean[1], mean[0]))
        peak_variance = (turn / amplitude) ** 2 * float(across @ covariance @ across)
        return {
            "amplitude": (size * amplitude, amplitude_variance, units.value),
            "period": (period, 0.0, units.time),
            "time_of_maximum": (peak, peak_variance, units.time),
        }

    def _covariate(self) -> dict[str, Moments]:
        law = self.term.law
        assert law.covariate is not None
        named = dict(zip((axis.name for axis in law.axes), self.term.shape, strict=True))
        found = {"slope": self._slope(0)}
        if law.width == 2:
            series = self.past.covariates[law.covariate]
            kink = series.centre + series.scale * named["kink"] if "kink" in named else 0.0
            found = {"slope_below": self._slope(0), "slope_above": self._slope(1)}
            found["kink"] = (kink, 0.0, series.unit)
        if "log lag" in named:
            name = "delay" if "delay" in law.variant else "lag"
            lag = float(np.exp(named["log lag"])) * self.past.span
            found[name] = (lag, 0.0, self.units.time)
        return found
