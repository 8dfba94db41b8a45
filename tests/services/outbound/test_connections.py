"""Names that lead to this machine, at once or at the second look-up, and redirects."""

import http.server
import ipaddress
import socket
import threading
import urllib.error

import pytest

from slowtime_services.outbound.addresses import LocalAddressError, is_local, look_up
from slowtime_services.outbound.connections import PlainConnection, connected, fetch

LOCAL = [
    "127.0.0.1", "127.9.9.9", "::1", "0.0.0.0", "0.1.2.3", "::", "169.254.169.254", "fe80::1",
    "fd00:ec2::254", "fd20:ce::254", "100.100.100.200", "168.63.129.16", "::ffff:127.0.0.1",
    "::ffff:169.254.169.254", "::127.0.0.1", "2002:7f00:1::", "64:ff9b::a9fe:a9fe", "224.0.0.1",
]  # fmt: skip
ELSEWHERE = [
    "10.1.2.3",
    "192.168.1.1",
    "8.8.8.8",
    "fd12:3456::1",
    "2001:db8::1",
    "::ffff:8.8.8.8",
]


@pytest.fixture
def names(monkeypatch):
    """Answer look-ups from a list for each name, one answer after the other."""
    answers: dict[str, list[list[str]]] = {}
    asked: list[str] = []
    real = socket.getaddrinfo

    def getaddrinfo(host, port, *more, **given):
        if host not in answers:
            return real(host, port, *more, **given)
        asked.append(host)
        told = answers[host].pop(0) if len(answers[host]) > 1 else answers[host][0]
        return [
            (socket.AF_INET6 if ":" in one else socket.AF_INET, socket.SOCK_STREAM, 6, "",
             (one, port, 0, 0) if ":" in one else (one, port))
            for one in told
        ]  # fmt: skip

    monkeypatch.setattr(socket, "getaddrinfo", getaddrinfo)
    answers["asked"] = [asked]
    return answers


@pytest.fixture
def server():
    """A server of this machine that redirects whoever asks to itself, and counts."""
    reached: list[str] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            reached.append(self.path)
            self.send_response(302 if self.path == "/first" else 200)
            self.send_header("Location", "/second")
            self.end_headers()

        def log_message(self, *_given):
            pass

    listening = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=listening.serve_forever, daemon=True).start()
    yield listening.server_address[1], reached
    listening.shutdown()
    listening.server_close()


@pytest.mark.parametrize("text", LOCAL)
def test_a_name_may_not_lead_to_this_machine_its_link_or_a_metadata_service(names, text):
    assert is_local(ipaddress.ip_address(text))
    names["hook.example"] = [["8.8.8.8", text]]
    with pytest.raises(LocalAddressError, match=r"hook\.example leads to .*local = true"):
        look_up("hook.example", 443)
    assert len(look_up("hook.example", 443, local=True)) == 2


@pytest.mark.parametrize("text", ELSEWHERE)
def test_a_name_may_lead_to_other_machines_of_the_own_network_and_beyond(names, text):
    names["hook.example"] = [[text]]
    ((_, place),) = look_up("hook.example", 443)
    assert place[0] == text


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST.", "[::1]", "::1"])
def test_an_address_that_an_operator_writes_out_is_meant(names, host):
    names[host] = [["127.0.0.1"]]
    assert look_up(host, 80)


def test_a_name_that_changes_between_look_ups_is_looked_up_once(names, server, monkeypatch):
    port, reached = server
    names["hook.example"] = [["192.0.2.1"], ["127.0.0.1"]]
    tried = []

    class Recorded(socket.socket):
        def connect(self, place):
            tried.append(place[0])
            raise ConnectionRefusedError

    monkeypatch.setattr(socket, "socket", Recorded)
    with pytest.raises(ConnectionRefusedError):
        PlainConnection("hook.example", port, 1.0).request("GET", "/")
    assert tried == ["192.0.2.1"]
    assert names["asked"][0] == ["hook.example"]
    assert not reached


def test_a_name_that_leads_here_does_not_reach_a_service_of_this_machine(names, server):
    port, reached = server
    names["hook.example"] = [["127.0.0.1"]]
    with pytest.raises(LocalAddressError):
        PlainConnection("hook.example", port, 1.0).request("GET", "/")
    assert not reached
    connected("hook.example", port, 1.0, local=True).close()


def test_a_redirect_is_an_answer_and_is_not_followed(server):
    port, reached = server
    connection = PlainConnection("127.0.0.1", port, 5.0)
    connection.request("GET", "/first")
    assert connection.getresponse().status == 302
    connection.close()
    assert reached == ["/first"]


def test_keys_are_not_fetched_past_a_redirect(server):
    port, reached = server
    with pytest.raises(urllib.error.HTTPError, match="302"):
        fetch(f"http://127.0.0.1:{port}/first", 5.0, 100)
    assert reached == ["/first"]


def test_keys_are_not_fetched_from_this_machine_by_a_name(names):
    names["keys.example"] = [["127.0.0.1"]]
    with pytest.raises(urllib.error.URLError, match=r"keys\.example leads to 127\.0\.0\.1"):
        fetch("https://keys.example/jwks", 1.0, 100)
