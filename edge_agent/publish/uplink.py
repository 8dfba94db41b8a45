"""Decides when an agent sends features and health over its link, within hours and a budget."""

import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

from edge_agent.settings import PublishSettings
from slowtime_schemas.batches import MOST_MESSAGES
from slowtime_schemas.messages import Features, Link, LinkProfile
from slowtime_services.clock import Clock

from .health_changes import CLOCK_STEP_S, HealthCondition
from .link_budget import LinkBudget
from .surprise import SurpriseCheck

TICK_S = 1.0
"""Interval at which it is checked what is due, at most [s]."""

BUDGET_FILE = "link.json"

DAY_S = 86_400.0

BATCH_BYTES = 2**20
"""Bytes of the messages of one batch, from which on another one begins."""

PACKED_BYTES = 350
"""Bytes of features in a batch, by which the next one is judged until one was sent."""


class Uplink:
    """Times of messages on one link.

    Parameters
    ----------
    folder
        Where the bytes of the month are kept.
    """

    def __init__(
        self,
        settings: PublishSettings,
        folder: Path,
        clock: Clock,
        profile: LinkProfile = "lab",
    ) -> None:
        self._settings, self._clock, self._profile = settings, clock, profile
        self._budget = LinkBudget(
            folder / BUDGET_FILE, settings.budget_bytes, settings.keep_alive_s
        )
        self._surprise = SurpriseCheck(settings.surprise_sd)
        self._lock = threading.Lock()
        """Of the budget, which the threads of samples, heartbeats and answers spend from."""
        self._counted_ns = clock.elapsed_ns()
        self._since_ns: int | None = None
        self._packed_bytes = float(PACKED_BYTES)
        self._urgent = False
        self._health: tuple[int, HealthCondition] | None = None
        self._health_age_s = self._about_age_s = 0.0

    @property
    def gathers(self) -> bool:
        """Whether features are gathered before they are sent."""
        held = self._settings.send_hours is not None or self._settings.budget_bytes is not None
        return held or self._settings.features_every_s > 0

    @property
    def told(self) -> bool:
        """Whether health says what to expect: of a link on which all is sent at once, not."""
        return self.gathers or self._profile != "lab"

    def take(self, message: Features) -> bool:
        """Note features that wait to be sent; whether they are to be sent without delay."""
        if self._since_ns is None:
            self._since_ns = self._clock.elapsed_ns()
        self._urgent |= self._surprise.check(message)
        return self._urgent

    def due(self, waiting: int) -> bool:
        """Whether the features that wait are to be sent now."""
        if self._since_ns is None or not waiting:
            return False
        waited_s = (self._clock.elapsed_ns() - self._since_ns) / 1e9
        long = waited_s >= self._settings.features_every_s - TICK_S / 2
        return (self._urgent or long) and self.held_until_ns(waiting) is None

    def held_until_ns(self, waiting: int) -> int | None:
        """Return until when hours or budget hold features back [ns]; None where they do not."""
        now_ns = self._clock.now_ns()
        cost = round(waiting * self._packed_bytes)
        with self._lock:
            self._count_keep_alives()
            ready_ns = self._budget.ready_ns(cost, now_ns, urgent=self._urgent)
        if not self._urgent:
            ready_ns = _next_open_ns(ready_ns, self._settings.send_hours)
        return ready_ns if ready_ns > now_ns else None

    def affords(self, payload_bytes: int) -> bool:
        """Whether the budget of the month allows an answer of so many bytes."""
        now_ns = self._clock.now_ns()
        with self._lock:
            self._count_keep_alives()
            return self._budget.ready_ns(payload_bytes, now_ns, urgent=True) <= now_ns

    def begin(self) -> None:
        """Note that all features that wait are about to be sent."""
        self._since_ns, self._urgent = None, False

    def note_batch(self, messages: int, payload_bytes: int) -> None:
        """Note the size of a batch, by which the next one is judged."""
        self._packed_bytes = payload_bytes / messages

    def spend(self, payload_bytes: int) -> None:
        """Count a message of either direction."""
        with self._lock:
            self._budget.spend(payload_bytes)

    def pass_time(self, seconds: float) -> None:
        """Let the last health and `about` messages grow older [s]."""
        self._health_age_s += seconds
        self._about_age_s += seconds

    def health_due(self, condition: HealthCondition) -> bool:
        """Whether a health message is to be sent: something has changed, or it is time."""
        if self._health is None:
            return True
        offset_ns, told = self._health
        stepped_s = abs(self._clock_offset_ns() - offset_ns) / 1e9
        every_s = self._settings.health_every_s
        return (
            self._health_age_s >= every_s - min(TICK_S, every_s) / 2
            or condition != told
            or stepped_s > CLOCK_STEP_S
        )

    def note_health(self, condition: HealthCondition) -> None:
        """Note a health message that is being sent."""
        was_connected = self._health is not None and self._health[1].connected
        self._health, self._health_age_s = (self._clock_offset_ns(), condition), 0.0
        with self._lock:
            if condition.connected and not was_connected:
                self._budget.connect()
            self._count_keep_alives()
            self._budget.keep(self._clock.now_ns())

    def about_due(self) -> bool:
        """Whether software and settings are to be told; the next time is counted from now."""
        every_s = self._settings.about_every_s
        due = self._about_age_s >= every_s - min(TICK_S, every_s) / 2
        if due:
            self._about_age_s = 0.0
        return due

    def report(self, waiting: int) -> Link:
        """Say what the server may expect of this link."""
        settings, now_ns = self._settings, self._clock.now_ns()
        held_ns = self.held_until_ns(max(waiting, 1))
        within_s = settings.features_every_s + _longest_closed_s(settings.send_hours)
        if held_ns is not None:
            within_s = max(within_s, self._waited_s() + (held_ns - now_ns) / 1e9)
        with self._lock:
            self._count_keep_alives()
            spent = self._budget.spent(now_ns)
        return Link(
            profile=self._profile,
            health_within_s=settings.health_every_s,
            features_within_s=within_s,
            offline_within_s=settings.lease_s,
            waiting=waiting,
            held_until_ns=held_ns if waiting else None,
            month_bytes=spent,
            budget_bytes=settings.budget_bytes,
        )

    def _count_keep_alives(self) -> None:
        now_ns = self._clock.elapsed_ns()
        self._budget.pass_time((now_ns - self._counted_ns) / 1e9)
        self._counted_ns = now_ns

    def _waited_s(self) -> float:
        if self._since_ns is None:
            return 0.0
        return (self._clock.elapsed_ns() - self._since_ns) / 1e9

    def _clock_offset_ns(self) -> int:
        return self._clock.now_ns() - self._clock.elapsed_ns()


