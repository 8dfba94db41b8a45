"""The real house: real processes, real Zenoh on loopback, real files."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

PATIENCE_S = 300.0


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


class House:
    """Processes started by the command `slowtime`, ended with the test."""

    def __init__(self, home: Path) -> None:
        self.home = home
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self.environments: dict[str, dict[str, str]] = {}
        """Variables of processes, by their names."""

    def start(self, name: str, *arguments: str) -> None:
        log = (self.home / f"{name}.log").open("ab")
        self._running[name] = subprocess.Popen(
            [sys.executable, "-m", "slowtime_cli", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            cwd=self.home,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"} | self.environments.get(name, {}),
        )
        log.close()

    def router(self) -> None:
        self.start("router", "router", "--listen", self.endpoint)
        address = self.endpoint.removeprefix("tcp/").rsplit(":", 1)
        self.until(lambda: _answers(address[0], int(address[1])), "the router to listen")

    def twin(self, *arguments: str) -> None:
        self.start(
            "twin", "twin", "--connect", self.endpoint, "--port", str(self.port),
            "--database", str(self.home / "twin.sqlite"), *arguments,
        )  # fmt: skip
        self.until(lambda: bool(self.get("/readyz")), "the twin server to be ready")

    def edge(self, settings: dict[str, Any], name: str = "edge") -> None:
        config = self.home / f"{name}.json"
        spool = {"folder": str(self.home / f"{name}-spool")}
        config.write_text(json.dumps({"connect": [self.endpoint], "spool": spool} | settings))
        self.start(name, "edge", "--config", str(config))

    def wait(self, name: str, patience_s: float = PATIENCE_S) -> int:
        return self._running[name].wait(patience_s)

    def kill(self, name: str) -> None:
        self._running[name].kill()
        self._running.pop(name).wait()

    def end(self, name: str, patience_s: float = 15.0) -> int:
        process = self._running.pop(name)
        process.send_signal(signal.SIGTERM)
        return process.wait(patience_s)

    def end_all(self) -> None:
        for process in self._running.values():
            process.kill()
            process.wait()

    def said(self, name: str) -> str:
        return (self.home / f"{name}.log").read_text(errors="replace")

    def get(self, path: str) -> Any:
        try:
            with urllib.request.urlopen(self.url + path, timeout=300) as answer:
                return json.loads(answer.read())
        except (urllib.error.URLError, ConnectionError):
            return None

    def put(self, path: str, body: dict[str, Any]) -> None:
        request = urllib.request.Request(
            self.url + path,
            json.dumps(body).encode(),
            {"Content-Type": "application/json"},
            method="PUT",
        )
        urllib.request.urlopen(request, timeout=300).close()

    def history(self, twin_id: str) -> list[dict[str, Any]]:
        found = self.get(f"/api/v1/twins/{twin_id}/history?max_points=100000")
        return [] if found is None else found["points"]

    def until(
        self, holds: Callable[[], bool], what: str, patience_s: float = PATIENCE_S
    ) -> None:
        deadline = time.monotonic() + patience_s
        while not holds():
            if time.monotonic() > deadline:
                logs = "\n".join(f"--- {n}\n{self.said(n)[-2000:]}" for n in self._running)
                pytest.fail(f"Waited {patience_s:g} s for {what}.\n{logs}")
            time.sleep(0.1)


def _answers(host: str, port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((host, port)) == 0


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    here = House(tmp_path)
    yield here
    here.end_all()
