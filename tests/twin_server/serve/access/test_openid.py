"""JWTs: of this provider, for this server, signed by its key, in time; nothing else."""

import base64
import datetime
import hmac
import json
import time

import pytest

from twin_server.identity.tokens import RefusedTokenError
from twin_server.serve.access import OpenId, Scope, WrongTokenFileError
from twin_server.settings import OpenIdSettings

jwt = pytest.importorskip("jwt")
ISSUER, AUDIENCE = "https://id.example", "slowtime"


@pytest.fixture(scope="module")
def keys():
    from cryptography.hazmat.primitives.asymmetric import ec

    return {name: ec.generate_private_key(ec.SECP256R1()) for name in ("ours", "theirs")}


@pytest.fixture
def jwks(keys, tmp_path):
    from jwt.algorithms import ECAlgorithm

    public = json.loads(ECAlgorithm.to_jwk(keys["ours"].public_key()))
    path = tmp_path / "jwks.json"
    path.write_text(
        json.dumps({"keys": [public | {"kid": "k1", "alg": "ES256", "use": "sig"}]})
    )
    return path


@pytest.fixture
def openid(jwks):
    return OpenId(OpenIdSettings(issuer=ISSUER, audience=AUDIENCE, jwks=str(jwks)))


def claims(**more):
    own = {"iss": ISSUER, "aud": AUDIENCE, "sub": "ann", "exp": time.time() + 600}
    own |= {"slowtime_scope": "operator", "slowtime_sites": ["lab"]} | more
    return {name: value for name, value in own.items() if value is not None}


def part(content):
    return base64.urlsafe_b64encode(content).rstrip(b"=").decode()


def signed(key, kid="k1", algorithm="ES256", **more):
    return jwt.encode(claims(**more), key, algorithm=algorithm, headers={"kid": kid})


def test_a_token_of_the_provider_is_let_in(openid, keys):
    found = openid.verify(signed(keys["ours"]))
    assert (found.scope, found.sites) == (Scope.OPERATOR, frozenset({"lab"}))
    assert found.still()
    everywhere = openid.verify(signed(keys["ours"], slowtime_sites="* "))
    assert everywhere.sites is None


@pytest.mark.parametrize(
    "more",
    [
        {"iss": "https://other.example"},
        {"aud": "another"},
        {"exp": 1.0},
        {"exp": None},
        {"sub": None},
        {"slowtime_scope": None},
        {"slowtime_scope": "king"},
        {"slowtime_sites": None},
        {"slowtime_sites": []},
        {"nbf": 4e9},
    ],
    ids=str,
)
def test_a_token_for_something_else_is_not(openid, keys, more):
    with pytest.raises(RefusedTokenError):
        openid.verify(signed(keys["ours"], **more))


def test_a_signature_of_another_key_or_kind_is_not(openid, keys, jwks):
    with pytest.raises(RefusedTokenError):
        openid.verify(signed(keys["theirs"]))
    with pytest.raises(RefusedTokenError):
        openid.verify(signed(keys["ours"], kid="k2"))
    head, body, _ = signed(keys["ours"]).split(".")
    none = part(b'{"alg":"none","kid":"k1"}')
    for forged in (f"{head}.{body}.", f"{none}.{body}.", "", "a.b.c", "slowtime_x"):
        with pytest.raises(RefusedTokenError):
            openid.verify(forged)
    # A key that is public is no secret: what it "signs" as one is worth nothing.
    head = part(b'{"alg":"HS256","kid":"k1"}')
    mac = hmac.digest(jwks.read_bytes(), f"{head}.{body}".encode(), "sha256")
    with pytest.raises(RefusedTokenError):
        openid.verify(f"{head}.{body}.{part(mac)}")


def test_what_was_verified_is_not_good_for_longer_than_the_token(jwks, keys):
    moment = time.time()
    openid = OpenId(
        OpenIdSettings(issuer=ISSUER, audience=AUDIENCE, jwks=str(jwks)), now=lambda: moment
    )
    word = signed(keys["ours"], exp=moment + 20)
    found = openid.verify(word)
    moment += datetime.timedelta(minutes=1).total_seconds()
    assert not found.still()
    assert openid._known[next(iter(openid._known))][1] < moment


def test_keys_that_cannot_be_had_are_told_at_once(tmp_path):
    (tmp_path / "bad.json").write_text("{}")
    for name in ("none.json", "bad.json"):
        settings = OpenIdSettings(issuer=ISSUER, audience=AUDIENCE, jwks=str(tmp_path / name))
        with pytest.raises(WrongTokenFileError, match="cannot be had from"):
            OpenId(settings)
    with pytest.raises(ValueError, match="jwks"):
        OpenIdSettings(issuer=ISSUER, audience=AUDIENCE, jwks="http://id.example/keys")
