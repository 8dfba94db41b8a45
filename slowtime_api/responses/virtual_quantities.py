"""Displacements, drifts, forces and stresses that nobody measures."""

import dataclasses
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from slowtime.estimation.virtual import VirtualSettings
from slowtime_api.arguments import fields_named
from slowtime_api.models import Model
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_api.signals import Signals
from slowtime_services.argument_checks import NotNegative, Positive, checked
from slowtime_services.files import bridged
from slowtime_services.virtual_sensors.sensor import make_sensor, si_factors
from slowtime_services.virtual_sensors.settings import Asked

Series = Float[np.ndarray, " time"]
REASON_TEXTS = {
    "unseen_mode_": "{}: no sensor sees this mode, so its contribution comes from the model "
    "alone.",
    "model_misfit": "{}: the model does not explain the spectra of the channels. Update it.",
}
"""Reason of an estimate that is worse than it says → sentence."""
NO_TOLERANCE = (
    "The model states no tolerance, so its own error is not part of the standard deviation."
)


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class VirtualQuantity(Result):
    """A quantity of a model over time, estimated from accelerations.

    Parameters
    ----------
    name, unit
        Name of the quantity, and its unit.
    rate_hz
        Sampling rate [Hz].
    values, sd
        Estimate and its standard deviation at each sample.
    settled
        Whether the filters have settled, at each sample.
    channels
        Channels that it was estimated from.
    lowest_hz
        Lower edge of the band [Hz]: accelerations do not show slower motion.
    missing_variance, model_variance
        Mean variances of modes that no sensor sees, and of the model's own error.
    reasons
        Reasons for larger errors than stated, as words.
    notes
        The same in sentences, and what was assumed.
    """

    name: str
    unit: str
    rate_hz: float
    values: Series
    sd: Series
    settled: Bool[np.ndarray, " time"]
    channels: tuple[str, ...]
    lowest_hz: float
    missing_variance: float
    model_variance: float
    reasons: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def _some(self) -> Bool[np.ndarray, " time"]:
        """Samples that statistics are taken over: the settled ones, or all."""
        return self.settled if self.settled.any() else np.ones_like(self.settled)

    @property
    def rms(self) -> float:
        """Root mean square after the filters have settled."""
        return float(np.sqrt(np.mean(self.values[self._some] ** 2)))

    @property
    def largest(self) -> float:
        """Largest magnitude after the filters have settled."""
        return float(np.abs(self.values[self._some]).max())

    @property
    def mean_sd(self) -> float:
        """Root mean square of the standard deviations after the filters have settled."""
        return float(np.sqrt(np.mean(self.sd[self._some] ** 2)))

    @property
    def times_s(self) -> Series:
        """Time of each sample since the first [s]."""
        return np.arange(len(self.values)) / self.rate_hz

    @property
    def heading(self) -> str:
        """What was estimated, in a line."""
        return f"{self.name} [{self.unit}] from {len(self.channels)} channels"

    def rows(self) -> list[dict[str, Any]]:
        """Return a summary.

        Returns
        -------
        One dictionary: ``quantity``, ``unit``, ``rms``, ``largest`` and ``sd`` in the unit,
        ``lowest_hz`` and ``seconds``.
        """
        return [
            {
                "quantity": self.name, "unit": self.unit, "rms": self.rms,
                "largest": self.largest, "sd": self.mean_sd, "lowest_hz": self.lowest_hz,
                "seconds": len(self.values) / self.rate_hz,
            }
        ]  # fmt: skip

    def signals(self) -> Signals:
        """Return the settled estimate as signals of one channel.

        Returns
        -------
        Signals, for `slowtime.fatigue_damage` or `slowtime.identify`.

        Raises
        ------
        ValueError
            If the record ends before the filters have settled.
        """
        if self.settled.sum() < 2:
            raise ValueError(
                f"The record of {len(self.values) / self.rate_hz:.0f} s ends before the "
                "filters have settled. Give a longer one."
            )
        settled = self.values[self.settled]
        return Signals(settled, self.rate_hz, channels=[self.name], units=self.unit)

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the estimate over time with its 95 % band.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        (axes,) = new_figure()
        low, high = self.values - 1.96 * self.sd, self.values + 1.96 * self.sd
        axes.fill_between(self.times_s, low, high, alpha=0.3, label="95 % band")
        axes.plot(self.times_s, self.values, linewidth=0.8, label="estimate")
        axes.set(xlabel="time [s]", ylabel=f"{self.name} [{self.unit}]")
        axes.legend()
        return save(axes, path)


