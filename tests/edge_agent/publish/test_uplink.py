"""What an agent sends over a link that costs: when, how much, and never late with news."""

import datetime
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_agent.publish import Publisher, Spool
from edge_agent.publish.health_changes import HealthCondition
from edge_agent.publish.link_budget import LinkBudget, Month
from edge_agent.publish.surprise import FEWEST, SurpriseCheck
from edge_agent.publish.uplink import in_batches
from edge_agent.settings import EdgeSettings, Origin, PublishSettings
from slowtime_schemas.batches import unpack
from slowtime_schemas.codec import decode
from slowtime_schemas.messages import Features, Health, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import ABOUT, FEATURES, HEALTH, request_key
from slowtime_services.bus import MemoryBus, Sample
from slowtime_services.clock import HandClock
from slowtime_services.link_profiles import CONNECTION_BYTES, KEEP_ALIVE_BYTES, MESSAGE_BYTES

ORIGIN = Origin(site="lab", asset="beam", boot="b1", time_base="simulated")
NOON_NS = int(datetime.datetime(2026, 3, 10, 12, tzinfo=datetime.UTC).timestamp()) * 10**9
S = 10**9


def reading(sequence, frequency_hz=3.0, *, flags=(), identified=True):
    mode = Mode(
        frequency_hz=Quantity(value=frequency_hz, sd=0.01),
        damping_ratio=Quantity(value=0.01, sd=0.001),
    )
    return Features(
        **ORIGIN.model_dump(),
        sequence=sequence,
        t_ns=NOON_NS + 60 * S * sequence,
        start_ns=NOON_NS,
        slow_time=float(sequence),
        method="ambient",
        modes=(mode,) if identified else (),
        quality=Quality(samples=1, flags=flags),
    )


class Agent:
    """A publisher on a bus within the process, and all that was heard of it."""

    def __init__(self, folder, *, boot="b1", counts=None, **chosen):
        self.folder, self.bus, self.clock = folder, MemoryBus(), HandClock(NOON_NS)
        self.features: list[list[bytes]] = []
        self.health: list[Any] = []
        self.about: list[Sample] = []
        hear = self.bus.subscribe
        hear(FEATURES.everywhere, lambda sample: self.features.append(unpack(sample.payload)))
        hear(HEALTH.everywhere, lambda s: self.health.append(decode(HEALTH, s.payload)))
        hear(ABOUT.everywhere, lambda sample: self.about.append(sample))
        self.publisher = Publisher(
            ORIGIN.model_copy(update={"boot": boot}),
            Spool(folder, boot),
            self.bus,
            self.clock,
            PublishSettings(**chosen).of_profile("metered"),
            software="slowtime 0",
            about={"processing": {}},
            link="metered",
            counts=counts,
        )
        self.publisher.open()
        self.made = 0

    def read(self, frequency_hz=3.0, **more):
        self.publisher.features(reading(self.made, frequency_hz, **more))
        self.made += 1

    def pass_time(self, seconds):
        """Let time pass, with a reading a minute, and a look each tick."""
        for second in range(round(seconds)):
            self.clock.sleep(1.0)
            if second % 60 == 59:
                self.read(3.0 + 0.01 * (self.made % 3))
            if second % 5 == 0:
                self.publisher.tick(5.0)

    def ask(self, what):
        return [a.payload for a in self.bus.ask(request_key("lab", "beam", what))]


@pytest.fixture
def agent(tmp_path):
    """Make agents on a metered link, and end them."""
    made = []

    def make(**chosen):
        made.append(Agent(tmp_path, **chosen))
        return made[-1]

    yield make
    for one in made:
        one.publisher.close()
        one.bus.close()


def test_an_hour_on_a_metered_link_is_a_few_health_messages_and_batches(agent):
    beam = agent()
    beam.pass_time(3600)
    assert len(beam.health) in (4, 5)
    assert [len(batch) for batch in beam.features] == [16, 16, 16]
    assert len(beam.about) == 1
    assert [h.last_sequence for h in beam.health] == sorted(
        h.last_sequence for h in beam.health
    )


def test_a_reading_that_was_not_predicted_is_sent_at_once_with_all_that_waits(agent):
    beam = agent()
    for _ in range(FEWEST + 1):
        beam.read()
    assert beam.features == []
    beam.read(2.9)
    assert [len(batch) for batch in beam.features] == [FEWEST + 2]


@pytest.mark.parametrize("news", [{"flags": ("clipped",)}, {"identified": False}])
def test_new_flags_and_readings_without_modes_are_sent_at_once(agent, news):
    beam = agent()
    for _ in range(FEWEST):
        beam.read()
    beam.read(**news)
    assert len(beam.features) == 1
    beam.read(**news)
    assert len(beam.features) == 1  # it is no news any more


