"""Over real Zenoh: each does what its certificate is for, and nothing else."""

import copy
import datetime

import pytest

from slowtime_schemas.streams import (
    ABOUT,
    ACK,
    EVENT,
    FATIGUE,
    FEATURES,
    HEALTH,
    RAW,
    REGISTRATION,
    SAMPLES,
    STATE,
    STREAMS,
    VIRTUAL,
    address_of,
    alive_key,
    any_key,
    request_key,
    server_key,
)
from slowtime_services.bus import BusUnreachableError, Sample, ZenohBus
from slowtime_services.credentials import Authority, Credentials, access_control
from slowtime_services.credentials.access import in_both_versions

LAST = "done"
WRITTEN = (FEATURES, HEALTH, ABOUT, RAW, FATIGUE, VIRTUAL)
"""Streams of an edge agent."""


def say(bus, key, payload):
    bus.publish(key, payload, encoding="application/json")


def told(bus, got, key, eventually):
    """Wait until all that was said before has come, or been dropped: order is kept."""

    def arrived():
        say(bus, key, LAST.encode())
        return any(sample.payload == LAST.encode() for sample in got)

    assert eventually(arrived)
    return {(s.key, s.payload) for s in got if s.payload != LAST.encode()}


def test_an_edge_writes_its_own_keys_and_no_other(join, eventually):
    server, edge = join("server"), join("edge-beam", "peer")
    got: list[Sample] = []
    for stream in (*WRITTEN, REGISTRATION):
        server.subscribe(stream.everywhere, got.append)
    observer = join("observer")
    seen: list[Sample] = []
    observer.subscribe(any_key(), seen.append)
    assert eventually(lambda: edge.connected)
    for site, asset in (("lab", "frame"), ("other", "beam"), ("lab", "beam")):
        for stream in STREAMS:
            say(edge, stream.key(site, asset), b"x")
    say(edge, "slowtime/v2/lab/features/174/beam/more", b"x")
    say(edge, "elsewhere", b"x")
    own = {(s.key("lab", "beam"), b"x") for s in (*WRITTEN, SAMPLES)}
    # What was said before the subscriptions were known may be missing; no forged key may come.
    assert told(edge, got, FEATURES.key("lab", "beam"), eventually) <= own
    for stream in (*WRITTEN, SAMPLES):
        say(edge, stream.key("lab", "beam"), b"x")
    # Samples are for the edge itself, not for the server.
    heard = own - {(SAMPLES.key("lab", "beam"), b"x")}
    assert eventually(lambda: heard <= {(s.key, s.payload) for s in got})
    assert eventually(lambda: own <= {(s.key, s.payload) for s in seen})
    assert {(s.key, s.payload) for s in got + seen if s.payload == b"x"} == own


def test_an_edge_that_spoke_before_anybody_listened_is_heard_once_somebody_does(
    join, eventually
):
    edge = join("edge-beam", "peer")
    assert eventually(lambda: edge.connected)
    for _ in range(3):
        say(edge, FEATURES.key("lab", "beam"), b"early")
    got: list[Sample] = []
    server = join("server")
    server.subscribe(FEATURES.everywhere, got.append)
    told(edge, got, FEATURES.key("lab", "beam"), eventually)


def test_an_edge_hears_its_own_acknowledgements_and_no_other_edge(join, eventually):
    server, beam, frame = join("server"), join("edge-beam"), join("edge-frame", "peer")
    spied: list[Sample] = []
    acknowledged: list[Sample] = []
    heard: list[Sample] = []
    for wide in (any_key(), "**", FEATURES.key("lab", "frame"), ACK.key("lab", "frame")):
        beam.subscribe(wide, spied.append)
    beam.subscribe(ACK.key("lab", "beam"), acknowledged.append)
    server.subscribe(FEATURES.everywhere, heard.append)
    assert eventually(lambda: frame.connected)
    told(frame, heard, FEATURES.key("lab", "frame"), eventually)
    for stream in (ACK, STATE, EVENT, REGISTRATION):
        say(server, stream.key("lab", "frame"), b"x")
    told(server, acknowledged, ACK.key("lab", "beam"), eventually)
    # Its own acknowledgements reach its wider subscriptions too; nothing else may.
    assert {sample.key for sample in spied} <= {ACK.key("lab", "beam")}


