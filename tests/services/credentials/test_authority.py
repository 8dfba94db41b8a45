"""What an authority makes: valid as long as it says, read by nobody else, told apart."""

import datetime
import json
import logging
import stat
import subprocess
import sys

import pytest

from slowtime_services.credentials import (
    Authority,
    Credentials,
    CredentialsError,
    NotNowError,
    WrongAuthorityError,
    common_name,
    options_for,
)
from slowtime_services.router import run

DAY = datetime.timedelta(days=1)
HERE = "tls/127.0.0.1:7447"


def test_nobody_else_reads_what_was_made(tmp_path):
    authority = Authority.open(tmp_path / "keys", "lab")
    authority.issue("router", hosts=["localhost"])
    authority.issue("edge", "beam")
    made = [path for path in (tmp_path / "keys").rglob("*")]
    assert len(made) == 3 + 3 + 4 + 3
    assert {stat.S_IMODE(path.stat().st_mode) for path in made if path.is_file()} == {0o600}
    assert {stat.S_IMODE(path.stat().st_mode) for path in made if path.is_dir()} == {0o700}


def test_a_key_that_others_may_read_is_not_used(tmp_path):
    folder = Authority.open(tmp_path, "lab").issue("edge", "beam")
    (folder / "key.pem").chmod(0o640)
    with pytest.raises(
        CredentialsError, match=r"permissions 0640; must be 0600\)\. Run: chmod 600"
    ):
        Credentials.read(folder)


def test_a_folder_that_is_not_whole_says_what_it_lacks(tmp_path):
    folder = Authority.open(tmp_path, "lab").issue("edge", "beam")
    with pytest.raises(CredentialsError, match=r"has no access\.json.*router's folder"):
        Credentials.read(folder).router_options()
    (folder / "certificate.pem").write_text("nonsense")
    with pytest.raises(CredentialsError, match="is not a valid certificate"):
        Credentials.read(folder)
    (folder / "key.pem").unlink()
    with pytest.raises(CredentialsError, match=r"has no key\.pem.*keys/server"):
        Credentials.read(folder)


def test_a_certificate_says_when_it_is_not_valid_and_warns_before(tmp_path, caplog):
    authority = Authority.open(tmp_path, "lab")
    past = authority.issue("edge", "beam", lasts=DAY, from_now=-2 * DAY)
    with pytest.raises(NotNowError, match=r"expired on .*slowtime keys renew"):
        Credentials.read(past)
    future = authority.issue("edge", "beam", from_now=2 * DAY)
    with pytest.raises(NotNowError, match="Correct the clock"):
        Credentials.read(future)
    with caplog.at_level(logging.ERROR):
        options_for(future, [HERE], at_any_time=True)
    assert "Correct the clock" in caplog.text
    soon = authority.issue("edge", "beam", lasts=5 * DAY)
    with caplog.at_level(logging.WARNING):
        Credentials.read(soon)
    assert "expires in 4 days" in caplog.text


def test_what_expires_soon_is_renewed_and_the_old_one_stays_valid(tmp_path):
    authority = Authority.open(tmp_path, "lab")
    authority.issue("router", hosts=["localhost"], lasts=400 * DAY)
    authority.issue("edge", "beam", lasts=10 * DAY)
    authority.issue("edge", "old", lasts=DAY, from_now=-2 * DAY)
    made = authority.renew(30 * DAY)
    assert [(i.role, i.asset) for i in made] == [("edge", "beam"), ("edge", "old")]
    assert authority.renew(30 * DAY) == []
    access = json.loads((tmp_path / "router" / "access.json").read_text())
    names = {s["id"]: s["cert_common_names"] for s in access["subjects"]}
    assert {who: len(of) for who, of in names.items()} == {
        "edge:lab:beam": 2,
        "edge:lab:old": 1,
        "router:lab": 1,
    }


def test_the_ledger_is_kept(tmp_path):
    Authority.open(tmp_path, "lab").issue("edge", "beam", hosts=["a"])
    again = Authority.open(tmp_path)
    assert again.site == "lab"
    assert again.has("edge", "beam")
    assert again.withdraw("edge", "beam") == 1
    assert not Authority.open(tmp_path).has("edge", "beam")
    assert not (tmp_path / "edge-beam").exists()


def test_wrong_orders_say_what_is_allowed(tmp_path):
    with pytest.raises(WrongAuthorityError, match="Make one with slowtime keys make SITE"):
        Authority.open(tmp_path)
    authority = Authority.open(tmp_path, "lab")
    with pytest.raises(WrongAuthorityError, match="is the authority of lab"):
        Authority.open(tmp_path, "other")
    with pytest.raises(ValueError, match="Allowed: router, server"):
        authority.issue("king")
    with pytest.raises(ValueError, match="An edge has an asset"):
        authority.issue("edge")


def test_names_do_not_run_into_each_other():
    long = ["a" * 63, "a" * 62 + "b"]
    names = [common_name("edge", "s" * 63, asset, 1 << 100) for asset in long]
    assert len(set(names)) == 2
    assert all(len(name) <= 64 for name in names)


def test_credentials_do_not_travel_to_an_endpoint_in_the_clear(tmp_path):
    folder = Authority.open(tmp_path, "lab").issue("server")
    with pytest.raises(CredentialsError, match=r"tcp/10\.0\.0\.1:1 is not encrypted"):
        options_for(folder, [HERE, "tcp/10.0.0.1:1"])


def test_a_router_without_credentials_stays_on_this_machine():
    with pytest.raises(CredentialsError, match=r"At tcp/0\.0\.0\.0:7447 anybody.*--insecure"):
        run(["tcp/127.0.0.1:7447", "tcp/0.0.0.0:7447"])


def test_the_bus_does_without_cryptography_where_nobody_asks_for_it():
    # The library takes a while to import, and most commands need no certificate.
    program = """if True:
        import sys, slowtime_services.router
        sys.exit("cryptography" in sys.modules)
    """
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_an_edge_notices_that_it_was_given_anothers_certificate(tmp_path):
    authority = Authority.open(tmp_path, "lab")
    of_beam = Credentials.read(authority.issue("edge", "beam"))
    of_beam.check_is_of_edge("lab", "beam")
    server = Credentials.read(authority.issue("server"))
    for own, site, asset in (
        (of_beam, "lab", "frame"),
        (of_beam, "other", "beam"),
        (server, "lab", "beam"),
    ):
        with pytest.raises(CredentialsError, match=f"edge agent of {site}.{asset}"):
            own.check_is_of_edge(site, asset)


@pytest.mark.parametrize("hosts", [["10.0.0.1"] * 65, ["a" * 254]])
def test_hosts_without_end_are_refused_before_anything_is_made(tmp_path, hosts):
    authority = Authority.open(tmp_path, "lab")
    with pytest.raises(ValueError, match="Allowed: 64 hosts, of up to 253 characters"):
        authority.issue("router", hosts=hosts)
    assert not authority.issued
    assert authority.issue("router", hosts=["10.0.0.1"] * 64).is_dir()
