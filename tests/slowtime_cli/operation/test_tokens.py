import stat
from pathlib import Path

from twin_server.serve.access import Scope, TokenFile


def test_a_token_is_shown_once_and_known_from_then_on(run):
    made = run("tokens", "add", "ann", "--scope", "operator", "--site", "lab", "--days", "30")
    assert made.status == 0
    word = made.out.strip()
    found = TokenFile(Path("tokens.json")).verify(word)
    assert (found.scope, found.sites) == (Scope.OPERATOR, frozenset({"lab"}))
    assert stat.S_IMODE(Path("tokens.json").stat().st_mode) == 0o600
    listed = run("tokens", "list").out
    assert "ann" in listed
    assert "good" in listed
    assert word.split("_", 2)[2] not in listed


def test_a_token_is_revoked_by_its_number(run, refused):
    word = run("tokens", "add", "bob", "--scope", "viewer", "--site", "*").out.strip()
    assert run("tokens", "revoke", word.split("_")[1]).status == 0
    assert "revoked" in run("tokens", "list").out
    assert "tokens list" in refused("tokens", "revoke", "00000000")


def test_wrong_orders_are_refused_in_a_sentence(refused):
    assert "Missing option '--site'" in refused("tokens", "add", "a", "--scope", "viewer")
    assert "is not one of" in refused("tokens", "add", "a", "--scope", "king", "--site", "lab")
    assert "go together" in refused("twin", "--tls-key", __file__)


def test_listing_tokens_of_a_file_that_is_not_there_is_refused_and_makes_none(refused):
    for words in (("list",), ("revoke", "1a2b3c4d")):
        assert "'tokens.json' does not exist" in refused("tokens", *words)
    assert list(Path().iterdir()) == []
