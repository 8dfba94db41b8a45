"""How shards are watched that Ray runs, before a Ray that only pretends."""

import os
import pickle
import sys
import threading
import types
from typing import Any

import pytest

from twin_server.settings import TwinSettings
from twin_server.shards import ray_actors, shard_actor
from twin_server.shards.ray_actors import EngineError, RayShards
from twin_server.shards.shard_actor import FleetSettings


class ActorError(Exception):
    pass


class UnavailableError(ActorError):
    pass


class Call:
    """A call of an actor; Ray gives equal calls back, not the same."""

    def __init__(self, told=None):
        self.told = {"answer": None, "done": threading.Event()} if told is None else told

    def __eq__(self, other):
        return isinstance(other, Call) and self.told is other.told

    def __hash__(self):
        return id(self.told)

    @property
    def done(self):
        return self.told["done"]

    @property
    def answer(self):
        return self.told["answer"]

    def tell(self, answer):
        self.told["answer"] = answer
        self.done.set()


class Actor:
    """Keeps the calls of each method."""

    def __init__(self, *arguments):
        self.arguments = arguments
        self.calls: dict[str, list[Any]] = {"place": [], "ended": [], "stop": []}

    def __getattr__(self, name):
        def remote(*arguments):
            call = Call()
            self.calls[name].append((call, arguments))
            if name == "stop":
                for ending, _ in self.calls["ended"]:
                    ending.tell(0)
            return call

        return types.SimpleNamespace(remote=remote)

    def last(self, name):
        return self.calls[name][-1][0]


class Ray(types.ModuleType):
    """What is used of Ray."""

    def __init__(self):
        super().__init__("ray")
        self.exceptions = types.SimpleNamespace(
            RayError=ActorError, ActorUnavailableError=UnavailableError
        )
        self.actors: list[Actor] = []
        self.killed: list[tuple[Actor, bool]] = []
        self.asked_for: dict[str, Any] = {}
        self.joined = self.left = 0
        self.refuses: Exception | None = None
        self.known: list[str] | Exception = ["node-1"]

    def init(self, **given):
        if self.refuses is not None:
            raise self.refuses
        self.address, self.joined = given["address"], self.joined + 1

    def shutdown(self):
        self.left += 1

    def get_runtime_context(self):
        return types.SimpleNamespace(get_node_id=lambda: "node-1")

    def nodes(self):
        if isinstance(self.known, Exception):
            raise self.known
        return [{"NodeID": name, "Alive": True} for name in self.known]

    def remote(self, **asked_for):
        self.asked_for = asked_for

        def made(*arguments):
            self.actors.append(Actor(*arguments))
            return self.actors[-1]

        return lambda _: types.SimpleNamespace(remote=made)

    def wait(self, calls, num_returns, timeout):
        calls[0].done.wait(0.01)
        return [Call(call.told) for call in calls if call.done.is_set()][:num_returns], []

    def get(self, call):
        if isinstance(call.answer, Exception):
            raise call.answer
        return call.answer

    def kill(self, actor, no_restart=True):
        self.killed.append((actor, no_restart))


@pytest.fixture
def ray(monkeypatch):
    pretends = Ray()
    monkeypatch.setitem(sys.modules, "ray", pretends)
    return pretends


@pytest.fixture
def shards(ray, eventually):
    """Two shards that answer."""
    settings = TwinSettings(shards={"count": 2, "engine": "ray"})
    made = RayShards("ray", 2, threading.Event())
    made.join()
    assert eventually(lambda: len(ray.actors) == 2)  # which load their code
    assert not any(actor.calls["place"] for actor in ray.actors)
    made.start(FleetSettings.of(settings))
    assert eventually(lambda: [len(actor.calls["place"]) for actor in ray.actors] == [1, 1])
    assert made.url(0) is None
    for index, actor in enumerate(ray.actors):
        actor.last("place").tell((f"http://first/{index}", 100 + index, "node-1"))
    assert eventually(lambda: made.url(0) and made.url(1))
    yield made
    made.stop()


