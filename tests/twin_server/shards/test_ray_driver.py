"""How the driver of Ray is watched, before drivers that only pretend."""

import multiprocessing
import threading

import pytest

from twin_server.settings import TwinSettings
from twin_server.shards import ray_driver
from twin_server.shards.ray_actors import EngineError
from twin_server.shards.ray_driver import News, RayFleet
from twin_server.shards.shard_actor import FleetSettings, ShardAddress


class Driver:
    """A process that tells what the test lets it tell."""

    def __init__(self, pipe):
        self.pipe, self.pid, self.exitcode = pipe, 4242, None
        self.killed = False

    def start(self):
        pass

    def is_alive(self):
        return self.exitcode is None

    def join(self, _limit_s=None):
        try:
            while True:
                self.pipe.recv()  # until the front has closed its end
        except (EOFError, OSError):
            self.exitcode = 0

    def kill(self):
        self.killed = True

    def tell(self, *places, restarts=0):
        self.pipe.send(News(places, restarts))

    def end(self, code, reason=None):
        if reason is not None:
            self.pipe.send(reason)
        self.exitcode = code


class Context:
    """Makes such drivers."""

    def __init__(self):
        self.drivers = []

    @staticmethod
    def Pipe():
        ours, theirs = multiprocessing.Pipe()

        class Theirs:
            """The end that a real process would have a copy of."""

            send, recv = theirs.send, theirs.recv

            def close(self):
                pass

        return ours, Theirs()

    def Process(self, target, args, name):
        assert target is ray_driver.drive
        self.drivers.append(Driver(args[2]))
        return self.drivers[-1]


@pytest.fixture
def context(monkeypatch):
    made = Context()
    monkeypatch.setattr("multiprocessing.get_context", lambda _: made)
    return made


@pytest.fixture
def stop():
    return threading.Event()


@pytest.fixture
def fleet(context, stop, eventually):
    """Two shards of a cluster that was joined."""
    settings = TwinSettings(shards={"count": 2, "engine": "ray:auto", "backoff_s": 0.01})
    made = RayFleet(settings, stop)
    starting = threading.Thread(target=made.start)
    starting.start()
    assert eventually(lambda: context.drivers)
    context.drivers[0].tell(None, None)
    starting.join()
    yield made
    made.stop()


FIRST = (
    ShardAddress("http://first/0", 10, "node-1"),
    ShardAddress("http://first/1", 11, "node-1"),
)
SECOND = (
    ShardAddress("http://second/0", 20, "node-2"),
    ShardAddress("http://second/1", 21, "node-2"),
)


def test_shards_are_where_the_driver_tells(context, fleet, eventually):
    assert (fleet.count, fleet.url(0), fleet.driver) == (2, None, 4242)
    context.drivers[0].tell(*FIRST)
    assert eventually(lambda: fleet.url(1) == "http://first/1")
    context.drivers[0].tell(None, FIRST[1], restarts=1)
    assert eventually(lambda: fleet.url(0) is None)
    assert (fleet.place(1), fleet.restarts) == (FIRST[1], 1)


def test_a_driver_that_ray_has_ended_is_followed_by_another(context, fleet, eventually, caplog):
    context.drivers[0].tell(*FIRST, restarts=3)
    assert eventually(lambda: fleet.url(1) is not None)
    context.drivers[0].end(-6)
    assert eventually(lambda: len(context.drivers) == 2)
    assert "cluster of --engine ray:auto is lost: its driver ended with code -6" in caplog.text
    assert eventually(lambda: fleet.rejoined == 1)
    # Until the new cluster's shards answer, those of the lost one may.
    context.drivers[1].tell(None, None)
    context.drivers[1].tell(None, SECOND[1])
    assert eventually(lambda: fleet.place(1) == SECOND[1])
    assert fleet.place(0) == FIRST[0]
    context.drivers[1].tell(*SECOND, restarts=1)
    assert eventually(lambda: fleet.place(0) == SECOND[0])
    assert fleet.restarts == 4
    # From then on a shard that is lost has no address.
    context.drivers[1].tell(None, SECOND[1], restarts=2)
    assert eventually(lambda: fleet.url(0) is None)