@checked
def virtual(
    model: Model | str | Path,
    signals: Signals,
    quantity: Literal["displacement", "drift", "force", "moment"],
    *,
    node: str | None = None,
    between: tuple[str, str] | None = None,
    element: str | None = None,
    end: Literal["first", "second"] = "first",
    factor: float | None = None,
    factor_unit: str | None = None,
    factor_sd: NotNegative = 0.0,
    lowest_hz: Positive | None = None,
    moving_base: bool = False,
) -> VirtualQuantity:
    """Estimate a displacement, drift, force, moment or stress that nobody measures.

    A Kalman filter runs on the measured accelerations with the modes of the model. Forces are
    unknown, and how large they are is estimated from the spectra of the accelerations.

    Parameters
    ----------
    model
        Model, or the path of its file; its sensors are named as the channels of the signals.
    signals
        Accelerations.
    quantity
        ``"displacement"`` of a `node`, ``"drift"`` `between` two nodes, elastic ``"force"`` or
        ``"moment"`` of an `element`.
    node
        Node of a displacement.
    between
        Lower and upper node of a drift; ``"base"`` is the ground.
    element
        Element of a force or a moment.
    end
        End of the beam at which the moment is estimated.
    factor
        Factor from SI units to `factor_unit`; for a stress in MPa from a force, 1e-6 / area in
        m^2.
    factor_unit
        Unit of the values after `factor`; SI where not given.
    factor_sd
        Relative standard deviation of `factor` [1].
    lowest_hz
        Lower edge of the band [Hz]; a quarter of the model's lowest frequency where not given.
    moving_base
        Whether the base has an unmeasured motion.

    Returns
    -------
    The quantity at each sample with its standard deviation.

    Raises
    ------
    ValueError
        If the place of the quantity is missing or unknown, or the record is shorter than 40
        periods of the lowest mode.

    References
    ----------
    .. [1] E. Lourens et al., "Joint input-response estimation for structural systems based on
       reduced-order models and vibration data from a limited number of sensors", Mechanical
       Systems and Signal Processing 29 (2012) 310-327.

    Examples
    --------
    >>> frame = Model.shear_frame([1.0, 1.0], [400.0, 400.0], rayleigh=(0.2, 1e-4))
    >>> measured = Signals(
    ...     np.random.default_rng(0).standard_normal((2000, 2)), 50.0,
    ...     channels=frame.channels, units="m/s^2",
    ... )
    >>> drift = virtual(frame, measured, "drift", between=("base", "floor1"))
    >>> drift.name, drift.unit
    ('base-floor1.drift', 'm')
    """
    where = node or element or "-".join(between or ())
    with fields_named({"unit": "factor_unit"}):
        asked = Asked(
            name=f"{where}.{quantity}", quantity=quantity, node=node, between=between,
            element=element, end=end, factor=factor, unit=factor_unit, factor_sd=factor_sd,
        )  # fmt: skip
    known = model if isinstance(model, Model) else Model.from_file(model)
    return estimate_quantity(
        known, signals, asked, lowest_hz=lowest_hz, moving_base=moving_base
    )


def estimate_quantity(
    model: Model,
    signals: Signals,
    asked: Asked,
    *,
    lowest_hz: float | None = None,
    moving_base: bool = False,
) -> VirtualQuantity:
    """Estimate a quantity of a model from the accelerations of a record.

    Parameters
    ----------
    model, signals
        Model, and accelerations on its sensors.
    asked
        The quantity.
    lowest_hz, moving_base
        As of `virtual`.

    Raises
    ------
    ValueError
        If the record is shorter than one window.
    """
    description = model.description
    record, said = bridged(signals.record)
    notes = [said] if said else []
    sensor, channels = make_sensor(
        description, record.channels, [asked], record.rate_hz,
        VirtualSettings(lowest_hz=lowest_hz), moving_base=moving_base,
    )  # fmt: skip
    columns = [record.channels.index(channel) for channel in channels]
    factors = si_factors(description, channels, [record.units[c] for c in columns])
    samples = np.asarray(record.samples, dtype=float)[:, columns] * factors
    state, windows = sensor.step(sensor.start(), samples)
    _, last = sensor.finish(state)
    if not windows:
        raise ValueError(
            f"The record of {record.duration_s:.0f} s is shorter than one window of "
            f"{sensor.window / record.rate_hz:.0f} s, 40 periods of the lowest mode. Give a "
            "longer one."
        )
    every = (*windows, *last)
    reasons = tuple(dict.fromkeys(reason for window in every for reason in window.reasons))
    notes += [NO_TOLERANCE] if description.tolerance is None else []
    notes.append(
        f"Only motion above {sensor.lowest_hz:.3g} Hz is included: accelerations do not show "
        "slower motion."
    )
    notes += [REASON_TEXTS.get(r.rstrip("0123456789"), "{}").format(r) for r in reasons]
    return VirtualQuantity(
        name=asked.name, unit=sensor.outputs[0].unit, rate_hz=record.rate_hz,
        values=np.concatenate([window.values[:, 0] for window in every]),
        sd=np.concatenate([window.sd[:, 0] for window in every]),
        settled=np.concatenate([window.settled for window in every]),
        channels=tuple(channels), lowest_hz=sensor.lowest_hz,
        missing_variance=float(np.mean([window.missing_variance[0] for window in every])),
        model_variance=float(np.mean([window.model_variance[0] for window in every])),
        reasons=reasons, notes=tuple(notes),
    )  # fmt: skip
