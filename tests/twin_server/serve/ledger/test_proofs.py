"""Heads and proofs over REST, verified by who has kept a head and nothing else."""

import json

import httpx
import pytest

from slowtime_services.credentials import make_key
from slowtime_services.ledger import TreeHead, verify
from tests.twin_server.persist.ledger_audit import forging
from twin_server.settings import LedgerSettings

TWINS = "/api/v1/twins"
TWIN = f"{TWINS}/lab.beam"
CHAIN = "/api/v1/ledger/chains/lab.beam"


@pytest.fixture(scope="module")
def key(tmp_path_factory):
    path = tmp_path_factory.mktemp("key") / "ledger.pem"
    return path, make_key(path)


@pytest.fixture
def started(serving, key, tmp_path):
    """Start a server that signs every second."""

    def start(name="twin.sqlite"):
        ledger = LedgerSettings(key=key[0], every_s=1.0)
        return serving(database=tmp_path / name, ledger=ledger)

    return start


def stop(server):
    server.stop.set()
    server.thread.join(60)


def signed(server, eventually, above=0):
    """The tree head of the twin once it covers more than so many entries."""

    def found():
        answer = server.client.get(f"{TWIN}/ledger")
        return answer.status_code == 200 and answer.json()["size"] > above

    assert eventually(found)
    return server.client.get(f"{TWIN}/ledger").json()


BODY = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}


def test_a_twin_is_proven_against_its_kept_head_and_a_forged_one_is_not(
    started, ageing, eventually, key
):
    server = started()
    messages = ageing(30)
    assert server.client.get(f"{TWIN}/ledger").status_code == 404
    server.client.put(TWIN, json=BODY)
    server.feed(messages[:20])
    assert eventually(lambda: server.count() == 20)
    kept = TreeHead.of(signed(server, eventually))
    server.feed(messages[20:])
    assert eventually(lambda: server.count() == 30)
    newest = TreeHead.of(signed(server, eventually, kept.size))
    assert (newest.chain, kept.public) == ("lab.beam", key[1])
    asked = {"boot": messages[0].boot, "sequence": messages[7].sequence}
    where = f"{CHAIN}/inclusion"
    assert eventually(lambda: server.client.get(where, params=asked).status_code == 200)
    told = {
        "head": newest._asdict(),
        "consistency": server.get(f"{CHAIN}/consistency", first=kept.size).json(),
        "inclusion": server.get(f"{CHAIN}/inclusion", **asked).json(),
    }
    told["head"] = told["consistency"]["head"]
    found = verify(told, kept, key[1])
    assert isinstance(found.head, TreeHead)
    assert found.head.size >= newest.size
    assert found.reading is not None
    assert found.reading.sequence == messages[7].sequence
    assert json.loads(found.reading.message)["sequence"] == messages[7].sequence

    def refused(what, **changes):
        with pytest.raises(ValueError, match=what):
            verify({**told, **changes}, kept, key[1])

    refused("another key", head={**told["head"], "public": "x"})
    refused("not signed", head={**told["head"], "size": told["head"]["size"] + 1})
    refused("does not begin", consistency={**told["consistency"], "proof": []})
    reading = {**told["inclusion"]["reading"], "slow_time": 1e9}
    refused("is not the one", inclusion={**told["inclusion"], "reading": reading})
    refused("no proof for this head", consistency=None)


def test_what_cannot_be_proven_is_refused_with_the_reason(started, ageing, eventually):
    server = started()
    server.client.put(TWIN, json=BODY)
    server.feed(ageing(5))
    assert eventually(lambda: server.count() == 5)
    head = signed(server, eventually)
    for path, status, what in (
        (f"{CHAIN}/consistency?first={head['size'] + 500}", 409, "keep the database"),
        (f"{CHAIN}/inclusion?boot=no&sequence=3", 404, "no reading 3 of boot no"),
        (f"{TWINS}/lab.none/ledger", 404, "No twin is called"),
    ):
        answer = server.client.get(path)
        assert (answer.status_code, what in answer.text) == (status, True), answer.text
    boot = ageing(1)[0].boot
    answer = server.get(f"{CHAIN}/inclusion", boot=boot, sequence=0, before=1)
    assert (answer.status_code, "entries 0 to 1" in answer.text) == (404, True)


def test_a_server_without_a_key_says_that_it_signs_nothing(serving):
    server = serving()
    server.client.put(TWIN, json=BODY)
    answer = server.client.get(f"{TWIN}/ledger")
    assert (answer.status_code, "--ledger-key" in answer.text) == (404, True)
    assert server.get("/readyz").json() == {"status": "ok"}
    assert server.get("/api/v1/ledger/heads").json() == {"heads": [], "refusal": ""}


