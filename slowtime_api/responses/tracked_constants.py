"""Constants of a nonlinear structure over slow time, estimated from each record."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.evolution.predicted_response.ageing import learn_ageing
from slowtime_api.models import Model
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_api.signals import Signals
from slowtime_services.argument_checks import NotNegative, Vector, checked
from slowtime_services.constant_tracking import TrackedConstants, label
from slowtime_services.constant_tracking import track as track_constants
from slowtime_services.diagnose import Source, read_any

MIN_FORECAST_RECORDS = 5
"""Records from which constants are forecast [1]."""

FORECAST_STEPS = 10
"""Slow times of a forecast [1]."""

MAX_RESIDUAL_RATIO = 1.5
"""Mean squared residual over what was expected [1], above which the model is doubted."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ConstantHistory(Result):
    """Constants of each record, in the order of slow time.

    Parameters
    ----------
    found
        Constants with their covariances, and the structure with nominal values.
    slow_time
        Slow time of each record.
    """

    found: TrackedConstants
    slow_time: Float[np.ndarray, " record"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the constants, such as ``"storey1.stiffness"``."""
        return tuple(label(name) for name in self.found.constants.names)

    @property
    def value(self) -> Float[np.ndarray, "record constant"]:
        """Constants of each record, in SI units."""
        return self.found.constants.value

    @property
    def sd(self) -> Float[np.ndarray, "record constant"]:
        """Standard deviations of `value`."""
        return np.asarray(np.abs(self.value) * self.found.constants.log_sd)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed."""
        return self.found.notes

    @property
    def warnings(self) -> tuple[str, ...]:
        """Records whose residuals are larger than expected, in sentences."""
        surprises = self.found.constants.surprise.tolist()
        return tuple(
            f"{origin}: the residuals are {surprise:.1f} times as large as expected (mean "
            "square). The model lacks something, or the stated noise and white force are "
            "too small; `slowtime diagnose` looks for what is missing."
            for origin, surprise in zip(self.found.origins, surprises, strict=True)
            if surprise > MAX_RESIDUAL_RATIO
        )

    @property
    def heading(self) -> str:
        """What was tracked, in a line."""
        return f"{len(self.names)} constants of {len(self.slow_time)} records"

    def rows(self) -> list[dict[str, Any]]:
        """Return each constant of each record.

        Returns
        -------
        One dictionary each: ``record``, ``slow_time``, ``constant``, ``value``, ``sd``, ends
        ``lo`` and ``hi`` of the 95 % interval, ``nominal`` and ``surprise`` [1].
        """
        constants = self.found.constants
        lo, hi = constants.interval()
        value, sd = self.value, self.sd
        return [
            {
                "record": origin, "slow_time": float(time), "constant": name,
                "value": float(value[i, k]), "sd": float(sd[i, k]), "lo": float(lo[i, k]),
                "hi": float(hi[i, k]), "nominal": float(constants.nominal[k]),
                "surprise": float(constants.surprise[i]),
            }
            for i, (origin, time) in enumerate(
                zip(self.found.origins, self.slow_time, strict=True)
            )
            for k, name in enumerate(self.names)
        ]  # fmt: skip

    @checked
    def forecast(self, until: float) -> list[dict[str, Any]]:
        """Forecast the constants by the laws that their history follows.

        Parameters
        ----------
        until
            Slow time of the end of the forecast.

        Returns
        -------
        One dictionary per slow time and constant: ``slow_time``, ``constant``, ``value``, and
        ends ``lo`` and ``hi`` of the 95 % band.

        Raises
        ------
        ValueError
            If there are fewer than 5 records, or `until` is not after the last one.
        """
        last = float(self.slow_time.max())
        if not until > last:
            raise ValueError(
                f"until={until:g} was given. Give a slow time after the last record, at "
                f"{last:g}."
            )
        if len(self.slow_time) < MIN_FORECAST_RECORDS:
            raise ValueError(
                f"{len(self.slow_time)} records were given. A forecast takes "
                f"{MIN_FORECAST_RECORDS} at least."
            )
        constants = self.found.constants
        names = tuple(dict.fromkeys(name[0] for name in constants.names))
        ageing = learn_ageing(self.found.springs, self.slow_time, constants, of=names)
        later = last + (until - last) * np.arange(1, FORECAST_STEPS + 1) / FORECAST_STEPS
        rows: list[dict[str, Any]] = []
        for name in constants.names:
            band = ageing.future(name, later)
            for time, value, lo, hi in zip(later, band.value, band.lo, band.hi, strict=True):
                rows.append(
                    {
                        "slow_time": float(time), "constant": label(name),
                        "value": float(value), "lo": float(lo), "hi": float(hi),
                    }
                )  # fmt: skip
        return rows

    @checked
    def plot(self, path: str | Path | None = None) -> list[Axes]:
        """Draw each constant over slow time with its standard deviation.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes, one for each constant.
        """
        axes = new_figure(len(self.names))
        for k, (panel, name) in enumerate(zip(axes, self.names, strict=True)):
            panel.errorbar(
                self.slow_time, self.value[:, k], yerr=self.sd[:, k], fmt="o-", capsize=2
            )
            panel.set(xlabel="slow time", ylabel=name)
        return list(save(axes, path))


@checked
def track(
    model: Model | str | Path,
    signals: Sequence[Signals | str | Path],
    *,
    slow_time: Vector | None = None,
    free: Sequence[str] | None = None,
    white_force: NotNegative = 0.0,
    force_sd: NotNegative | None = None,
) -> ConstantHistory:
    """Track the constants of a nonlinear structure over slow time.

    Parameters
    ----------
    model
        Point masses and springs with inputs and accelerometers, or the path of the file; its
        effects are laws without memory.
    signals
        Signals or files in the order of slow time, one for each record.
    slow_time
        Slow time of each record; 0, 1, 2, ... where not given.
    free
        Constants to be estimated, such as ``"storey1.stiffness"``; all stiffnesses, dampings
        and numbers of effects where not given.
    white_force
        Square root of the density of unmeasured white force on every node [N s^(1/2)].
    force_sd
        Standard deviation of the error of each measured force [N]; 1 % of its rms where not
        given.

    Returns
    -------
    Constants of each record with standard deviations.

    Raises
    ------
    ValueError
        If model and records do not go together, or a name is no constant of the model.
    """
    if not signals:
        raise ValueError("signals=[] was given. Give at least one record.")
    known = model if isinstance(model, Model) else Model.from_file(model)
    sources = [
        Source(f"record {i + 1}", one.record) if isinstance(one, Signals) else read_any(one)
        for i, one in enumerate(signals)
    ]
    return track_sources(
        known, sources, slow_time=slow_time, free=free, white_force=white_force,
        force_sd=force_sd,
    )  # fmt: skip


def track_sources(
    model: Model,
    sources: Sequence[Source],
    *,
    slow_time: Sequence[float] | None,
    free: Sequence[str] | None,
    white_force: float,
    force_sd: float | None,
) -> ConstantHistory:
    """Track the constants of records that have names, as `track` does."""
    times = range(len(sources)) if slow_time is None else slow_time
    if len(times) != len(sources):
        raise ValueError(
            f"{len(times)} slow times were given for {len(sources)} records. Give one for each."
        )
    found = track_constants(
        model.description, sources, free=free, white_n=white_force, force_sd_n=force_sd
    )
    of_record = dict(zip((source.name for source in sources), times, strict=True))
    slow = np.array([float(of_record[name]) for name in found.origins])
    return ConstantHistory(found=found, slow_time=slow)
