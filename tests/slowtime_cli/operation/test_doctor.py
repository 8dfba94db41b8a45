"""`slowtime doctor` finds what is wrong, and says what to do."""

import http.server
import importlib.metadata
import json
import socket
import sys
import threading
import time
from pathlib import Path

import pytest

from slowtime_cli.operation.doctor import installation, surroundings
from slowtime_cli.operation.doctor.findings import CheckLine
from slowtime_cli.operation.doctor.report import GROUPS, checked


@pytest.fixture
def listening():
    """Answer each connection on a port of this machine with the same bytes."""
    opened = []

    def listen(answer: bytes) -> int:
        server = socket.create_server(("127.0.0.1", 0))
        opened.append(server)

        def serve() -> None:
            while True:
                try:
                    link, _ = server.accept()
                except OSError:
                    return
                with link:
                    link.settimeout(2.0)
                    link.recv(1000)
                    link.sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        number: int = server.getsockname()[1]
        return number

    yield listen
    for server in opened:
        server.close()


@pytest.fixture
def serving():
    """Serve a page that answers `/healthz` as a twin server does, with a Date of one's own."""
    started = []

    def serve(date: str, body: bytes = b'{"status": "ok"}') -> str:
        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                self.send_response_only(200)
                self.send_header("Date", date)
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_args):
                pass

        server = http.server.HTTPServer(("127.0.0.1", 0), Handler)
        started.append(server)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        return f"http://127.0.0.1:{server.server_address[1]}"

    yield serve
    for server in started:
        server.shutdown()
        server.server_close()


def date_of(t_s):
    return time.strftime("%a, %d %b %Y %H:%M:%S GMT", time.gmtime(t_s))


def test_where_nothing_runs_it_names_what_would_start_it(run, port):
    away = ("--connect", f"tcp/127.0.0.1:{port}", "--server", f"http://127.0.0.1:{port}")
    done = run("doctor", *away)
    assert done.status == 0, done.out
    assert "No problems" in done.out
    for said in ("Start one: slowtime router", "Start one: slowtime twin", "the port is free"):
        assert said in done.out
    assert [done.out.index(f"\n{group}\n") for group in GROUPS] == sorted(
        done.out.index(f"\n{group}\n") for group in GROUPS
    )


def test_findings_are_json_where_asked_for(run, port):
    away = ("--connect", f"tcp/127.0.0.1:{port}", "--server", f"http://127.0.0.1:{port}")
    found = run("doctor", *away, "--out", "-").json
    versions = {one["name"]: one["text"] for one in found if one["group"] == "Versions"}
    assert versions["numpy"] == importlib.metadata.version("numpy")
    assert all(one["state"] in ("ok", "note", "problem") for one in found)


@pytest.mark.system
def test_a_router_that_runs_is_found(router):
    (found,) = surroundings.router((router,), None, 4.0)
    assert found.state == "ok"
    assert "no process online" in found.text


def test_a_port_that_another_program_has_is_a_problem(listening):
    port = listening(b"220 mail.example ESMTP\r\n")
    (found,) = surroundings.router((f"tcp/127.0.0.1:{port}",), None, 0.5)
    assert (found.state, "is not a router" in found.text) == ("problem", True)
    (found,) = surroundings.twin_server(f"http://127.0.0.1:{port}", 0.5)
    assert found.state == "problem"
    assert "slowtime twin --port" in found.advice


def test_a_twin_server_and_its_clock_are_compared(serving):
    server, clock = surroundings.twin_server(serving(date_of(time.time())), 2.0)
    assert (server.state, clock.state) == ("ok", "ok")
    _, clock = surroundings.twin_server(serving(date_of(time.time() - 3600)), 2.0)
    assert clock.state == "problem"
    assert "+36" in clock.text or "+35" in clock.text
    (other,) = surroundings.twin_server(serving(date_of(time.time()), b"<html>"), 2.0)
    assert (other.state, "another program" in other.text) == ("problem", True)


@pytest.mark.parametrize(
    ("answer", "state", "said"),
    [
        (b"\x20\x02\x00\x00", "ok", "answers at"),
        (b"\x20\x02\x00\x05", "note", "refuses with code 5"),
        (b"HTTP/1.1 400", "problem", "is not an MQTT broker"),
    ],
)
def test_a_broker_is_asked_by_its_own_protocol(listening, answer, state, said):
    (found,) = surroundings.mqtt(f"127.0.0.1:{listening(answer)}", 2.0)
    assert (found.state, said in found.text) == (state, True)


def test_a_broker_that_is_not_there_is_a_problem(port):
    (found,) = surroundings.mqtt(f"127.0.0.1:{port}", 0.5)
    assert found.state == "problem"
    assert "mosquitto" in found.advice


def test_a_missing_library_names_the_line_that_installs_it(monkeypatch):
    known = installation.installed_version
    monkeypatch.setattr(
        installation, "installed_version", lambda name: None if name == "numba" else known(name)
    )
    found = {one.name: one for one in installation.extras()}
    assert (found["mqtt"].state, found["analysis"].state) == ("ok", "note")
    assert "numba" in found["analysis"].text
    assert found["twin"].advice == "pip install 'slowtime[twin]'"
    assert "dev" not in found


def test_a_python_that_is_too_old_and_a_lost_library_are_problems(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 10, 1))
    monkeypatch.setattr(installation, "installed_version", lambda name: None)
    found = {one.name: one for one in installation.versions()}
    assert found["Python"].state == "problem"
    assert "3.11" in found["Python"].advice
    assert found["numpy"].state == "problem"


def test_a_folder_that_cannot_be_written_is_a_problem(tmp_path):
    gone = tmp_path / "gone"
    folder, temporary = installation.write_access(gone)
    assert (folder.state, temporary.state) == ("problem", "ok")
    assert str(gone) in folder.text


def test_a_clock_that_was_never_set_is_a_problem(monkeypatch):
    monkeypatch.setattr(time, "time", lambda: 1e6)
    monkeypatch.setattr(surroundings, "_synchronized", lambda _timeout_s: False)
    never_set, by_ntp = surroundings.clock(1.0)
    assert (never_set.state, by_ntp.state) == ("problem", "note")
    assert "1970" in never_set.text


def test_compiled_code_is_counted_where_it_is_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (found,) = installation.compiled_code()
    assert (found.state, "compiles it" in found.text) == ("note", True)
    (tmp_path / "a").mkdir()
    (tmp_path / "a/law.nbi").touch()
    (found,) = installation.compiled_code()
    assert (found.state, "1 functions" in found.text) == ("ok", True)


def test_a_problem_is_the_exit_status(run, port, monkeypatch):
    def refused(folder: Path):
        return [CheckLine("Write access", "folder", "problem", "full", "Make room.")]

    monkeypatch.setattr(installation, "write_access", refused)
    away = ("--connect", f"tcp/127.0.0.1:{port}", "--server", f"http://127.0.0.1:{port}")
    done = run("doctor", *away)
    assert done.status == 1
    assert "→ Make room." in done.out
    assert "1 problem," in done.out


def test_every_finding_has_a_group_of_the_report(port, tmp_path):
    away = (f"tcp/127.0.0.1:{port}",)
    found = list(checked(away, None, f"http://127.0.0.1:{port}", None, tmp_path, 0.3))
    assert {one.group for one in found} == set(GROUPS)
    json.dumps([one.text for one in found])
