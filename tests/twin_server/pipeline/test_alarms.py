"""Alarms leave the house: only live ones, each until it is delivered, seen or given up."""

import contextlib
import threading
import time

import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import FEATURES, HEALTH
from slowtime_services.bus import MemoryBus
from slowtime_services.clock import SystemClock
from tests.twin_server.notify.conftest import Hook
from twin_server.events.receivers import AlarmSettings
from twin_server.history.rendering import event_object
from twin_server.notify import Notifier, notifier, senders_of
from twin_server.persist import WriteBatch, open_store
from twin_server.pipeline import Alarms, NotifierTrigger, Pipeline
from twin_server.pipeline.ingestion.estimation import new_twin
from twin_server.pipeline.ingestion.rows import twin_row
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError

HOUR_S = 3_600.0


class Telling:
    """A server without its door, with receivers, and a beam that softens and recovers."""

    def __init__(self, features, eventually, settings, secret):
        self.features, self.eventually = features, eventually
        self.settings, self.secret = settings, secret
        self.hooks = {name: Hook() for name in ("ops", "boss")}
        self.sequence = 0
        self._stack = contextlib.ExitStack()

    def open(self, database, *, routes=({"receiver": "ops"},), hooks=None, **alarms):
        self.hooks |= hooks or {}
        receivers = {
            name: {
                "kind": "webhook", "url": hook.url, "secret_file": self.secret,
                "timeout_s": 60.0,
            }
            for name, hook in self.hooks.items()
        }  # fmt: skip
        quick = {"backoff_s": 0.02, "max_backoff_s": 0.1}
        told = AlarmSettings(receivers=receivers, **(quick | alarms))
        settings = self.settings.model_copy(update={"alarms": told})
        self.bus, self.store = MemoryBus(), open_store(database)
        self.pipeline = Pipeline(settings, self.store, bus=self.bus)
        self.alarms = Alarms(self.pipeline, self.store)
        self.notifier = Notifier(told, self.alarms, senders_of(told), SystemClock())
        self.pipeline.listen(NotifierTrigger(self.notifier.wake))
        for hook in self.hooks.values():
            self._stack.callback(hook.close)
        self._stack.callback(self.bus.close)
        self._stack.callback(self.store.close)
        self.pipeline.start()
        self._stack.callback(self.pipeline.stop)
        self.notifier.start()
        self._stack.callback(self.notifier.stop)
        self.register(routes)
        return self

    def register(self, routes, damping_ratio=0.02):
        body = {
            "nominal": {"frequency_hz": 3.0, "damping_ratio": damping_ratio},
            "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
            "alarm_routes": list(routes), "confirm_readings": 1,
        }  # fmt: skip
        self.pipeline.register("lab.beam", Registration.model_validate(body))

    def hear(self, *lost, age_s=0.0, replayed=False, **more):
        """Let readings come in which so much stiffness is lost."""
        now_ns = time.time_ns()
        for loss in lost:
            self.sequence += 1
            t_ns = now_ns - round(age_s * 1e9) + self.sequence * 1_000
            message = self.features(
                self.sequence - 1, frequency_hz=3.0 * (1.0 - loss) ** 0.5, t_ns=t_ns,
                **({"time_base": "live"} | more),
            )  # fmt: skip
            self.bus.publish(
                FEATURES.key("lab", "beam"), encode(message), encoding=FEATURES.encoding,
                replayed=replayed,
            )  # fmt: skip
        assert self.eventually(lambda: self.store.count("lab.beam") == self.sequence)

    def hear_of_sensor(self, silent_s):
        """Let the edge tell for how long its sensor has been silent."""
        self.beats = getattr(self, "beats", 0) + 1
        message = Health(
            site="lab", asset="beam", boot="b1", sequence=self.beats, t_ns=time.time_ns(),
            last_sequence=self.sequence - 1, first_held=-1, uptime_s=float(self.beats),
            counters={"sensor_silent_s": silent_s},
        )  # fmt: skip
        self.bus.publish(HEALTH.key("lab", "beam"), encode(message), encoding=HEALTH.encoding)
        self.until(
            lambda: (self.pipeline.sensor("lab.beam") or {}).get("sensor_silent_s") == silent_s
        )

    def told(self, name="ops"):
        return [(told["kind"], told["sequence"]) for told in self.hooks[name].told]

    def until(self, holds):
        assert self.eventually(holds), self.deliveries()

    def deliveries(self):
        return self.alarms.deliveries("lab.beam", 1_000)

    def route(self, name="ops"):
        return next(r for r in self.deliveries()["routes"] if r["receiver"] == name)

    def listed(self):
        return self.alarms.alarms("lab.beam", 100)

    def acknowledge(self, event_id, by, note=""):
        return self.alarms.acknowledge("lab.beam", event_id, by, "token of " + by, note)

    def events(self, kind=None):
        found = [event_object(r.number, r.body) for r in self.store.events("lab.beam")]
        return [event for event in found if kind in (None, event["kind"])]

    def close(self):
        self._stack.close()


