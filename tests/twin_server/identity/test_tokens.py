"""Tokens: shown once, hashed under a key, for a time, revoked at once, by several at a time."""

import datetime
import stat
import threading

import pytest

from twin_server.identity.tokens import RefusedTokenError
from twin_server.serve.access import Scope, TokenFile, WrongTokenFileError

DAY = datetime.timedelta(days=1)


@pytest.fixture
def tokens(tmp_path):
    return TokenFile(tmp_path / "tokens.json")


def test_a_token_stands_for_whom_it_was_made(tokens):
    word = tokens.add("ann", "operator", ["lab", "field"], DAY)
    found = TokenFile(tokens.path).verify(word)
    assert (found.scope, found.sites) == (Scope.OPERATOR, frozenset({"lab", "field"}))
    assert found.sees("lab.beam")
    assert not found.sees("labs.beam")
    assert found.name.startswith("ann ")


def test_the_files_hold_no_token_and_nobody_else_reads_them(tokens):
    word = tokens.add("ann", "viewer", ["*"], DAY)
    secret = word.split("_", 2)[2]
    for path in tokens.path.parent.iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert secret not in path.read_text()
    assert secret not in repr(tokens.all())


def test_a_token_ends(tmp_path):
    moment = 1_800_000_000.0
    tokens = TokenFile(tmp_path / "tokens.json", now=lambda: moment)
    word = tokens.add("ann", "viewer", ["*"], DAY)
    principal = tokens.verify(word)
    moment += 86_399
    assert tokens.verify(word)
    assert principal.still()
    moment += 2
    with pytest.raises(RefusedTokenError, match="expired"):
        tokens.verify(word)
    assert not principal.still()


def test_a_token_is_taken_back_for_a_server_that_runs(tokens):
    word = tokens.add("ann", "viewer", ["*"], DAY)
    server = TokenFile(tokens.path)
    principal = server.verify(word)
    tokens.revoke(word.split("_")[1])
    assert not principal.still()
    with pytest.raises(RefusedTokenError, match="revoked"):
        server.verify(word)
    with pytest.raises(ValueError, match="tokens list"):
        tokens.revoke("00000000")


def test_without_its_file_nobody_is_let_in(tokens):
    word = tokens.add("ann", "viewer", ["*"], DAY)
    tokens.path.unlink()
    with pytest.raises(RefusedTokenError, match="not known"):
        tokens.verify(word)


def test_a_hash_under_another_key_is_worth_nothing(tokens, tmp_path):
    word = tokens.add("ann", "viewer", ["*"], DAY)
    other = TokenFile(tmp_path / "other" / "tokens.json")
    other.add("bob", "viewer", ["*"], DAY)
    other.path.write_bytes(tokens.path.read_bytes())
    with pytest.raises(RefusedTokenError):
        TokenFile(other.path).verify(word)


def test_what_several_make_at_once_is_all_kept(tokens):
    threads = [
        threading.Thread(
            target=lambda n=n: TokenFile(tokens.path).add(str(n), "viewer", ["*"], DAY)
        )
        for n in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {token.name for token in tokens.all()} == {str(n) for n in range(8)}


def test_a_file_that_cannot_be_used_is_refused_with_a_way_out(tokens):
    with pytest.raises(WrongTokenFileError, match="Make the first token: slowtime tokens add"):
        tokens.check()
    tokens.add("ann", "viewer", ["*"], DAY)
    tokens.check()
    tokens.path.chmod(0o644)
    with pytest.raises(WrongTokenFileError, match="Run: chmod 600"):
        tokens.check()
    tokens.path.chmod(0o600)
    for content in ("", "[]", '{"tokens": [1]}', '{"tokens": [{"id": "a"}]}', "\x00" * 99):
        tokens.path.write_text(content)
        with pytest.raises(WrongTokenFileError, match="cannot be read"):
            tokens.check()


def test_a_token_s_name_looks_like_what_it_is(tmp_path):
    tokens = TokenFile(tmp_path / "tokens.json")
    with pytest.raises(ValueError, match=r"has U\+202E"):
        tokens.add("a\u202en", "viewer", ["lab"], datetime.timedelta(days=1))
    assert tokens.all() == ()
