"""Take the picture of a monitored tower: ``python -m docs.figures.tower``.

Simulates twelve hours of the lattice tower of 20,160 degrees of freedom and 30 groups under 24
channels, one group of which loses 10 % after the eighth; runs router, twin server and an edge
agent that reads these samples, until the last hour has named the group; writes
``docs/tower.png``. It takes about six minutes of processor time, four of them the edge agent's.
"""

import argparse
import contextlib
import json
import shutil
import socket
import tempfile
import time
from pathlib import Path

import httpx
from playwright.sync_api import expect, sync_playwright

from benchmarks.methods.lattice_tower.record import TowerRecord, write_record
from slowtime_cli.operation.child_processes import Children, children

PICTURE = Path(__file__).parents[1] / "tower.png"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
GROUP, TWIN = "legs 5", "lab.tower"
WIDTH_PX, HEIGHT_PX = 1200, 1790
"""Size of the picture [px]: down to the changes of all groups, without their table."""

LATER = 4
"""Hours after the loss, which show it over time [1]."""

MODE = "3"
"""Mode that is shown, by its number from 0: bending with two nodes."""

MOST_BYTES = 400_000
PATIENCE_S = 1800.0


def main() -> None:
    """Read the flags, run the processes, take the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--group", default=GROUP, help="the group that loses 10 %%")
    parser.add_argument("--out", type=Path, default=PICTURE)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = write_record(folder, given.group, later=LATER)
        print(f"{made.windows} hours of samples are written.", flush=True)
        with children(folder / "logs") as family:
            url = start_processes(family, folder, made)
            wait_for(family, f"{url}/api/v1/twins/{TWIN}/history", made.windows)
            take(url, given.group, given.out)
    print(f"{given.out}: {given.out.stat().st_size / 1000:.0f} kB")


def start_processes(family: Children, folder: Path, made: TowerRecord) -> str:
    """Start router, twin server and edge agent.

    Parameters
    ----------
    family
        Processes to add to.
    folder
        Folder of their files.
    made
        Record, and what the processes are given.

    Returns
    -------
    Address of the twin server.
    """
    endpoint, port = f"tcp/127.0.0.1:{_free_port()}", _free_port()
    url = f"http://127.0.0.1:{port}"
    family.start("router", ["router", "--listen", endpoint])
    database = ["--database", str(folder / "twin.sqlite")]
    family.start("twin", ["twin", "--connect", endpoint, "--port", str(port), *database])
    wait_for(family, f"{url}/readyz")
    put = httpx.put(f"{url}/api/v1/twins/{TWIN}", json=made.registration, timeout=300)
    put.raise_for_status()
    settings = {"connect": [endpoint], "spool": {"folder": str(folder / "spool")}, **made.edge}
    (folder / "edge.json").write_text(json.dumps(settings))
    family.start("edge", ["edge", "--config", str(folder / "edge.json")])
    return url


def wait_for(family: Children, url: str, points: int = 0) -> None:
    """Wait for an answer, with a number of points where one is given.

    Parameters
    ----------
    family
        Processes that must not end meanwhile.
    url
        What is asked.
    points
        Points of a history that must have come.

    Raises
    ------
    SystemExit
        Where half an hour was not enough.
    """
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        with contextlib.suppress(httpx.TransportError):
            answer = httpx.get(url, timeout=300)
            if answer.is_success and (not points or len(answer.json()["points"]) >= points):
                return
        # After the answer, since the edge agent ends once all of its messages have come.
        family.check()
        time.sleep(0.5)
    raise SystemExit(f"Waited {PATIENCE_S:g} s for {points} points from {url}.")


def take(url: str, group: str, out: Path) -> None:
    """Take the picture of the twin's page, with one mode in space at rest.

    Parameters
    ----------
    url
        Address of the twin server.
    group
        Group that the page must name.
    out
        Picture to write.

    Raises
    ------
    SystemExit
        Where the picture is too large.
    """
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page(
            viewport={"width": WIDTH_PX, "height": HEIGHT_PX},
            color_scheme="light",
            locale="en-GB",
            timezone_id="UTC",
            reduced_motion="reduce",
        )
        page.set_default_timeout(300_000)
        page.goto(f"{url}/#{TWIN}")
        panel = page.locator(f'[id="{TWIN}"]')
        canvas = panel.locator(".wireframe canvas")
        expect(canvas).to_have_attribute("data-changed", group, timeout=300_000)
        expect(panel.locator(".verdict")).to_contain_text(f"{group} has lost")
        past = panel.locator('[data-quantity="elements-history"]')
        expect(past).to_have_attribute("data-points", str(LATER), timeout=300_000)
        panel.locator(".wireframe select").select_option(MODE)
        expect(canvas).to_have_attribute("data-mode", MODE)
        page.screenshot(path=out)
        browser.close()
    if out.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{out} has {out.stat().st_size} bytes. Allowed: {MOST_BYTES}.")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


if __name__ == "__main__":
    main()
