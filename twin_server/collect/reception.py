"""Decodes and validates messages from the bus; refuses those that cannot be believed."""

import functools
from collections.abc import Iterable
from typing import NamedTuple

from pydantic import ValidationError

from slowtime_schemas.asset_events import AssetEvent
from slowtime_schemas.codec import Refused, decode
from slowtime_schemas.messages import Fatigue, Features, Health, Message, Registered, Virtual
from slowtime_schemas.streams import (
    ASSET_EVENT,
    FATIGUE,
    FEATURES,
    HEALTH,
    REGISTRATION,
    VIRTUAL,
    Stream,
    parse_key,
)
from slowtime_services.bus import Sample
from twin_server.registration.twin import Registration
from twin_server.settings import AdmissionSettings

from .held import Arrival
from .refusals import Refusals


class Received(NamedTuple):
    """The accepted messages of a batch, by kind, in order."""

    arrivals: list[Arrival]
    healths: list[tuple[Health, bool]]
    """With whether they were replayed."""
    registrations: list[tuple[str, Registration]]
    """By twin id; replayed ones only, since those of the moment are our own."""
    disbelieved: list[tuple[Features, str]]
    """Features whose sensor time is not believed, and the reason."""
    asset_events: list[AssetEvent]
    """Replayed ones only, likewise."""
    assessed: list[Fatigue | Virtual]
    """Fatigue and virtual quantities."""
    misdated: int = 0
    """How many were refused because their sender's clock is off: they may be sound later."""


_TAKEN = (FEATURES, HEALTH, REGISTRATION, ASSET_EVENT, FATIGUE, VIRTUAL)


class Reception:
    """Decodes and validates messages and checks their clocks; an invalid one affects no other.

    Parameters
    ----------
    limits
        What is believed.
    refusals
        Where refused messages are counted.
    """

    def __init__(self, limits: AdmissionSettings, refusals: Refusals) -> None:
        self._limits, self._refusals = limits, refusals

    def admits(self, sample: Sample) -> bool:
        """Whether the payload is small enough to be decoded; quick, for bus callbacks."""
        size, most = len(sample.payload), self._limits.max_payload_bytes
        if size > most:
            self._refusals.refuse(
                "too_large",
                f"A message of {size:,} bytes on {sample.key:.200} was given. Allowed: up to "
                f"{most:,}. Send less at once.",
            )
        return size <= most

    def read(self, samples: Iterable[Sample], now_ns: int) -> Received:
        """Return the accepted messages of `samples`, in their order."""
        received = Received([], [], [], [], [], [])
        arrivals, misdated = received.arrivals, 0
        for sample in samples:
            if not self.admits(sample):
                continue
            # Where a server has fallen behind, messages wait; that is no fault of their clocks.
            heard_ns = now_ns if sample.arrived_ns is None else sample.arrived_ns
            try:
                message = self._decode(sample)
                if sample.sent_ns is not None and not sample.replayed:
                    misdated += 1
                    self._check_sender(sample.sent_ns, heard_ns)
                    misdated -= 1
                if type(message) is Features:
                    self._check_sensor(message, heard_ns, received)
                    age_s = 0.0 if sample.replayed else self._age_s(message, heard_ns)
                    arrivals.append(Arrival(message, sample.payload, sample.replayed, age_s))
                elif isinstance(message, Fatigue | Virtual):
                    self._check_sensor_time(message, heard_ns)
                    received.assessed.append(message)
                elif type(message) is Health:
                    received.healths.append((message, sample.replayed))
                elif type(message) is Registered and sample.replayed:
                    received.registrations.append((message.twin_id, _registration(message)))
                elif type(message) is AssetEvent and sample.replayed:
                    received.asset_events.append(message)
            except Refused as refused:
                self._refusals.refuse(refused.reason, f"{sample.key:.200}: {refused}")
        return received._replace(misdated=misdated)

    def _decode(self, sample: Sample) -> Message:
        stream, site, asset = _address(sample.key)
        if stream not in _TAKEN:
            raise Refused(
                "unexpected",
                f"A {stream.name} message was given. Allowed: "
                f"{', '.join(taken.name for taken in _TAKEN)}.",
            )
        message = decode(stream, sample.payload)
        if message.site != site or message.asset != asset:
            raise Refused(
                "foreign_key",
                f"A message of {message.twin_id} was given on the key of {site}.{asset}. "
                "Allowed: each asset on its own key. Correct the sender's settings.",
            )
        return message

    def _check_sender(self, sent_ns: int, now_ns: int) -> None:
        off_s = (sent_ns - now_ns) / 1e9
        if abs(off_s) > self._limits.max_ahead_s:
            raise Refused(
                "future_clock" if off_s > 0 else "stale_clock",
                f"A sender's clock {abs(off_s):.0f} s {_side(off_s)} ours was given. Allowed: "
                f"up to {self._limits.max_ahead_s:.0f} s. Set the clock of the sender's "
                "computer, or of the server.",
            )

    def _age_s(self, features: Features, now_ns: int) -> float:
        """Return the age of a live reading where it exceeds `max_age_s`, else 0 [s]."""
        age_s = (now_ns - features.t_ns) / 1e9
        old = features.time_base == "live" and age_s > self._limits.max_age_s
        return age_s if old else 0.0

    def _check_sensor(self, features: Features, now_ns: int, received: Received) -> None:
        try:
            self._check_sensor_time(features, now_ns)
        except Refused as refused:
            received.disbelieved.append((features, refused.reason))
            raise

    def _check_sensor_time(self, features: Features | Fatigue | Virtual, now_ns: int) -> None:
        limits = self._limits
        if features.t_ns < limits.not_before_ns or features.start_ns < limits.not_before_ns:
            raise Refused(
                "unset_clock",
                f"t_ns={features.t_ns}, start_ns={features.start_ns} was given. Allowed: from "
                f"{limits.not_before_ns} on. Set the sensor's clock.",
            )
        if features.time_base != "live":
            return
        off_s = (features.t_ns - now_ns) / 1e9
        if off_s > limits.max_ahead_s:
            raise Refused(
                "future_clock",
                f"t_ns={features.t_ns}, {off_s:.0f} s ahead of ours, was given. Allowed: up to "
                f"{limits.max_ahead_s:.0f} s. Set the sensor's clock, or ours.",
            )


def _registration(message: Registered) -> Registration:
    try:
        return Registration.model_validate(message.registration)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        raise Refused(
            "invalid",
            f"A registration of {message.twin_id} with {fault['loc']} = {fault['input']!r:.60} "
            f"was given: {fault['msg']}. Allowed: what PUT /api/v1/twins takes.",
        ) from error


def _side(off_s: float) -> str:
    return "ahead of" if off_s > 0 else "behind"


@functools.lru_cache(maxsize=65536)
def _address(key: str) -> tuple[Stream, str, str]:
    try:
        return parse_key(key)
    except ValueError as error:
        raise Refused("unknown_key", str(error)) from error