def test_a_cluster_that_is_not_there_yet_is_tried_again(context, fleet, eventually, caplog):
    context.drivers[0].end(1, "ConnectionError: the head is gone.")
    assert eventually(lambda: len(context.drivers) == 2)
    assert "is lost: ConnectionError: the head is gone. It is joined again" in caplog.text
    context.drivers[1].end(0, "the Ray cluster cannot be joined.")
    assert eventually(lambda: len(context.drivers) == 3)
    context.drivers[2].tell(*FIRST)
    assert eventually(lambda: fleet.url(0) == "http://first/0")


@pytest.mark.parametrize(
    ("reason", "message"),
    [("nobody there", "^nobody there$"), (None, "driver ended with code 1 before")],
)
def test_a_cluster_that_cannot_be_joined_at_first_is_refused(
    context, stop, eventually, reason, message
):
    made = RayFleet(TwinSettings(shards={"count": 2, "engine": "ray:auto"}), stop)

    def end():
        assert eventually(lambda: context.drivers)
        context.drivers[0].end(1, reason)

    threading.Thread(target=end).start()
    with pytest.raises(EngineError, match=message):
        made.start()
    made.stop()


def test_at_the_end_the_driver_is_waited_for_and_no_other_is_started(context, fleet):
    context.drivers[0].tell(*FIRST)
    fleet.stop()
    (driver,) = context.drivers
    assert (driver.exitcode, driver.killed, fleet.url(0)) == (0, False, None)


SETTINGS = FleetSettings.of(TwinSettings())


class Shards:
    """Shards of a driver; they answer at once, and the cluster is lost if it is said so."""

    refuses = loses = ""
    latest: "Shards"

    def __init__(self, engine, count, stop, *, level, form):
        self.count, self.restarts, self.lost, self.ended = 2, 0, "", False
        self.started = None
        self._stop = stop
        Shards.latest = self

    def join(self):
        if self.refuses:
            raise EngineError(self.refuses)

    def start(self, settings):
        self.started = settings
        if self.loses:
            self.lost = self.loses
            threading.Timer(0.2, self._stop.set).start()

    def place(self, index):
        return FIRST[index]

    def stop(self):
        self.ended = True


@pytest.fixture
def pipe(monkeypatch):
    monkeypatch.setattr(ray_driver, "RayShards", Shards)
    monkeypatch.setattr("logging.basicConfig", lambda **_: None)
    ours, theirs = multiprocessing.Pipe()
    yield ours, theirs
    ours.close()


def test_a_driver_starts_its_shards_when_the_front_says_so_and_ends_them_with_it(
    pipe, eventually
):
    ours, theirs = pipe
    driver = threading.Thread(target=ray_driver.drive, args=("ray", 2, theirs, 20, "text"))
    driver.start()
    assert ours.recv() == News(FIRST, 0)
    assert not Shards.latest.started
    ours.send(SETTINGS)
    assert eventually(lambda: Shards.latest.started == SETTINGS)
    assert not Shards.latest.ended
    ours.close()
    driver.join(30)
    assert Shards.latest.ended


def test_a_driver_tells_why_the_cluster_cannot_be_joined(pipe, monkeypatch):
    ours, theirs = pipe
    monkeypatch.setattr(Shards, "refuses", "nobody there")
    ray_driver.drive("ray", 2, theirs, 20, "text")
    assert ours.recv() == "nobody there"


def test_a_driver_tells_that_the_cluster_is_lost_and_ends_at_once(pipe, monkeypatch):
    ours, theirs = pipe
    codes = []

    def leave(code):
        codes.append(code)
        raise SystemExit

    monkeypatch.setattr("os._exit", leave)
    monkeypatch.setattr("logging.shutdown", lambda: None)
    monkeypatch.setattr(Shards, "loses", "the head is gone")
    ours.send(SETTINGS)
    with pytest.raises(SystemExit):
        ray_driver.drive("ray", 2, theirs, 20, "text")
    assert ours.recv() == News(FIRST, 0)
    assert ours.recv() == "the head is gone"
    assert codes == [1]
    assert not Shards.latest.ended