@pytest.fixture
def telling(features, eventually, settings, tmp_path, monkeypatch):
    """Open houses with receivers, and close them."""
    secret, made = tmp_path / "secret", []
    secret.write_text("a secret that is long enough")
    monkeypatch.setattr(notifier, "MIND_S", 0.05)
    monkeypatch.setattr(notifier, "LOOK_S", 0.05)

    def start(database=None, **more):
        made.append(Telling(features, eventually, settings, secret))
        return made[-1].open(database or tmp_path / "twin.sqlite", **more)

    yield start
    for one in made:
        one.close()


def test_an_alarm_reaches_its_receiver_once_and_is_acknowledged_by_somebody(telling, database):
    route = {"receiver": "ops", "acknowledgements": True}
    house = telling(routes=[route], database=database())
    house.hear(0.0, 0.2, 0.3, 0.3, slow_time_unit="d")
    house.until(lambda: house.told() == [("alarm", 1)])
    (alarm,) = house.listed()
    assert (alarm["raised"], alarm["acknowledged"]) == (True, None)
    (sent,) = house.hooks["ops"].told
    assert sent["event_id"] == alarm["event_id"] == sent["id"]
    assert (sent["slow_time"], sent["slow_time_unit"]) == (1.0, "d")
    (event,) = house.events("alarm")
    assert event["event_id"] == alarm["event_id"]

    house.acknowledge(alarm["event_id"], "Ann", "On my way.")
    house.until(lambda: len(house.told()) == 2)
    assert house.hooks["ops"].told[1]["details"]["by"] == "Ann"
    (seen,) = house.listed()
    assert (seen["acknowledged"]["by"], seen["acknowledged"]["note"]) == ("Ann", "On my way.")
    (noted,) = house.events("alarm_acknowledged")
    assert noted["message"].startswith("Acknowledged by Ann: On my way. The alarm: Stiffness")
    with pytest.raises(ProblemError, match="already acknowledged by Ann") as refused:
        house.acknowledge(alarm["event_id"], "Bob")
    assert refused.value.status == 409
    with pytest.raises(ProblemError, match="is none of the alarms"):
        house.acknowledge("0" * 32, "Ann")

    house.until(lambda: house.route()["waiting"] == 0)
    told = house.route()
    assert (told["waiting"], told["delivered"], told["last_error"]) == (0, 2, None)


@pytest.mark.parametrize(
    "kind",
    [
        {"replayed": True},
        {"time_base": "recorded"},
        {"time_base": "simulated"},
        {"time_base": "live", "age_s": 2 * HOUR_S, "replayed": True},
    ],
)
def test_nothing_is_sent_of_what_is_not_live(telling, kind):
    house = telling(routes=[{"receiver": "ops", "severities": ["alarm", "info", "warning"]}])
    house.hear(0.0, 0.2, 0.0, **kind)
    assert {"alarm", "alarm_cleared"} <= {event["kind"] for event in house.events()}
    house.alarms.test("lab.beam", None, "Ann")
    house.until(lambda: house.told() == [("alarm_test", 0)])
    assert [row["kind"] for row in house.deliveries()["deliveries"]] == ["alarm_test"]