def test_an_edge_answers_its_own_requests_and_asks_nobody(join, eventually):
    server, beam, frame = join("server"), join("edge-beam"), join("edge-frame")
    asked = []

    def answer(asset):
        def handler(query):
            asked.append((asset, query.key))
            return [(FEATURES.key("lab", asset), asset.encode())]

        return handler

    for bus, asset in ((beam, "beam"), (frame, "frame")):
        bus.answer(request_key("lab", asset, "features"), answer(asset))
    beam.answer(request_key("lab", "frame", "features"), answer("forged"))
    for asset in ("beam", "frame"):
        key = request_key("lab", asset, "features")
        assert eventually(lambda key=key: server.ask(key))
        assert {a.payload for a in server.ask(key)} == {asset.encode()}
    asked.clear()
    curious = join("edge-beam")
    assert curious.ask(request_key("lab", "frame", "features"), timeout_s=0.5) == []
    assert asked == []


def test_who_is_alive_cannot_be_forged(join, eventually):
    server, beam = join("server"), join("edge-beam")
    seen: list[str] = []
    server.watch(alive_key("*", "*"), lambda key, alive: seen.append(key))
    beam.announce(alive_key("lab", "frame"))
    beam.announce(alive_key("lab", "beam"))
    assert eventually(lambda: seen)
    assert seen == [alive_key("lab", "beam")]


def test_a_server_sees_another_server_and_no_edge_is_taken_for_one(join, eventually):
    server, beam = join("server"), join("edge-beam")
    seen: list[str] = []
    server.watch(server_key("*"), lambda key, alive: seen.append(key))
    beam.announce(server_key("forged"))
    other = join("server")
    other.announce(server_key("other"))
    assert eventually(lambda: seen)
    assert seen == [server_key("other")]


def test_an_observer_writes_nothing(join, eventually):
    server, observer, beam = join("server"), join("observer"), join("edge-beam")
    got: list[Sample] = []
    for stream in (FEATURES, HEALTH, REGISTRATION):
        server.subscribe(stream.everywhere, got.append)
    told(beam, got, HEALTH.key("lab", "beam"), eventually)
    for stream in STREAMS:
        say(observer, stream.key("lab", "beam"), b"forged")
    observer.ask(request_key("lab", "beam", "about"), timeout_s=0.2)  # comes after what it said
    assert told(beam, got, HEALTH.key("lab", "beam"), eventually) == set()


def test_a_player_plays_any_edge_of_the_site(join, eventually):
    server, player = join("server"), join("player")
    got: list[Sample] = []
    server.subscribe(FEATURES.everywhere, got.append)
    acknowledged: list[Sample] = []
    player.subscribe(ACK.key("lab", "frame"), acknowledged.append)
    told(player, got, FEATURES.key("lab", "frame"), eventually)
    told(server, acknowledged, ACK.key("lab", "frame"), eventually)


def refused(there, options):
    with pytest.raises(BusUnreachableError):
        ZenohBus("client", [there], options=options, open_timeout_s=0.3)


def test_without_a_certificate_nobody_is_let_in(router, authority):
    refused(router, {})
    refused(router.replace("tls", "tcp"), {})
    with_trust_only = Credentials.read(authority.home / "edge-beam").client_options()
    for key in ("connect_private_key", "connect_certificate"):
        del with_trust_only[f"transport/link/tls/{key}"]
    refused(router, with_trust_only)


