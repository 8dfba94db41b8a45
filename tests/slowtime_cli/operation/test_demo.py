import os
import signal
import socket
import time
from pathlib import Path
from typing import Any, cast

import pytest

from slowtime_cli.operation.demo import latest, summary


def estimate(value, sd=1.0):
    return {"value": value, "sd": sd, "lo": value - 1.96 * sd, "hi": value + 1.96 * sd}


def test_the_summary_counts_how_often_the_bands_held_the_truth():
    truth = {"stiffness_change": 0.0, "mass_change": 0.0}
    points = [
        {
            "truth": truth,
            "stiffness_change": estimate(value),
            "mass_change": estimate(0.0, 0.0),
            "assumed": ["mass_change"],
        }
        for value in (0.0, 1.9, -1.9, 2.1)
    ]
    unjudged: dict[str, Any] = dict.fromkeys(("stiffness_change", "mass_change"))
    unjudged |= {"truth": truth, "assumed": []}
    assert summary("tower", {"points": [*points, {"truth": None}]}) == (
        "  demo.tower: of 4 epochs, 95 % intervals held the true stiffness change in 75.0%"
    )
    assert summary("tower", {"points": [unjudged]}).endswith("no estimate yet, after 1 epoch")
    assert summary("tower", {"points": []}).endswith("no estimate yet, after 0 epochs")


def test_the_summary_judges_each_element_and_names_the_suspect():
    truth = {"storey1": 0.0, "storey2": -0.2, "frequency_hz": 2.4}
    point = dict.fromkeys(("stiffness_change", "mass_change")) | {
        "truth": truth,
        "assumed": [],
        "elements": {"storey1": estimate(0.0, 0.01), "storey2": estimate(-0.1, 0.01)},
    }
    points = [point | {"elements": {}}, point, point | {"suspects": ["storey2"]}]
    assert summary("frame", {"points": points}) == (
        "  demo.frame: of 3 epochs, 95 % intervals held the true storey1 in 100.0%, "
        "the true storey2 in 0.0%; suspected now: storey2"
    )


class Server:
    """Gives 250,000 readings in buckets of 50,000, and the latest 100,000 whole."""

    def json(self, method, path, query):
        assert (method, path, query["max_points"]) == (
            "GET",
            "/twins/demo.tank/history",
            100_000,
        )
        if "start" in query:
            return {"points": [query["start"]], "bands": None}
        starts = [0, 50, 100, 150, 200]
        bands = {"readings": 250_000, "count": [50_000] * 5, "start": {"t_ns": starts}}
        return {"points": [], "bands": bands}


def test_a_history_too_long_to_be_given_whole_is_judged_by_its_latest_readings():
    history, whole = latest(cast(Any, Server()), "tank")
    assert (history["points"], whole) == ([150], False)
    point = {"truth": {"mass_change": 0.0}, "mass_change": estimate(0.0), "assumed": []}
    point |= {"stiffness_change": None}
    said = summary("tank", {"points": [point]}, whole=False)
    assert said.startswith("  demo.tank: of the latest 1 epochs, 95 % intervals held the true")


def test_a_demo_that_cannot_run_says_why_before_anything_starts(refused, tmp_path, port):
    (tmp_path / "a.mcap").write_bytes(b"precious")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        number = taken.getsockname()[1]
        said = refused("demo", "--port", number)
        assert f"Port {number} is in use on this computer. Give another, such as --port" in said
    for arguments, says in [
        (("--port", "0"), "0 is not in the range 1<=x<=65535"),
        (("--duration", "-1"), "-1.0 is not in the range"),
        (("--duration", "inf"), "inf is not a finite number"),
        (("--record", "a.mcap", "--port", port), "a.mcap exists and may be the only copy"),
        (("--record", "a.txt"), "does not end in .mcap"),
    ]:
        assert says in refused("demo", *arguments)


def processes_of(folder: Path) -> list[str]:
    """Command lines that name `folder`."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = entry.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if str(folder) in line and entry.parent.name != str(os.getpid()):
            found.append(line)
    return found


@pytest.mark.long
@pytest.mark.system
@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="needs /proc")
@pytest.mark.parametrize("early", [True, False])
def test_a_demo_that_is_ended_leaves_no_process_behind(start, port, tmp_path, early):
    home = tmp_path / "home"
    demo = start("demo", "--port", port, "--data", home)
    awaited = "Starting router" if early else "Ctrl-C ends everything."
    while (line := demo.stdout.readline()) and not line.startswith(awaited):
        pass
    deadline = time.monotonic() + 300
    while early and len(processes_of(home)) < 2:  # itself and the twin
        assert time.monotonic() < deadline
        time.sleep(0.02)
    demo.send_signal(signal.SIGTERM if early else signal.SIGINT)
    out, err = demo.communicate(timeout=300)
    assert (demo.returncode, err) == (0, "")
    assert ("epoch" in out) is not early
    assert processes_of(home) == []


@pytest.mark.long
@pytest.mark.system
def test_the_recording_of_a_short_demo_holds_heads_that_vouch_for_it(start, run, port):
    demo = start(
        "demo", "--port", port, "--data", "home", "--record", "a.mcap", "--duration", 15
    )
    _, err = demo.communicate(timeout=300)
    assert (demo.returncode, err) == (0, "")
    done = run("db", "ledger", "verify", "a.mcap", "--key", "home/ledger.pem.pub")
    assert done.status == 0
    assert "a.mcap is unchanged since it was accepted." in done.out