def in_batches(payloads: Iterable[bytes]) -> Iterator[list[bytes]]:
    """Divide messages into batches of bounded size."""
    batch: list[bytes] = []
    size = 0
    for payload in payloads:
        if batch and (size + len(payload) > BATCH_BYTES or len(batch) == MOST_MESSAGES):
            yield batch
            batch, size = [], 0
        batch.append(payload)
        size += len(payload)
    if batch:
        yield batch


def _next_open_ns(at_ns: int, hours: tuple[float, float] | None) -> int:
    """Return the first instant from `at_ns` on that lies in the send hours.

    Examples
    --------
    >>> noon_ns = 12 * 3600 * 10**9
    >>> _next_open_ns(noon_ns, (22.0, 4.0)) // (3600 * 10**9)
    22
    >>> _next_open_ns(noon_ns, (8.0, 16.0)) == noon_ns
    True
    """
    if hours is None:
        return at_ns
    begin_s, end_s = (3600.0 * hour for hour in hours)
    second = at_ns / 1e9 % DAY_S
    if (second - begin_s) % DAY_S < (end_s - begin_s) % DAY_S:
        return at_ns
    return at_ns + round(((begin_s - second) % DAY_S) * 1e9)


def _longest_closed_s(hours: tuple[float, float] | None) -> float:
    """Return how long the send hours are over each day [s]."""
    return 0.0 if hours is None else DAY_S - 3600.0 * (hours[1] - hours[0]) % DAY_S
