"""The kernel's table of connections tells open sockets from closed ones."""

import socket

import pytest

from slowtime_services.bus.socket_table import established_ports, ports_of

needs_table = pytest.mark.skipif(
    established_ports() is None, reason="the system has no /proc/self/net/tcp"
)


@needs_table
@pytest.mark.parametrize(
    ("family", "host"), [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")]
)
def test_a_connection_is_listed_until_either_side_closes_it(family, host, eventually):
    try:
        listening = socket.create_server((host, 0), family=family)
    except OSError:
        pytest.skip(f"{host} cannot be bound")
    with listening, socket.create_connection(listening.getsockname()[:2]) as near:
        far, _ = listening.accept()
        ports = (near.getsockname()[1], near.getpeername()[1])
        assert ports in (established_ports() or ())
        far.close()
        assert eventually(lambda: ports not in (established_ports() or ()))


def test_a_system_without_the_table_is_told_apart_from_no_connection(tmp_path):
    empty = tmp_path / "tcp"
    empty.write_text("  sl  local_address rem_address   st\n")
    assert established_ports((tmp_path / "missing",)) is None
    assert established_ports((tmp_path / "missing", empty)) == set()


@pytest.mark.parametrize(
    ("source", "destination", "ports"),
    [
        ("tcp/127.0.0.1:56544", "tcp/localhost:7447", (56544, 7447)),
        ("tls/[::1]:5000", "tls/router.example:7447", (5000, 7447)),
        ("tcp/10.0.0.2:5000", "tcp/10.0.0.1:7447?prio=1-3", (5000, 7447)),
        ("udp/127.0.0.1:5000", "udp/127.0.0.1:7447", None),
        ("unixsock-stream/tmp/a", "unixsock-stream/tmp/b", None),
        ("tcp/127.0.0.1", "tcp/127.0.0.1:7447", None),
    ],
)
def test_ports_are_read_from_endpoints(source, destination, ports):
    assert ports_of(source, destination) == ports