def test_each_shard_is_an_actor_that_ray_starts_again_for_ever(ray, shards):
    assert ray.address == "local"
    told = [actor.calls["place"][0][1] for actor in ray.actors]
    assert [index for _, index in told] == [0, 1]
    assert pickle.loads(told[0][0]).shards.engine == "ray"
    assert (ray.asked_for["max_restarts"], ray.asked_for["num_cpus"]) == (-1, 1.0)
    assert shards.place(1) == ("http://first/1", 101, "node-1")


@pytest.mark.parametrize("engine", ["ray", "ray:auto"])
def test_actors_reserve_what_the_settings_say(ray, engine, eventually):
    shards = {"count": 2, "engine": engine, "cores": 0.5}
    made = RayShards(engine, 2, threading.Event())
    made.join()
    assert eventually(lambda: len(ray.actors) == (2 if engine == "ray" else 0))
    made.start(FleetSettings.of(TwinSettings(shards=shards)))
    assert eventually(lambda: ray.asked_for.get("num_cpus") == 0.5)
    assert eventually(lambda: [len(one.calls["place"]) for one in ray.actors[-2:]] == [1, 1])
    assert len(ray.killed) == len(ray.actors) - 2
    made.stop()


def test_a_fleet_that_ends_before_it_starts_serves_nothing(ray, eventually):
    made = RayShards("ray", 2, threading.Event())
    made.join()
    made.stop()
    assert ray.left == 1
    assert not any(actor.calls["place"] for actor in ray.actors)


def test_a_lost_shard_has_no_address_until_it_answers_elsewhere(ray, shards, eventually):
    lost = ray.actors[0]
    lost.last("ended").tell(UnavailableError())
    assert eventually(lambda: shards.url(0) is None)
    assert shards.url(1) == "http://first/1"
    assert eventually(lambda: len(lost.calls["place"]) == 2)
    lost.last("place").tell(UnavailableError())  # still being started
    assert eventually(lambda: len(lost.calls["place"]) == 3)
    lost.last("place").tell(("http://second/0", 200, "node-2"))
    assert eventually(lambda: shards.url(0) == "http://second/0")
    assert (shards.restarts, len(ray.actors), ray.killed) == (1, 2, [])


def test_a_shard_that_was_started_again_unseen_is_asked_anew(ray, shards, eventually):
    lost = ray.actors[1]
    lost.last("ended").tell(None)
    assert eventually(lambda: len(lost.calls["place"]) == 2)
    assert shards.url(1) is None


def test_a_shard_that_ends_by_itself_is_started_again_after_a_while(
    ray, shards, eventually, caplog
):
    ended = ray.actors[0]
    ended.last("ended").tell(2)
    assert eventually(lambda: ray.killed == [(ended, False)])
    assert "Shard 0 of 2 has ended with code 2" in caplog.text
    assert eventually(lambda: len(ended.calls["place"]) == 2)


def test_an_actor_that_ray_gives_up_is_made_anew(ray, shards, eventually):
    ray.actors[0].last("ended").tell(UnavailableError())
    assert eventually(lambda: len(ray.actors[0].calls["place"]) == 2)
    ray.actors[0].last("place").tell(ActorError())
    assert eventually(lambda: len(ray.actors) == 3)
    assert ray.actors[2].calls["place"][0][1][1] == 0
    ray.actors[2].last("place").tell(("http://third/0", 300, "node-1"))
    assert eventually(lambda: shards.url(0) == "http://third/0")


def test_a_shard_that_finds_no_node_is_told_of(ray, shards, eventually, caplog, monkeypatch):
    monkeypatch.setattr(ray_actors, "PLACED_S", 0.05)
    ray.actors[0].last("ended").tell(UnavailableError())
    assert eventually(lambda: "needs a node with 1 free cores" in caplog.text)


def test_at_the_end_shards_end_by_themselves_before_they_are_killed(ray, shards):
    shards.stop()
    assert [len(actor.calls["stop"]) for actor in ray.actors] == [1, 1]
    assert ray.killed == [(actor, True) for actor in ray.actors]
    assert ray.left == 1
    assert shards.url(0) is None


