"""The process: it ends when asked to, and says what to do when it cannot begin."""

import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.parse
import urllib.request
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from slowtime_services.bus import MemoryBus, ZenohBus
from twin_server.__main__ import run

CHILD = """
import logging, sys
from pathlib import Path
from slowtime_services.bus import MemoryBus
from twin_server.__main__ import run
from twin_server.settings import TwinSettings

logging.basicConfig(level=logging.INFO)
folder = Path(sys.argv[1])
settings = TwinSettings(
    database=folder / "twin.sqlite", port=0, diagnose={"recordings": folder}, shutdown_s=2.0
)
sys.exit(run(settings, bus=MemoryBus(), ready=lambda url: print(url, flush=True)))
"""

UPLOAD = (
    "PUT /api/v1/recordings/day.mcap HTTP/1.1\r\nHost: {}\r\nContent-Length: 9\r\n"
    "Content-Type: application/octet-stream\r\n\r\n123"
)


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.long)]
)
def test_a_signal_ends_it_cleanly_with_status_0(tmp_path, number):
    """A client whose upload waits at that moment is told to come again."""
    arguments = [sys.executable, "-c", CHILD, str(tmp_path)]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("SLOWTIME_TWIN_")}
    with subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as child:
        assert child.stdout is not None
        url = child.stdout.readline().strip()
        with urllib.request.urlopen(f"{url}/readyz", timeout=30) as answer:
            assert answer.status == 200
        with urllib.request.urlopen(f"{url}/api/v1/twins", timeout=30) as answer:
            assert answer.read() == b'{"twins":[]}'
        address = urllib.parse.urlsplit(url)
        with socket.create_connection((address.hostname, address.port), 300) as upload:
            upload.sendall(UPLOAD.format(address.netloc).encode())
            while not list(tmp_path.glob(".*.partial")):
                time.sleep(0.02)
            child.send_signal(number)
            _, said = child.communicate(timeout=300)
            answer = upload.makefile("rb").read().decode()
    assert child.returncode == 0, said
    assert answer.startswith("HTTP/1.1 503"), answer
    assert "retry-after: 5" in answer
    assert "server-ends" in answer
    assert "Traceback" not in said


def test_a_taken_port_is_said_to_be_one(tmp_path, settings, caplog):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        own = settings.model_copy(
            update={"port": taken.getsockname()[1], "database": tmp_path / "x.sqlite"}
        )
        assert run(own, bus=MemoryBus()) == 2
    assert "cannot listen on" in caplog.text
    assert "--port" in caplog.text


def test_a_database_of_somebody_else_is_left_alone(tmp_path, settings, caplog):
    (tmp_path / "x.sqlite").write_bytes(b"something else " * 100)
    own = settings.model_copy(update={"database": tmp_path / "x.sqlite"})
    assert run(own, bus=MemoryBus()) == 2
    assert "Give another --database" in caplog.text
    assert (tmp_path / "x.sqlite").read_bytes() == b"something else " * 100


def test_a_router_that_is_not_there_is_waited_for_and_said_not_to_be(
    tmp_path, settings, caplog, ageing, edge, eventually
):
    """Page and history answer meanwhile; once there is one, features arrive."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    own = settings.model_copy(
        update={
            "database": tmp_path / "x.sqlite",
            "connect": (f"tcp/127.0.0.1:{port}",),
            "connect_timeout_s": 0.3,
        }
    )
    urls: queue.SimpleQueue[str] = queue.SimpleQueue()
    stop = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        ended = pool.submit(run, own, stop=stop, ready=urls.put)
        try:
            url = urls.get(timeout=60)
            waiting = httpx.get(f"{url}/readyz", timeout=60)
            assert waiting.status_code == 503
            assert "The router is not connected" in waiting.json()["detail"]
            assert httpx.get(f"{url}/api/v1/twins", timeout=60).json() == {"twins": []}
            assert eventually(lambda: caplog.text.count("No router answers") > 1)
            with ZenohBus("router", listen=own.connect) as router:
                assert eventually(
                    lambda: httpx.get(f"{url}/readyz", timeout=60).status_code == 200
                )
                speaker = edge(router)
                for message in ageing(5):
                    speaker.make(message)

                def count():
                    told = httpx.get(f"{url}/api/v1/twins/lab.beam/history/hash", timeout=60)
                    return told.json().get("features")

                assert eventually(lambda: count() == 5)
                speaker.close()
        finally:
            stop.set()
        assert ended.result(60) == 0


def test_a_wrong_file_of_registrations_is_the_user_s_to_mend(tmp_path, settings, caplog):
    (tmp_path / "r.json").write_text('{"beam": {}}')
    own = settings.model_copy(
        update={"database": tmp_path / "x.sqlite", "registrations": tmp_path / "r.json"}
    )
    assert run(own, bus=MemoryBus()) == 2
    assert "'beam' is not a valid twin's id" in caplog.text