def test_simulated_structures_are_told_of_where_the_settings_say_so(telling):
    house = telling(simulated=True)
    house.hear(0.0, 0.2, time_base="simulated", age_s=1e6)
    house.until(lambda: house.told() == [("alarm", 1)])


def test_an_old_alarm_is_sent_once_if_it_holds_when_newer_readings_come(telling):
    house = telling(routes=[{"receiver": "ops", "severities": ["alarm", "info"]}])
    house.hear(0.0, 0.2, 0.0, 0.2, age_s=2 * HOUR_S)
    assert {row["state"] for row in house.deliveries()["deliveries"]} <= {"late", "dropped"}
    assert house.told() == []
    house.hear(0.2)
    house.until(lambda: house.told() == [("alarm", 3)])
    states = {row["event_id"]: row["state"] for row in house.deliveries()["deliveries"]}
    house.until(lambda: house.route()["waiting"] == 0)
    assert len(states) == 2


def test_an_old_alarm_that_has_ended_by_then_is_not_sent(telling):
    house = telling()
    house.hear(0.0, 0.2, 0.0, age_s=2 * HOUR_S)
    house.hear(0.0)
    house.until(lambda: house.deliveries()["deliveries"][0]["state"] == "dropped")
    house.hear(0.2)
    house.until(lambda: house.told() == [("alarm", 4)])


def test_a_dead_receiver_delays_neither_the_others_nor_the_server(telling):
    over = threading.Event()
    dead = Hook(before=lambda: over.wait(60))
    house = telling(routes=[{"receiver": "ops"}, {"receiver": "dead"}], hooks={"dead": dead})
    try:
        for _ in range(20):
            house.hear(0.0, 0.2)
        house.until(lambda: len(house.told()) == 20)
        assert house.route("dead")["waiting"] == 20
    finally:
        over.set()
    house.until(lambda: len(dead.accepted) == 20)


def test_what_cannot_be_delivered_is_given_up_with_an_event_that_others_are_told(telling):
    broken = Hook(lambda n: 500)
    routes = [
        {"receiver": "broken", "severities": ["alarm", "warning"]},
        {"receiver": "ops", "severities": ["warning"], "kinds": ["alarm_not_delivered"]},
    ]
    house = telling(routes=routes, hooks={"broken": broken}, max_age_s=0.5)
    house.hear(0.0, 0.2)
    house.until(lambda: house.told() == [("alarm_not_delivered", 0)])
    (told,) = house.hooks["ops"].told
    assert told["details"]["receiver"] == "broken"
    assert "The last attempt: The receiver answered 500" in told["message"]
    rows = {r["receiver"]: r for r in house.deliveries()["routes"]}
    assert (rows["broken"]["failed"], rows["broken"]["waiting"]) == (1, 0)
    assert "answered 500" in rows["broken"]["last_error"]
    assert len(broken.requests) >= 3
    assert {told["kind"] for told in broken.told} == {"alarm"}


class OffClock(SystemClock):
    """The machine's clock, so many seconds off."""

    off_s = 0.0

    def now_ns(self):
        return super().now_ns() + round(self.off_s * 1e9)


def test_an_alarm_that_waits_is_sent_soon_although_the_clock_is_set_back(telling):
    clock = OffClock()
    clock.off_s = 2.0 * HOUR_S
    flaky = Hook(lambda n: 500 if clock.off_s else 204)
    house = telling(routes=[{"receiver": "flaky"}], hooks={"flaky": flaky})
    house.notifier._clock = clock
    house.hear(0.0, 0.2)
    house.until(lambda: len(flaky.requests) >= 2)  # the next attempt is due in two hours
    clock.off_s = 0.0
    house.until(lambda: len(flaky.accepted) == 1)