def test_a_cluster_that_cannot_be_joined_is_refused_with_what_to_do(ray):
    ray.refuses = ConnectionError("nobody there")
    made = RayShards("ray://head:10001", 2, threading.Event())
    with pytest.raises(EngineError, match=r"nobody there\. Start it \(ray start --head\)"):
        made.join()


def test_a_lost_cluster_is_told_and_left_without_waiting_for_it(ray, shards, eventually):
    def lost(*_, **__):
        raise ConnectionError("the head is gone")

    ray.wait = lost
    assert eventually(lambda: shards.url(0) is None)
    assert eventually(lambda: shards._stop.is_set())
    assert shards.lost == "ConnectionError: the head is gone."
    assert ray.left == 0


@pytest.fixture
def asked_often(monkeypatch):
    """A cluster that is asked all the time what it knows."""
    monkeypatch.setattr(ray_actors, "CLUSTER_S", 0.0)


def test_a_cluster_with_another_head_is_lost(asked_often, ray, shards, eventually):
    ray.known = ["node-2"]
    assert eventually(lambda: shards._stop.is_set())
    assert "does not know the node of this driver" in shards.lost


def test_a_cluster_that_does_not_answer_for_a_moment_is_not_lost(
    asked_often, ray, shards, eventually
):
    ray.known = ValueError("channel closed")
    ray.actors[0].last("ended").tell(UnavailableError())
    assert eventually(lambda: shards.restarts == 1)
    assert not shards.lost
    ray.known = ["node-1"]


def test_an_actor_ends_its_shard_and_itself_once_its_raylet_has_ended(
    ray, monkeypatch, eventually
):
    parents = [10, 10, 1]
    codes: list[int] = []

    def run(settings, *, stop, ready, owned):
        ready("http://here")
        return 0 if stop.wait(30) else 3

    monkeypatch.setattr("twin_server.__main__.run", run)
    monkeypatch.setattr("logging.basicConfig", lambda **_: None)
    monkeypatch.setattr("os.getppid", lambda: parents.pop(0) if len(parents) > 1 else 1)
    monkeypatch.setattr("os._exit", codes.append)
    monkeypatch.setattr(shard_actor, "PARENT_S", 0.01)
    packed = pickle.dumps(TwinSettings(shards={"count": 2, "engine": "ray"}))
    actor = shard_actor.ShardActor(20, "text")
    assert actor.ended(actor.place(packed, 0)[0]) == 0
    assert eventually(lambda: codes == [1])


@pytest.mark.parametrize("engine", ["ray", "ray:auto"])
def test_an_actor_serves_its_share_where_the_front_reaches_it(ray, monkeypatch, engine):
    ray.util = types.SimpleNamespace(get_node_ip_address=lambda: "192.0.2.7")
    context = types.SimpleNamespace(get_node_id=lambda: "node-1")
    ray.get_runtime_context = lambda: context
    served = []

    def run(settings, *, stop, ready, owned):
        served.append(settings)
        ready("http://here")
        stop.wait(30)
        return 2

    monkeypatch.setattr("twin_server.__main__.run", run)
    monkeypatch.setattr("logging.basicConfig", lambda **_: None)
    fleet = TwinSettings(host="0.0.0.0", shards={"count": 2, "engine": engine, "key": "secret"})
    actor = shard_actor.ShardActor(20, "text")
    assert actor.place(pickle.dumps(fleet), 1) == ("http://here", os.getpid(), "node-1")
    assert actor.ended("http://before") is None
    actor.stop()
    assert actor.ended("http://here") == 2
    (own,) = served
    assert (own.shards.index, own.shards.key) == (1, "secret")
    assert own.host == {"ray": "127.0.0.1", "ray:auto": "192.0.2.7"}[engine]
    assert ("192.0.2.7" in own.access.hosts) == (engine == "ray:auto")
