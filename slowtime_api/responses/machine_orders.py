"""Amplitudes of orders of a rotating machine against its speed."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.order_tracking import rotation_of, track_orders
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_api.signals import Signals
from slowtime_services.argument_checks import Bounds, Count, checked
from slowtime_services.files import bridged, find_column

Orders = Annotated[Sequence[float], Bounds(above=0)]


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MachineOrders(Result):
    """Complex amplitudes of orders, block by block.

    Parameters
    ----------
    orders
        Multiples of the speed [1].
    channels, units
        Channels, and their units.
    time_s, speed_hz
        Middle of each block [s], and its mean speed [Hz].
    amplitude
        Peak amplitude in the unit of each channel; the phase is that of a cosine at the first
        pulse of the tacho.
    sd
        Standard deviation of the complex error.
    notes
        What was assumed about the record.
    """

    orders: Float[np.ndarray, " order"]
    channels: tuple[str, ...]
    units: tuple[str, ...]
    time_s: Float[np.ndarray, " block"]
    speed_hz: Float[np.ndarray, " block"]
    amplitude: Complex[np.ndarray, "block order channel"]
    sd: Float[np.ndarray, "block order channel"]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def heading(self) -> str:
        """What was tracked, in a line."""
        return f"{len(self.orders)} orders of {len(self.channels)} channels, {len(self)} blocks"

    def rows(self) -> list[dict[str, Any]]:
        """Return each block, order and channel.

        Returns
        -------
        One dictionary each: ``time_s``, ``speed_hz``, ``order``, ``channel``, ``unit``,
        ``amplitude`` and ``sd`` in the unit, ``phase_deg``.
        """
        return [
            _row(self, block, k, c)
            for block in range(len(self))
            for k in range(len(self.orders))
            for c in range(len(self.channels))
        ]

    @checked
    def plot(self, path: str | Path | None = None) -> list[Axes]:
        """Draw the amplitude of each order against the speed.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes, one for each channel.
        """
        axes = new_figure(len(self.channels))
        order = np.argsort(self.speed_hz)
        for c, panel in enumerate(axes):
            for k, multiple in enumerate(self.orders):
                size = np.abs(self.amplitude[order, k, c])
                panel.plot(self.speed_hz[order], size, label=f"order {multiple:g}")
            unit = f" [{self.units[c]}]" if self.units[c] else ""
            panel.set(xlabel="speed [Hz]", ylabel=f"{self.channels[c]}{unit}")
            panel.legend()
        return list(save(axes, path))


def _row(found: MachineOrders, block: int, order: int, channel: int) -> dict[str, Any]:
    value = complex(found.amplitude[block, order, channel])
    return {
        "time_s": float(found.time_s[block]),
        "speed_hz": float(found.speed_hz[block]),
        "order": float(found.orders[order]),
        "channel": found.channels[channel],
        "unit": found.units[channel],
        "amplitude": abs(value),
        "phase_deg": math.degrees(math.atan2(value.imag, value.real)),
        "sd": float(found.sd[block, order, channel]),
    }


@checked
def orders(
    signals: Signals,
    tacho: str,
    wanted: Orders = (1.0, 2.0, 3.0),
    *,
    pulses: Count = 1,
    revolutions: Count = 16,
) -> MachineOrders:
    """Track the orders of a rotating machine, with a tacho signal.

    Parameters
    ----------
    signals
        Vibration, and a channel with pulses of the shaft.
    tacho
        Channel with the pulses.
    wanted
        Multiples of the speed to be tracked [1].
    pulses
        Pulses per revolution.
    revolutions
        Revolutions of a block.

    Returns
    -------
    Amplitude and phase of each order, channel and block, with standard deviations.

    Raises
    ------
    ValueError
        If there is no other channel, or the tacho has too few pulses.

    References
    ----------
    .. [1] K. R. Fyfe and E. D. S. Munck, "Analysis of computed order tracking", Mechanical
       Systems and Signal Processing 11 (1997) 187-205.

    Examples
    --------
    >>> angle = 2 * np.pi * 10.0 * np.arange(8000) / 1000.0
    >>> both = np.stack([(np.sin(angle) > 0.9).astype(float), 0.5 * np.cos(2 * angle)], 1)
    >>> found = orders(Signals(both, 1000.0, ["tacho", "x"]), "tacho", [2])
    >>> round(float(abs(found.amplitude[1, 0, 0])), 3)
    0.5
    """
    record, said = bridged(signals.record)
    column = find_column(tacho, record.channels)
    others = [k for k in range(len(record.channels)) if k != column]
    if not others:
        raise ValueError(
            f"The record has only the tacho channel {record.channels[column]}. Give a record "
            "that has vibration channels too."
        )
    samples = np.asarray(record.samples, dtype=float)
    rotation = rotation_of(samples[:, column], record.rate_hz, pulses_per_revolution=pulses)
    found = track_orders(
        samples[:, others], record.rate_hz, rotation, wanted, revolutions=revolutions
    )
    return MachineOrders(
        orders=found.order, channels=tuple(record.channels[k] for k in others),
        units=tuple(record.units[k] for k in others), time_s=found.time_s,
        speed_hz=found.speed_hz, amplitude=found.amplitude, sd=found.sd,
        notes=(said,) if said else (),
    )  # fmt: skip