@pytest.mark.long
def test_of_an_alarm_that_stays_is_reminded_until_somebody_has_seen_it(telling):
    house = telling(routes=[{"receiver": "ops", "remind_s": 1.0}])
    house.hear(0.0, 0.2, 0.2, 0.2)
    house.until(lambda: len(house.told()) >= 3)
    reminders = [told["reminder"] for told in house.hooks["ops"].told]
    assert reminders[:3] == [0, 1, 2]
    (event_id,) = {told["event_id"] for told in house.hooks["ops"].told}
    assert max(house.hooks["ops"].accepted.values()) == 1
    house.acknowledge(event_id, "Ann")
    house.until(lambda: house.route()["waiting"] == 0)
    assert house.deliveries()["deliveries"][0]["error"] == "It has ended, or was acknowledged."


def test_a_history_that_is_estimated_anew_sends_nothing_and_keeps_what_was_acknowledged(
    telling,
):
    house = telling()
    house.hear(0.0, 0.2, 0.2)
    house.until(lambda: house.told() == [("alarm", 1)])
    (alarm,) = house.listed()
    house.acknowledge(alarm["event_id"], "Ann")
    # Routes alone would leave the history as it is.
    house.register([{"receiver": "ops"}, {"receiver": "boss"}], damping_ratio=0.0201)
    (again,) = house.listed()
    assert again["event_id"] == alarm["event_id"]
    assert again["acknowledged"]["by"] == "Ann"
    assert again["number"] != alarm["number"]
    house.hear(0.2)
    house.alarms.test("lab.beam", "boss", "Ann")
    house.until(lambda: house.told("boss") == [("alarm_test", 0)])
    assert house.told() == [("alarm", 1)]


def test_a_test_alarm_goes_where_it_is_asked_to(telling):
    house = telling(routes=[{"receiver": "ops"}, {"receiver": "boss"}])
    assert house.alarms.test("lab.beam", None, "Ann")["receivers"] == ["ops", "boss"]
    house.until(lambda: len(house.told()) == len(house.told("boss")) == 1)
    assert house.hooks["ops"].told[0]["test"] is True
    with pytest.raises(ProblemError, match=r"lab\.beam is routed to: ops, boss"):
        house.alarms.test("lab.beam", "nobody", "Ann")


def test_a_receiver_that_is_declared_no_more_is_said_to_be_missing(telling, database):
    path = database()
    store = open_store(path)
    body = {"alarm_routes": [{"receiver": "gone"}]}
    twin = new_twin(Registration.model_validate(body))
    store.write(WriteBatch(twins=[twin_row(("lab", "rig"), twin)]))
    store.close()
    house = telling(database=path)
    (route,) = house.alarms.deliveries("lab.rig", 10)["routes"]
    assert route["last_error"].startswith("No receiver is called gone.")


def test_who_forgets_a_twin_forgets_its_deliveries(telling, database):
    broken = Hook(lambda n: 500)
    path = database()
    house = telling(routes=[{"receiver": "broken"}], hooks={"broken": broken}, database=path)
    house.hear(0.0, 0.2)
    house.until(lambda: len(broken.requests) > 1)
    house.pipeline.delete("lab.beam")
    assert house.store.deliveries() == []
    house.notifier.stop()
    assert house.store.deliveries() == []


def test_a_silent_sensor_is_told_once_over_restarts_of_the_server(telling, tmp_path):
    route = {"receiver": "ops", "severities": ["alarm", "info"]}
    kinds = ["sensor_silent", "sensor_back"]

    def told():
        return [kind for one in made for kind, _ in one.told() if kind in kinds]

    made = [telling(routes=[route])]
    made[-1].hear(0.0)
    made[-1].hear_of_sensor(0)
    made[-1].hear_of_sensor(11)
    made[-1].until(lambda: told() == ["sensor_silent"])
    for silent_s, expected in (
        (15, kinds[:1]),
        (0, kinds),
        (0, kinds),
        (12, [*kinds, kinds[0]]),
    ):
        made[-1].close()
        made.append(telling(routes=[route]))
        # No reading has come: a sensor that is silent gives none.
        made[-1].hear_of_sensor(silent_s)
        made[-1].until(lambda wanted=expected: told() == wanted)
        events = [event["kind"] for event in made[-1].events() if event["kind"] in kinds]
        assert events == expected
