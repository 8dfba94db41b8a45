"""Converts features messages to arrays, one column for each quantity."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from slowtime_schemas.messages import Features
from twin_server.history.states import ESTIMATES, sd_factor

_LASTING = "lasting."
_NAN = math.nan
_NO_MODE = (_NAN,) * 7
_NO_TRUTH = (_NAN,) * len(ESTIMATES)


@dataclasses.dataclass(frozen=True, slots=True)
class Columns:
    """One entry per features message; NaN for values that it lacks.

    Parameters
    ----------
    learning_factor
        Factor of standard deviations where readings are averaged [1]: infinite for a window
        that earlier ones have measured wholly.
    """

    sequence: Int[np.ndarray, " time"]
    t_ns: Int[np.ndarray, " time"]
    slow_time: Float[np.ndarray, " time"]
    frequency_hz: Float[np.ndarray, " time"]
    frequency_sd: Float[np.ndarray, " time"]
    damping_ratio: Float[np.ndarray, " time"]
    damping_sd: Float[np.ndarray, " time"]
    correlation: Float[np.ndarray, " time"]
    smoothed_hz: Float[np.ndarray, " time"]
    smoothed_sd: Float[np.ndarray, " time"]
    truth: Float[np.ndarray, "time 4"]
    learning_factor: Float[np.ndarray, " time"]

    def __len__(self) -> int:
        """Count the messages."""
        return len(self.sequence)

    def of(self, rows: Int[np.ndarray, " some"]) -> "Columns":
        """Keep some of them.

        Parameters
        ----------
        rows
            Indices of the messages to keep.

        Returns
        -------
        The columns of these messages, in that order.
        """
        parts = [getattr(self, field.name)[rows] for field in dataclasses.fields(self)]
        return Columns(*parts)


def columns(
    features: Sequence[Features],
    modes: Sequence[int],
    freed: Sequence[bool] | None = None,
    covered: Sequence[float] = (),
) -> Columns:
    """Read the columns out of `features`, of each the structural mode that `modes` numbers.

    Parameters
    ----------
    freed
        For which the truth wanted is that without covariates.
    covered
        Share of the time of each that earlier windows have measured [1]; empty for none.
    """
    count = len(features)
    numbers = [
        (message.slow_time, *_mode(message, mode), *_truth(message, free))
        for message, mode, free in zip(features, modes, freed or [False] * count, strict=True)
    ]
    table = np.array(numbers, dtype=np.float64).reshape(count, 8 + len(ESTIMATES))
    # Each column contiguous: SIMD and scalar loops may differ in the last bit, and states
    # shall not depend on how the stream was cut into batches.
    slow, f, f_sd, z, z_sd, corr, smooth, smooth_sd = np.ascontiguousarray(table[:, :8].T)
    return Columns(
        np.fromiter((message.sequence for message in features), np.int64, count),
        np.fromiter((message.t_ns for message in features), np.int64, count),
        slow,
        f,
        f_sd,
        z,
        z_sd,
        corr,
        smooth,
        smooth_sd,
        np.ascontiguousarray(table[:, 8:]),
        sd_factor(np.array(covered) if covered else np.zeros(count)),
    )


def _mode(message: Features, number: int) -> tuple[float, ...]:
    structural = [mode for mode in message.modes if mode.kind == "structural"]
    if number >= len(structural):
        return _NO_MODE
    mode = structural[number]
    frequency, damping, smoothed = (
        mode.frequency_hz,
        mode.damping_ratio,
        mode.smoothed_frequency_hz,
    )
    found = damping.value > 0.0 or damping.sd > 0.0
    return (
        frequency.value,
        frequency.sd,
        damping.value if found else _NAN,
        damping.sd if found else _NAN,
        mode.correlation,
        _NAN if smoothed is None else smoothed.value,
        _NAN if smoothed is None else smoothed.sd,
    )


def _truth(message: Features, freed: bool) -> tuple[float, ...]:
    if message.truth is None:
        return _NO_TRUTH
    truth = without_covariates(message.truth) if freed else message.truth
    return tuple([truth.get(name, _NAN) for name in ESTIMATES])


def without_covariates(truth: Mapping[str, float]) -> Mapping[str, float]:
    """Return the true values of a simulation, without the effect of temperature where known.

    Parameters
    ----------
    truth
        True values of a simulation, by name.

    Returns
    -------
    The same; quantities with a ``lasting.`` value have that value.

    Examples
    --------
    >>> without_covariates({"stiffness_change": -0.05, "lasting.stiffness_change": -0.02})
    {'stiffness_change': -0.02, 'lasting.stiffness_change': -0.02}
    """
    lasting = {
        name.removeprefix(_LASTING): value
        for name, value in truth.items()
        if name.startswith(_LASTING)
    }
    return {**truth, **lasting}
