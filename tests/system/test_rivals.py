"""Two agents of one asset and two servers on one bus, as real processes over Zenoh."""

import json
import sqlite3

import pytest

from edge_agent.publish import Spool

pytestmark = [pytest.mark.system, pytest.mark.long]


def listening(asset, seed, **more):
    structure = {
        "epochs": 1_000_000, "seconds": 2.0, "interval_s": 2.0, "rate_hz": 64.0, "seed": seed,
    }  # fmt: skip
    return {
        "site": "lab",
        "asset": asset,
        "extract": {"method": "peak"},
        "publish": {"linger_s": 0.0},
        "input": {"kind": "simulated", "every_s": 0.1, "structure": structure},
        **more,
    }


def events(house, twin_id, kind):
    found = house.get(f"/api/v1/twins/{twin_id}/events") or {"events": []}
    return [event for event in found["events"] if event["kind"] == kind]


def held(folder):
    """Payloads that are in a spool, by boot and sequence."""
    spool = Spool(folder, "reader")
    found = {
        (boot, json.loads(payload)["sequence"]): payload
        for boot, _, _ in spool.held()
        for payload in spool.read(boot)
    }
    spool.close()
    return found


def kept(database, asset):
    with sqlite3.connect(database) as connection:
        rows = connection.execute("select message from features").fetchall()
    messages = [(json.loads(row[0]), row[0]) for row in rows]
    return {(m["boot"], m["sequence"]): p for m, p in messages if m["asset"] == asset}


@pytest.mark.parametrize("boot", [{}, {"boot": "fixed"}], ids=["own boots", "one boot"])
def test_two_agents_are_named_and_both_keep_what_the_history_has_not(house, boot):
    house.router()
    house.twin()
    house.edge(listening("beam", 5, **boot), "one")
    house.until(lambda: len(house.history("lab.beam")) > 20, "features of the first agent")
    house.edge(listening("beam", 6, **boot), "other")
    house.until(lambda: events(house, "lab.beam", "two_agents"), "the event")
    (event,) = events(house, "lab.beam", "two_agents")
    boots = event["details"]["boots"]
    assert len(boots) == 2
    assert (boots[0] == boots[1] == "fixed") if boot else boots[0] != boots[1]
    assert all(name in event["message"] for name in boots)
    before = len(house.history("lab.beam"))
    house.until(lambda: len(house.history("lab.beam")) > before + 20, "more features")
    for name in ("one", "other"):
        house.end(name)
    house.end("twin")
    history = kept(house.home / "twin.sqlite", "beam")
    spools = [held(house.home / f"{name}-spool" / "lab.beam") for name in ("one", "other")]
    if boot:
        # What came first is in the history; each keeps what is its own and not in there.
        for spool in spools:
            last = max(sequence for _, sequence in spool)
            for sequence in range(last + 1):
                key = ("fixed", sequence)
                assert key in spool or key in history
        assert any(
            history.get(key) != payload for spool in spools for key, payload in spool.items()
        )
    else:
        first = spools[0]
        last = max(sequence for _, sequence in first)
        assert {(boots[0], n) for n in range(last + 1)} <= set(first) | set(history)
        assert (boots[0], last) in first


def test_a_second_server_is_not_ready_until_the_first_has_gone(house):
    house.router()
    house.twin()
    house.start(
        "second", "twin", "--connect", house.endpoint, "--port", "0",
        "--database", str(house.home / "second.sqlite"),
    )  # fmt: skip
    house.until(
        lambda: "Another twin server was on this bus first" in house.said("second"),
        "the second server to say so",
    )
    house.until(
        lambda: "A second twin server is on this bus" in house.said("twin"), "the first"
    )
    house.edge(listening("beam", 5), "one")
    house.until(lambda: len(house.history("lab.beam")) > 10, "features")
    assert house.get("/readyz") == {"status": "ok"}
    house.kill("twin")
    house.until(
        lambda: "this one publishes from now on" in house.said("second"), "the second to speak"
    )