def test_scatter_is_no_surprise_and_a_step_is():
    check = SurpriseCheck(5.0)
    scatter = [0.02, -0.03, 0.01, -0.01, 0.03, 0.0, -0.02] * 6
    assert not any(check.check(reading(n, 3.0 + off)) for n, off in enumerate(scatter))
    assert check.check(reading(99, 3.2))
    assert not check.check(reading(100, 3.0))


def test_health_is_sent_within_a_tick_of_a_change_and_not_for_progress(agent):
    counts = {"samples_received": 0, "sensor_silent_s": 0, "samples_lost": 0}
    beam = agent(counts=lambda: counts)
    before = len(beam.health)
    for _ in range(60):
        counts["samples_received"] += 125
        beam.clock.sleep(1.0)
        beam.publisher.tick()
    assert len(beam.health) == before
    for name, value in [("sensor_silent_s", 3), ("sensor_silent_s", 0), ("samples_lost", 5)]:
        counts[name] = value
        beam.publisher.tick()
        before += 1
        assert len(beam.health) == before
        assert beam.health[-1].counters[name] == value
    beam.clock.set_ns(beam.clock.now_ns() + 5 * S)
    beam.publisher.tick()
    assert len(beam.health) == before + 1


def test_a_flood_of_faults_is_told_with_each_doubling():
    def told(counts):
        found = {HealthCondition.of({"samples_lost": n}, 0, 0, connected=True) for n in counts}
        return len(found)

    assert told(range(1, 1000)) == 10
    assert HealthCondition.of({}, 2**20, 0, connected=True) != HealthCondition.of(
        {}, 0, 0, connected=True
    )


def test_the_account_lists_nothing_that_waits_and_a_request_sends_it(agent):
    beam = agent()
    for _ in range(5):
        beam.read()
    assert beam.ask("account") == []
    assert beam.health[-1].last_sequence == -1
    assert beam.ask("flush") == [b'{"sent": 5}']
    assert [len(batch) for batch in beam.features] == [5]
    beam.read()
    (listed,) = map(json.loads, beam.ask("account"))
    assert (listed["first"], listed["last"]) == (0, 4)
    assert beam.ask("flush") == [b'{"sent": 1}']
    assert beam.ask("flush") == [b'{"sent": 0}']


def test_batches_wait_for_the_send_hours_and_a_surprise_does_not(agent):
    beam = agent(send_hours=(22, 4))
    beam.pass_time(3600)
    assert beam.features == []
    link = beam.health[-1].link
    assert link.held_until_ns == NOON_NS + 10 * 3600 * S
    assert link.features_within_s == pytest.approx(18 * 3600 + 900)
    beam.clock.sleep(9 * 3600 + 60)
    beam.publisher.tick()
    assert [len(batch) for batch in beam.features] == [60]
    beam.clock.sleep(12 * 3600)
    beam.read(2.5)
    assert len(beam.features) == 2


def test_an_agent_that_ends_sends_what_waits_unless_it_is_held(tmp_path):
    for boot, hours, batches in (("b1", None, 1), ("b2", (22, 4), 0)):
        beam = Agent(tmp_path, boot=boot, send_hours=hours)
        beam.read()
        beam.publisher.close()
        assert len(beam.features) == batches
        beam.bus.close()


def test_a_budget_is_kept_by_longer_batches_and_then_by_waiting(agent):
    beam = agent(budget_mb=41.0, features_every_s=60.0)
    beam.clock.set_ns(int(datetime.datetime(2026, 3, 31, tzinfo=datetime.UTC).timestamp()) * S)
    beam.publisher._uplink._budget._spent = 37.7e6
    beam.publisher._uplink._budget._month = "2026-03"
    beam.pass_time(2 * 3600)
    sizes = [len(batch) for batch in beam.features]
    beam.publisher.health()
    link = beam.health[-1].link
    assert link.budget_bytes == 41_000_000
    assert link.month_bytes <= link.budget_bytes
    assert max(sizes, default=0) > 1 or link.waiting > 60
    beam.clock.sleep(86_400)
    beam.publisher.tick()
    assert beam.publisher.waiting == 0
    beam.publisher.health()
    assert beam.health[-1].link.month_bytes < 100_000