def test_a_refusal_is_seen_everywhere_and_readings_go_on(started, ageing, eventually, tmp_path):
    server = started()
    server.client.put(TWIN, json=BODY)
    messages = ageing(20)
    server.feed(messages[:10])
    assert eventually(lambda: server.count() == 10)
    signed(server, eventually)
    stop(server)

    def forge(house, writer, table):
        row = forging._read(writer, table)[0]
        body = json.dumps(json.loads(row[-1]) | {"message": "Nothing happened."})
        forging.remove(writer, table, row)
        forging.put(writer, table, forging.with_column(table, row, "body", body))

    house = forging.House(tmp_path / "twin.sqlite", None, None, {}, {})
    forging.forge(house, forge, forging.BY_NAME["events"])
    server = started()
    server.feed(messages[10:])
    assert eventually(lambda: server.count() == 20)
    answer = server.get("/readyz")
    assert (answer.status_code, answer.json()["status"]) == (200, "degraded")
    assert "not signed any more" in answer.json()["notes"][0]
    assert "lab.beam" not in answer.text
    told = server.get("/api/v1/ledger/heads").json()
    assert "lab.beam: the row of events with number 1" in told["refusal"]
    assert told["heads"]
    assert "slowtime_twin_ledger_refused 1" in server.get("/metrics").text.splitlines()
    assert eventually(
        lambda: any(
            event["kind"] == "ledger_refused"
            for event in server.get(f"{TWIN}/events").json()["events"]
        )
    )
    answer = server.client.get(f"{TWIN}/ledger")
    assert (answer.status_code, "signs nothing any more" in answer.text) == (409, True)
    assert httpx.get(f"{server.url}/healthz").json() == {"status": "ok"}


def test_a_tree_head_says_nothing_of_other_twins(started, eventually):
    """Its size does not depend on what others have; the head of the server counts all."""
    sizes, heads = [], []
    for name in ("alone", "beside"):
        server = started(f"{name}.sqlite")
        if name == "beside":
            for other in range(3):
                server.client.put(f"{TWINS}/yard.secret{other}", json=BODY)
        server.client.put(TWIN, json=BODY)
        head = signed(server, eventually)
        assert TreeHead.of(head).is_signed
        sizes.append(head["size"])
        assert "yard" not in json.dumps(head)
        assert head.keys() == {"chain", "size", "tree", "t_ns", "public", "signature"}
        heads.append(server.get("/api/v1/ledger/heads").json()["heads"][-1])
        stop(server)
    assert sizes[0] == sizes[1]
    assert heads[1]["assets"] > heads[0]["assets"]


def test_the_command_fetches_a_proof_and_verifies_it_without_the_server(
    started, ageing, eventually, key, tmp_path, monkeypatch, capsys
):
    from slowtime_cli.__main__ import main

    monkeypatch.chdir(tmp_path)

    def run(*words):
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main(["db", "ledger", *words])
        return left.value.code, " ".join(" ".join(capsys.readouterr()).split())

    server = started()
    messages = ageing(20)
    server.client.put(TWIN, json=BODY)
    server.feed(messages[:10])
    assert eventually(lambda: server.count() == 10)
    size = signed(server, eventually)["size"]
    at, keyed = ("--server", server.url), ("--key", key[1])
    assert run("head", *at, "--out", "all.json")[0] == 0
    code, said = run("head", *at, "--twin", "lab.beam", "--out", "beam.json")
    assert (code, "head of lab.beam" in said) == (0, True), said
    server.feed(messages[10:])
    assert eventually(lambda: server.count() == 20)
    signed(server, eventually, size)
    asked = {"boot": messages[15].boot, "sequence": messages[15].sequence}
    where = f"{CHAIN}/inclusion"
    assert eventually(lambda: server.client.get(where, params=asked).status_code == 200)
    reading = f"{messages[15].boot}/{messages[15].sequence}"
    head = ("--head", "beam.json")
    code, said = run("prove", *at, *head, *keyed, "--reading", reading, "--out", "proof.json")
    assert (code, f"Reading {messages[15].sequence} of boot" in said) == (0, True), said
    code, said = run("prove", *at, "--head", "all.json", *keyed, "--out", "heads.json")
    assert (code, "go on from head" in said) == (0, True), said
    assert run("prove", *at, "--head", "all.json", "--reading", "b/1", "--out", "x.json")[0]
    stop(server)
    for proof, kept in (("proof.json", "beam.json"), ("heads.json", "all.json")):
        assert run("verify", proof, "--head", kept, *keyed)[0] == 0
        told = json.loads((tmp_path / kept).read_text())
        spoilt = {**told, "t_ns": told["t_ns"] + 1}
        (tmp_path / "other.json").write_text(json.dumps(spoilt))
        code, said = run("verify", proof, "--head", "other.json", *keyed)
        assert (code != 0, "does not prove it" in said) == (True, True), said
    code, said = run("prove", *at, *head, "--out", "y.json")
    assert (code, "Internal error" in said) == (2, False), said
    assert "Give that with --head" in run("verify", "proof.json")[1]
    assert "no proof for this head" in run("verify", "heads.json", *head)[1]
