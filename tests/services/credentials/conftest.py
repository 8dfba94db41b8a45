"""A site with its authority, and a router that knows it."""

import pytest

from slowtime_services.bus import ZenohBus
from slowtime_services.credentials import Authority, Credentials


@pytest.fixture(scope="package")
def authority(tmp_path_factory):
    made = Authority.open(tmp_path_factory.mktemp("keys"), "lab")
    for role in ("router", "server", "observer", "player"):
        made.issue(role, hosts=["127.0.0.1"])
    for asset in ("beam", "frame", "gone"):
        made.issue("edge", asset)
    return made


@pytest.fixture(scope="package")
def withdrawn(authority, tmp_path_factory):
    """The folder of an edge that was taken everything, as its thief has it."""
    kept = tmp_path_factory.mktemp("stolen") / "edge-gone"
    (authority.home / "edge-gone").rename(kept)
    assert authority.withdraw("edge", "gone") == 1
    return kept


@pytest.fixture(scope="package")
def router(authority, withdrawn, free_port):
    here = f"tls/127.0.0.1:{free_port()}"
    options = Credentials.read(authority.home / "router").router_options()
    with ZenohBus("router", listen=[here], options=options):
        yield here


@pytest.fixture
def join(router, authority):
    """Connect with the credentials of a folder."""
    joined = []

    def connect(folder, mode="client"):
        options = Credentials.read(authority.home / folder, at_any_time=True).client_options()
        bus = ZenohBus(mode, [router], options=options, open_timeout_s=60.0)
        joined.append(bus)
        return bus

    yield connect
    for bus in joined:
        bus.close()
