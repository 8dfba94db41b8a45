"""Runs a virtual sensor over blocks; it restarts after a gap."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from edge_agent.settings import Origin, VirtualStageSettings
from slowtime.dynamics.description import Description
from slowtime.estimation.virtual import SensorWindow, VirtualSensor, VirtualState
from slowtime.signals.block import Block
from slowtime_schemas.messages import Virtual, VirtualQuantity
from slowtime_services.virtual_sensors.sensor import make_sensor, read_structure, si_factors

DIGITS = 6
"""Significant digits of a value that travels."""
MOST_VALUES = 10_000
"""Of one quantity in one message."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WindowEstimate:
    """Outputs of one window, and where they belong."""

    values: Float[np.ndarray, "time output"]
    settled: Bool[np.ndarray, " time"]
    missing_variance: Float[np.ndarray, " output"]
    model_variance: Float[np.ndarray, " output"]
    reasons: tuple[str, ...]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunningSensor:
    """A running virtual sensor: its span of samples, and its filter state."""

    sensor: VirtualSensor
    columns: list[int]
    factors: Float[np.ndarray, " channel"]
    state: VirtualState
    latest: Block
    start_ns: int


class VirtualStage:
    """Makes virtual quantities of blocks."""

    def __init__(self, settings: VirtualStageSettings, origin: Origin) -> None:
        self._settings, self._origin = settings, origin
        self._description: Description = read_structure(settings.model)
        self.units = {one.name: one.output().unit for one in settings.outputs}

    def step(
        self, running: RunningSensor | None, block: Block, sequence: int
    ) -> tuple[RunningSensor, tuple[WindowEstimate, ...], tuple[Virtual, ...]]:
        """Take one block; give the windows that it completes."""
        if running is None or not _continues(running.latest, block):
            running = self._begin(block)
        samples = block.samples[:, running.columns] * running.factors
        state, windows = running.sensor.step(running.state, samples)
        running = dataclasses.replace(running, state=state, latest=block)
        estimated: list[WindowEstimate] = []
        messages: list[Virtual] = []
        for window in windows:
            estimated.append(
                WindowEstimate(
                    values=window.values,
                    settled=window.settled,
                    missing_variance=window.missing_variance,
                    model_variance=window.model_variance,
                    reasons=window.reasons,
                )
            )
            if self._settings.tell_hz > 0:
                messages.append(self._message(running, window, sequence + len(messages)))
        return running, tuple(estimated), tuple(messages)

    def _begin(self, block: Block) -> RunningSensor:
        sensor, channels = make_sensor(
            self._description,
            block.channels,
            self._settings.outputs,
            block.rate_hz,
            self._settings.estimation,
            moving_base=self._settings.moving_base,
        )
        columns = [block.channels.index(channel) for channel in channels]
        units = [block.units[column] for column in columns]
        return RunningSensor(
            sensor=sensor,
            columns=columns,
            factors=np.array(si_factors(self._description, channels, units)),
            state=sensor.start(),
            latest=block,
            start_ns=block.start_ns,
        )

    def _message(self, running: RunningSensor, window: SensorWindow, sequence: int) -> Virtual:
        rate = running.latest.true_rate_hz
        every = max(
            1,
            round(running.sensor.rate_hz / self._settings.tell_hz),
            -(-len(window.values) // MOST_VALUES),
        )
        start_ns = running.start_ns + round(window.first_index * 1e9 / rate)
        told = slice(None, None, every)
        count = len(window.values[told])
        reasons = window.reasons
        if not window.settled.all():
            reasons += ("settling",)
        quantities = tuple(
            VirtualQuantity(
                name=output.name,
                unit=output.unit,
                values=tuple(map(_short, window.values[told, i])),
                sd=tuple(map(_short, window.sd[told, i])),
            )
            for i, output in enumerate(running.sensor.outputs)
        )
        return Virtual(
            site=self._origin.site,
            asset=self._origin.asset,
            boot=self._origin.boot,
            time_base=self._origin.time_base,
            sequence=sequence,
            start_ns=start_ns,
            t_ns=start_ns + round((count - 1) * every * 1e9 / rate),
            rate_hz=rate / every,
            lowest_hz=running.sensor.lowest_hz,
            valid=not reasons,
            reasons=reasons,
            quantities=quantities,
        )


def _continues(latest: Block, block: Block) -> bool:
    return block.follows(latest)


def _short(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
