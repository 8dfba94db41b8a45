"""The verbs start and work where modules of POSIX are absent, as on Windows.

`sitecustomize` in a folder of PYTHONPATH blocks them for all code of slowtime, in each process
and its children. Libraries keep theirs, as they choose by `sys.platform`.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request

import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration

BLOCKED = """
import builtins, os, sys
MODULES = {"fcntl", "resource", "termios", "pwd", "grp", "tty", "pty", "syslog", "crypt",
           "spwd", "readline", "nis", "posix"}
OURS = ("edge_agent", "slowtime", "slowtime_api", "slowtime_cli", "slowtime_schemas",
        "slowtime_services", "twin_server")
real = builtins.__import__

def guarded(name, globals=None, locals=None, fromlist=(), level=0):
    importer = ((globals or {}).get("__package__") or "").partition(".")[0]
    if level == 0 and name in MODULES and importer in OURS:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return real(name, globals, locals, fromlist, level)

builtins.__import__ = guarded
for name in ("nice", "fchmod", "chown", "fchown", "killpg", "getpgid", "setsid", "mkfifo"):
    delattr(os, name)
"""

pytestmark = pytest.mark.system


@pytest.fixture
def environment(tmp_path):
    """Environment of a process in which POSIX modules are absent."""
    folder = tmp_path / "blocking"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(BLOCKED)
    path = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
    return os.environ | {"PYTHONPATH": path}


@pytest.fixture
def run(environment, tmp_path):
    def command(*words):
        done = subprocess.run(
            [sys.executable, "-m", "slowtime_cli", *map(str, words)],
            cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
            timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    return command


@pytest.fixture
def record(tmp_path):
    """A record of a minute at 100 Hz: file name."""
    oscillator = Oscillator.from_modal(4.0, 0.02)
    samples = ambient_acceleration(oscillator, 6000, 100.0, np.random.default_rng(0))
    np.savetxt(tmp_path / "a.csv", samples / samples.std())
    return "a.csv"


def test_modules_are_blocked_for_code_of_slowtime_only(environment, tmp_path):
    code = (
        "import fcntl, os; print(hasattr(os, 'nice'))\n__package__ = 'slowtime_cli'\nimport pwd"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.stdout == "False\n"
    assert "No module named 'pwd'" in done.stderr


def test_every_module_can_be_imported(environment, tmp_path):
    code = """
import importlib, pkgutil
for name in ("slowtime_schemas", "slowtime_services", "edge_agent", "twin_server",
             "slowtime_api", "slowtime_cli"):
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, f"{name}."):
        if not module.name.endswith("__main__") or module.name.startswith("twin_server"):
            importlib.import_module(module.name)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("verb", ["edge", "twin", "identify", "diagnose", "tokens", "doctor"])
def test_help_is_shown(run, verb):
    assert f"slowtime {verb}" in run(verb, "--help")


@pytest.mark.long
def test_a_record_is_identified(run, record):
    assert "4.0" in run("identify", record, "--rate-hz", 100, "--out", "-")


@pytest.mark.long
def test_an_edge_agent_leaves_features_in_its_spool(run, record, tmp_path):
    (tmp_path / "edge.toml").write_text(
        'connect = ["tcp/127.0.0.1:1"]\nconnect_wait_s = 0.0\n'
        f'[input]\nkind = "file"\npath = "{record}"\nrate_hz = 100.0\nstart_ns = 1\n'
        "[extract]\nwindow_s = 20.0\n[publish]\nlinger_s = 0.0\n"
    )
    run("edge", "--config", "edge.toml", "--spool", "spool")
    files = [path for path in (tmp_path / "spool").rglob("*") if path.is_file()]
    assert b"".join(path.read_bytes() for path in files).count(b'"sequence"') == 3


def test_tokens_are_made_and_revoked(run):
    word = run("tokens", "add", "ann", "--scope", "viewer", "--site", "lab").strip()
    run("tokens", "revoke", word.split("_")[1])
    assert "revoked" in run("tokens", "list")


@pytest.mark.long
def test_a_history_is_diagnosed(run, tmp_path):
    rng, time_ = np.random.default_rng(1), np.arange(200.0)
    temperature = 10 * np.sin(time_ / 20)
    frequency = 4 - 0.003 * temperature + 0.002 * rng.standard_normal(200)
    table = np.column_stack([time_, frequency, np.full(200, 0.002), temperature])
    header = "slow_time,frequency_hz,frequency_sd,temperature_c"
    np.savetxt(tmp_path / "h.csv", table, delimiter=",", header=header, comments="")
    run("diagnose", "--history", "h.csv", "--out", "found")
    assert "temperature" in json.dumps(json.loads((tmp_path / "found/report.json").read_text()))


@pytest.mark.long
def test_a_twin_server_starts_answers_and_ends(environment, tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    server = subprocess.Popen(
        [
            sys.executable, "-m", "slowtime_cli", "twin", "--port", str(port),
            "--connect", "tcp/127.0.0.1:1", "--database", "t.sqlite",
        ],
        cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True,
    )  # fmt: skip
    try:
        deadline, status = time.monotonic() + 60, None
        while status != 200 and time.monotonic() < deadline and server.poll() is None:
            time.sleep(0.3)
            try:
                url = f"http://127.0.0.1:{port}/healthz"
                with urllib.request.urlopen(url, timeout=5) as answer:
                    status = answer.status
            except OSError:
                continue
        assert status == 200
    finally:
        server.send_signal(signal.SIGINT)
        try:
            told, _ = server.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            server.kill()
            raise
    assert server.returncode in (0, 130), told
    assert "Traceback" not in told
