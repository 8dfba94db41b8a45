"""Makes notices of reports on live sensors: silent, back, restarted, samples lost.

The watch does no I/O and has no clock: seconds are arguments. What it has told before is read
from the history, so that a server that starts again neither repeats nor misses anything.
"""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, NamedTuple

from slowtime_schemas.messages import Health

SILENT = "sensor_silent_s"
LOST = "samples_lost"
UNSURE = "samples_lost_unsure"
DROPPED = "samples_dropped"
RESTARTS = "source_restarts"
TOLD_EVERY_S = 600.0
"""Losses are told at once, then together: a poor radio link must not fill the history."""


class SensorNotice(NamedTuple):
    """An event to be made from an edge's report on a sensor."""

    site: str
    asset: str
    kind: Literal["sensor_silent", "sensor_back", "samples_lost", "source_restarted"]
    severity: Literal["info", "warning", "alarm"]
    message: str
    details: Mapping[str, int | float]


@dataclasses.dataclass(slots=True)
class _Sensor:
    boot: str
    counters: Mapping[str, int]
    is_silent: bool = False
    silent_s: int = 0
    told_lost: int = 0
    told_s: float | None = None
    told_restarts: int = 0


Told = Callable[[str, str], Iterable[Mapping[str, Any]]]
"""Events of an asset that were told before, the newest first: `kind` and `details`."""


def _nothing(site: str, asset: str) -> Iterable[Mapping[str, Any]]:
    return ()


class SensorWatch:
    """Watches the live sensors of all edges by their health messages.

    Parameters
    ----------
    told
        Asked once of each asset, when its sensor is first heard of.
    """

    def __init__(self, told: Told = _nothing) -> None:
        self._told = told
        self._sensors: dict[tuple[str, str], _Sensor] = {}

    def hear(self, healths: Iterable[Health], now_s: float) -> list[SensorNotice]:
        """Take health reports of edges; return the notices they cause.

        Parameters
        ----------
        healths
            Health messages.
        now_s
            Monotonic time [s].

        Returns
        -------
        Notices of sensors whose state has changed.
        """
        notices: list[SensorNotice] = []
        for health in healths:
            if SILENT in health.counters:
                notices += self._hear(health, now_s)
            else:
                self.forget(health.site, health.asset)
        return notices

    def of(self, site: str, asset: str) -> dict[str, int] | None:
        """Return the latest counters of a live sensor; None for other inputs."""
        sensor = self._sensors.get((site, asset))
        return None if sensor is None else dict(sensor.counters)

    def forget(self, site: str, asset: str) -> None:
        """Delete the state of an asset."""
        self._sensors.pop((site, asset), None)

    def _hear(self, health: Health, now_s: float) -> Iterable[SensorNotice]:
        key = health.site, health.asset
        sensor = self._sensors.get(key)
        if sensor is None:
            sensor = self._sensors[key] = self._recalled(health)
        # A boot may be a part of one run of the agent, whose counters go on, or a new run.
        if health.counters.get(LOST, 0) + health.counters.get(DROPPED, 0) < sensor.told_lost:
            sensor.told_lost = 0
        if health.counters.get(RESTARTS, 0) < sensor.told_restarts:
            sensor.told_restarts = 0
        sensor.boot, sensor.counters = health.boot, health.counters
        was_silent, before_s = sensor.is_silent, sensor.silent_s
        sensor.silent_s = health.counters[SILENT]
        sensor.is_silent = bool(sensor.silent_s)
        if sensor.is_silent and not was_silent:
            yield SensorNotice(
                *key,
                "sensor_silent",
                "alarm",
                f"The sensor has sent nothing for {sensor.silent_s} s. Check its power "
                "supply, cable and network; the edge agent keeps listening.",
                {"silent_s": sensor.silent_s},
            )
        elif was_silent and not sensor.is_silent:
            long = f", after about {before_s} s of silence" if before_s else ""
            yield SensorNotice(
                *key,
                "sensor_back",
                "info",
                f"The sensor sends again{long}.",
                {"silent_s": before_s},
            )
        yield from self._losses(key, sensor, now_s)
        yield from self._restarts(key, sensor)

    def _recalled(self, health: Health) -> _Sensor:
        """Restore the state of a sensor from its events, of earlier server processes too."""
        sensor = _Sensor(health.boot, health.counters)
        found: set[str] = set()
        for event in self._told(health.site, health.asset):
            kind, details = event["kind"], event["details"]
            about = "silence" if kind in ("sensor_silent", "sensor_back") else kind
            if about in found:
                continue
            found.add(about)
            if kind == "sensor_silent":
                sensor.is_silent = True
            elif kind == "samples_lost":
                sensor.told_lost = int(details["lost"]) + int(details["dropped"])
            elif kind == "source_restarted":
                sensor.told_restarts = int(details["restarts"])
        return sensor

    def _restarts(self, key: tuple[str, str], sensor: _Sensor) -> Iterable[SensorNotice]:
        """Make a notice of each restart of a plug-in source."""
        restarts = sensor.counters.get(RESTARTS, 0)
        more, sensor.told_restarts = restarts - sensor.told_restarts, restarts
        if more > 0:
            times = "" if more == 1 else f" {more} times"
            yield SensorNotice(
                *key,
                "source_restarted",
                "warning",
                f"The sensor's source plug-in ended or hung, and was restarted{times}, "
                f"{restarts:,} times in all. The log of the edge agent gives the reason.",
                {"more": more, "restarts": restarts},
            )

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