@settings(max_examples=25, deadline=None)
@given(
    budget_mb=st.floats(41.0, 200.0),
    payload=st.integers(100, 3_000),
    every_s=st.integers(60, 3_600),
    urgent=st.integers(2, 50),
)
def test_no_month_takes_more_than_its_budget(
    tmp_path_factory, budget_mb, payload, every_s, urgent
):
    path = tmp_path_factory.mktemp("budget") / "link.json"
    budget = LinkBudget(path, round(1e6 * budget_mb), keep_alive_s=40.0)
    month = Month.of(NOON_NS)
    now_ns, sent, waiting = month.start_ns, 0, 0
    while now_ns < month.end_ns:
        waiting += 1
        if budget.ready_ns(payload, now_ns, urgent=waiting % urgent == 0) <= now_ns:
            budget.spend(payload)
            sent, waiting = sent + 1, 0
        now_ns += 20 * every_s * S
        budget.pass_time(20.0 * every_s)
    total = budget.spent(month.end_ns - 1)
    assert total <= 1e6 * budget_mb + 1
    assert sent > 0
    budget.keep(month.end_ns - 1)
    again = LinkBudget(path, round(1e6 * budget_mb), keep_alive_s=40.0)
    assert again.spent(month.end_ns - 1) == total
    assert budget.spent(month.end_ns) == 0


def test_a_budget_is_spread_over_the_month(tmp_path):
    budget = LinkBudget(tmp_path / "link.json", 30_000_000, keep_alive_s=40.0)
    month = Month.of(NOON_NS)
    sent_days = []
    for step in range(31 * 144):  # a batch each ten minutes would need 35 MB
        now_ns = month.start_ns + 600 * step * S
        budget.pass_time(600.0)
        if budget.ready_ns(3_000, now_ns) <= now_ns:
            budget.spend(3_000)
            sent_days.append(step / 144)
    assert sent_days[0] < 1.0
    assert sent_days[-1] > 30.5
    assert 0.4 < sum(day < 15.5 for day in sent_days) / len(sent_days) < 0.6


def test_connections_messages_and_keep_alives_are_counted(agent):
    beam = agent()
    opened = beam.health[-1].link.month_bytes
    beam.clock.sleep(400.0)
    beam.publisher.health()
    later = beam.health[-1].link.month_bytes
    assert opened >= CONNECTION_BYTES
    assert later - opened >= 10 * KEEP_ALIVE_BYTES + MESSAGE_BYTES
    kept = json.loads((beam.folder / "link.json").read_text())
    assert kept["month"] == "2026-03"
    beam.publisher.close()
    again = Agent(beam.folder, boot="b2")
    again.clock.set_ns(NOON_NS + 31 * 86_400 * S)
    again.publisher.health()
    assert again.health[-1].link.month_bytes < opened
    assert opened <= kept["bytes"] <= later


def test_a_damaged_file_of_the_budget_is_started_again(tmp_path):
    (tmp_path / "link.json").write_text("{")
    assert LinkBudget(tmp_path / "link.json", None, 40.0).spent(NOON_NS) == 0


def test_batches_are_bounded_in_bytes_and_messages():
    assert [len(b) for b in in_batches([b"x"] * 4_500)] == [2_000, 2_000, 500]
    assert [len(b) for b in in_batches([b"x" * 700_000] * 3)] == [1, 1, 1]
    assert list(in_batches([])) == []


def test_single_settings_overrule_the_profile_and_lab_is_as_it_was():
    lab = EdgeSettings().publishing
    assert (lab.health_every_s, lab.features_every_s, lab.lease_s) == (1.0, 0.0, 5.0)
    metered = EdgeSettings(link="metered", publish={"lease_s": 60.0}).publishing
    assert (metered.lease_s, metered.keep_alives, metered.health_every_s) == (60.0, 3, 900.0)


@pytest.mark.parametrize(
    ("publish", "told"),
    [({"send_hours": (4, 4)}, "same hour"), ({"budget_mb": 3}, "keep-alives every")],
)
def test_hours_and_budgets_that_cannot_be_kept_are_refused(publish, told):
    with pytest.raises(ValueError, match=told):
        EdgeSettings(link="metered", publish=publish)


def test_health_of_a_lab_has_no_link(tmp_path):
    with MemoryBus() as bus:
        told: list[bytes] = []
        bus.subscribe(HEALTH.everywhere, lambda sample: told.append(sample.payload))
        about: dict[str, Any] = {"processing": {}}
        publisher = Publisher(
            ORIGIN, Spool(tmp_path, "b1"), bus, HandClock(NOON_NS), PublishSettings(),
            software="slowtime 0", about=about,
        )  # fmt: skip
        publisher.open()
        publisher.close()
    assert Health.model_validate_json(told[0], strict=True).link is None
