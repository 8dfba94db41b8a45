"""What edges tell of their sensors in `Health` → notices: silent, back, samples lost.

The watch does no I/O and has no clock: seconds are arguments.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple

from slowtime_schemas.messages import Health

SILENT = "sensor_silent_s"
LOST = "samples_lost"
UNSURE = "samples_lost_unsure"
DROPPED = "samples_dropped"
TOLD_EVERY_S = 600.0
"""Losses are told at once, then together: a poor radio link must not fill the history."""


class SensorNotice(NamedTuple):
    """An event to be made of what an edge told."""

    site: str
    asset: str
    kind: Literal["sensor_silent", "sensor_back", "samples_lost"]
    severity: Literal["info", "warning", "alarm"]
    message: str
    details: Mapping[str, int | float]


@dataclasses.dataclass(slots=True)
class _Sensor:
    boot: str
    counters: Mapping[str, int]
    silent_s: int = 0
    told_lost: int = 0
    told_s: float | None = None


class SensorWatch:
    """What is known of the live sensors of all edges."""

    def __init__(self) -> None:
        self._sensors: dict[tuple[str, str], _Sensor] = {}

    def hear(self, healths: Iterable[Health], now_s: float) -> list[SensorNotice]:
        """Take what edges say; give what somebody should know."""
        notices: list[SensorNotice] = []
        for health in healths:
            if SILENT in health.counters:
                notices += self._hear(health, now_s)
            else:
                self.forget(health.site, health.asset)
        return notices

    def of(self, site: str, asset: str) -> dict[str, int] | None:
        """Give counters of a live sensor, as its edge told last; None for other inputs."""
        sensor = self._sensors.get((site, asset))
        return None if sensor is None else dict(sensor.counters)

    def forget(self, site: str, asset: str) -> None:
        """Know nothing of an asset any more."""
        self._sensors.pop((site, asset), None)

    def _hear(self, health: Health, now_s: float) -> Iterable[SensorNotice]:
        key = health.site, health.asset
        sensor = self._sensors.get(key)
        if sensor is None:
            sensor = self._sensors[key] = _Sensor(health.boot, health.counters)
        # A boot may be a part of one run of the agent, whose counters go on, or a new run.
        if health.counters.get(LOST, 0) + health.counters.get(DROPPED, 0) < sensor.told_lost:
            sensor.told_lost = 0
        sensor.boot, sensor.counters = health.boot, health.counters
        silent_s, sensor.silent_s = sensor.silent_s, health.counters[SILENT]
        if sensor.silent_s and not silent_s:
            yield SensorNotice(
                *key,
                "sensor_silent",
                "alarm",
                f"The sensor has sent nothing for {sensor.silent_s} s. Look at its supply, its "
                "cable and its network; the edge agent goes on listening.",
                {"silent_s": sensor.silent_s},
            )
        elif silent_s and not sensor.silent_s:
            yield SensorNotice(
                *key,
                "sensor_back",
                "info",
                f"The sensor sends again, after about {silent_s} s of silence.",
                {"silent_s": silent_s},
            )
        yield from self._losses(key, sensor, now_s)

    def _losses(
        self, key: tuple[str, str], sensor: _Sensor, now_s: float
    ) -> Iterable[SensorNotice]:
        lost, dropped = sensor.counters.get(LOST, 0), sensor.counters.get(DROPPED, 0)
        more = lost + dropped - sensor.told_lost
        if more <= 0 or (sensor.told_s is not None and now_s - sensor.told_s < TOLD_EVERY_S):
            return
        sensor.told_lost, sensor.told_s = lost + dropped, now_s
        why = f", {dropped:,} of all because the edge agent fell behind" if dropped else ""
        if unsure := sensor.counters.get(UNSURE, 0):
            why += f", and up to {unsure:,} that its counter is too narrow to tell"
        yield SensorNotice(
            *key,
            "samples_lost",
            "warning",
            f"{more:,} more samples of the sensor are lost, {lost + dropped:,} in all{why}. "
            "Windows that miss too many are left out.",
            {"more": more, "lost": lost, "dropped": dropped},
        )
