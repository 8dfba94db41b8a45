import json
import stat
from pathlib import Path

import pytest


def test_what_is_missing_is_made_and_nothing_twice(run):
    first = run("keys", "make", "lab", "--asset", "beam", "--host", "10.0.0.2")
    assert first.status == 0
    assert set(first.out.split()) == {
        f"keys/{name}" for name in ("router", "server", "observer", "player", "edge-beam")
    }
    assert run("keys", "make", "lab", "--asset", "frame").out.split() == ["keys/edge-frame"]
    assert run("keys", "make", "lab").out == ""
    # A router that is reached at a new address needs a new certificate, good for the old too.
    assert run("keys", "make", "lab", "--host", "twin.lab").out.split() == ["keys/router"]
    issued = json.loads(Path("keys/authority/issued.json").read_text())["issued"]
    assert issued[-1]["hosts"] == ["localhost", "127.0.0.1", "10.0.0.2", "twin.lab"]
    assert stat.S_IMODE(Path("keys/server/key.pem").stat().st_mode) == 0o600


def test_a_list_shows_until_when_and_what_was_withdrawn(run):
    run("keys", "make", "lab", "--asset", "beam", "--days", "10")
    assert "9 days left" in run("keys", "list").out
    assert run("keys", "renew").err.startswith("5 certificates renewed")
    assert "2 certificates revoked" in run("keys", "withdraw", "--asset", "beam").err
    assert "withdrawn" in run("keys", "list").out


def test_wrong_orders_are_refused_in_a_sentence(refused):
    assert "holds no authority" in refused("keys", "list")
    assert "Give --asset or --role" in refused("keys", "withdraw")
    assert "at most 63 lower-case letters" in refused("keys", "make", "LAB")
    assert "anybody who can reach this computer" in refused(
        "router", "--listen", "tcp/0.0.0.0:7447"
    )


@pytest.mark.parametrize("verb", ["record --out a.mcap", "status", "edge --simulate tower"])
def test_credentials_go_with_an_encrypted_endpoint(run, refused, verb):
    run("keys", "make", "demo", "--asset", "tower")
    said = refused(
        *verb.split(), "--credentials", "keys/edge-tower", "--connect", "tcp/127.0.0.1:1"
    )
    assert "tcp/127.0.0.1:1 is not encrypted" in said