def test_an_expired_certificate_is_refused(router, authority):
    hour = datetime.timedelta(hours=1)
    folder = authority.issue("edge", "late", lasts=hour, from_now=-2 * hour)
    refused(router, Credentials.read(folder, at_any_time=True).client_options())


def test_a_link_ends_with_its_certificate(router, authority, join, eventually):
    lasts, connected = datetime.timedelta(seconds=1.5), False
    while not connected:  # a slow machine has to be quicker than the certificate ends
        lasts *= 2
        folder = authority.issue("edge", f"short-{lasts.seconds}", lasts=lasts)
        edge = join(
            folder, "peer"
        )  # the router knows it not, and lets it in: it may do nothing
        connected = eventually(lambda edge=edge: edge.connected, lasts.total_seconds())
    assert eventually(lambda: not edge.connected)


def test_a_certificate_of_another_authority_is_refused(router, authority, tmp_path):
    folder = Authority.open(tmp_path, "lab").issue("edge", "beam")
    forged = Credentials.read(folder).client_options()
    refused(router, forged)
    # Even when it takes the router's word for who it is.
    trusted = str(authority.home / "edge-beam" / "ca.pem")
    refused(router, forged | {"transport/link/tls/root_ca_certificate": trusted})


def test_a_withdrawn_certificate_may_do_nothing(join, withdrawn, eventually):
    server, beam, thief = join("server"), join("edge-beam"), join(withdrawn)
    got: list[Sample] = []
    server.subscribe(FEATURES.everywhere, got.append)
    told(beam, got, FEATURES.key("lab", "beam"), eventually)
    for asset in ("gone", "beam"):
        say(thief, FEATURES.key("lab", asset), b"stolen")
    thief.ask(request_key("lab", "beam", "about"), timeout_s=0.3)
    assert told(beam, got, FEATURES.key("lab", "beam"), eventually) == set()


def test_a_router_that_knows_nobody_serves_nobody():
    assert access_control([]) == {"enabled": True, "default_permission": "deny"}


def test_no_rule_of_an_edge_reaches_beyond_its_asset(authority):
    rules = access_control(authority.valid)["rules"]
    own = [rule for rule in rules if rule["id"].startswith("edge:lab:beam ")]
    assert {message for rule in own for message in rule["messages"]} == {
        "put", "declare_subscriber", "declare_queryable", "query", "reply", "liveliness_token",
        "declare_liveliness_subscriber",
    }  # fmt: skip
    keys = {key for rule in own for key in rule["key_exprs"]}
    assert all(address_of(key) == ("lab", "beam") and "*" not in key for key in keys)


def test_routers_with_credentials_pass_everything_on_to_each_other(
    authority, router, join, free_port, eventually
):
    here = f"tls/127.0.0.1:{free_port()}"
    folder = authority.home / "router"
    beside = Credentials.read(folder).router_options()
    edge_options = Credentials.read(authority.home / "edge-beam").client_options()
    server = join("server")
    got: list[Sample] = []
    server.subscribe(FEATURES.everywhere, got.append)
    with (
        ZenohBus("router", [router], [here], options=beside),
        ZenohBus("client", [here], options=edge_options) as edge,
    ):
        asked = request_key("lab", "beam", "account")
        edge.answer(asked, lambda query: [(query.key, b"all")])
        assert eventually(lambda: [one.payload for one in server.ask(asked)] == [b"all"])
        told(edge, got, FEATURES.key("lab", "beam"), eventually)


def test_access_that_was_written_with_former_keys_lets_present_ones_through(authority):
    told_now = access_control(authority.valid)
    old = copy.deepcopy(told_now)
    for rule in old["rules"]:
        rule["key_exprs"] = [key for key in rule["key_exprs"] if "slowtime/v2" not in key]
    now = {rule["id"]: set(rule["key_exprs"]) for rule in in_both_versions(old)["rules"]}
    assert now == {rule["id"]: set(rule["key_exprs"]) for rule in told_now["rules"]}
