"""Take pictures of a diagnosis on the page: ``python docs/figures/diagnosis.py``.

Friction enters a joint of a simulated rig unannounced. Writes ``docs/diagnosis.png``, with what
was found, and ``docs/adopted.png``, with the gap closed once that is part of the twin.
"""

import argparse
import json
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

from playwright.sync_api import Locator, expect, sync_playwright

DOCS = Path(__file__).parents[1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
MOST_BYTES = 400_000
PATIENCE_MS = 240_000
SECONDS = 10.0
TWIN = "lab.rig"
MODEL: dict[str, Any] = {
    "slowtime_model": 1,
    "name": "rig",
    "nodes": [{"id": f"m{i}", "mass_kg": m} for i, m in ((1, 1.9), (2, 2.1), (3, 1.5))],
    "elements": [
        {
            "id": f"j{i}", "between": [below, f"m{i}"],
            "stiffness_n_per_m": stiffness, "damping_n_s_per_m": damping,
        }
        for i, below, stiffness, damping in (
            (1, "base", 4100.0, 2.3), (2, "m1", 3900.0, 2.2), (3, "m2", 3500.0, 2.0),
        )
    ],
    "inputs": [{"channel": "u", "kind": "force", "node": "m1", "unit": "N"}],
    "sensors": [
        {"channel": f"a{i}", "quantity": "acceleration", "node": f"m{i}", "unit": "m/s^2"}
        for i in (1, 2, 3)
    ],
    "tolerance": {"stiffness": 0.02, "damping": 0.15},
}  # fmt: skip
STRUCTURE = {
    "kind": "model", "model": MODEL, "seconds": SECONDS, "interval_s": SECONDS,
    "rate_hz": 100.0, "input_rms": 5.0, "band_hz": [0.5, 15.0], "sensor": {"noise": 0.02},
    "effects": [{"effect": "coulomb", "element": "j2", "friction_n": 1.5}], "enters": 160,
}  # fmt: skip
REGISTRATION = {
    "name": "Rig",
    "changes": "stiffness",
    "model": MODEL,
}


def main() -> None:
    """Run router, twin and edge; take both pictures."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        running: list[subprocess.Popen[bytes]] = []
        try:
            url = _house(Path(folder), running)
            _pictures(url)
        finally:
            for process in reversed(running):
                process.terminate()
                process.wait()


def _house(home: Path, running: list[subprocess.Popen[bytes]]) -> str:
    """Start all processes; where the page is."""
    router, port = f"tcp/127.0.0.1:{_free_port()}", _free_port()
    url = f"http://127.0.0.1:{port}"
    twin = {
        "connect": [router], "port": port, "database": str(home / "twin.sqlite"),
        "gap": {"every_s": 0.3, "seconds": SECONDS},
    }  # fmt: skip
    edge = {
        "connect": [router], "site": "lab", "asset": "rig",
        "spool": {"folder": str(home / "spool")},
        "extract": {"method": "ambient", "channels": ["a3"], "band_hz": [1.0, 5.0]},
        "input": {"kind": "simulated", "every_s": 0.5, "structure": STRUCTURE},
    }  # fmt: skip

    def start(*words: str) -> None:
        running.append(subprocess.Popen([sys.executable, "-m", "slowtime_cli", *words]))

    for name, settings in (("twin", twin), ("edge", edge)):
        (home / f"{name}.json").write_text(json.dumps(settings))
    start("router", "--listen", router)
    start("twin", "--config", str(home / "twin.json"))
    _until_ready(url, running)
    request = urllib.request.Request(
        f"{url}/api/v1/twins/{TWIN}",
        json.dumps(REGISTRATION).encode(),
        {"Content-Type": "application/json"},
        method="PUT",
    )
    urllib.request.urlopen(request, timeout=20).close()
    start("edge", "--config", str(home / "edge.json"))
    return url


def _pictures(url: str) -> None:
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page(
            viewport={"width": 1200, "height": 1100},
            color_scheme="light",
            locale="en-GB",
            timezone_id="UTC",
        )
        page.goto(f"{url}/#{TWIN}/diagnosis")
        room = page.locator(f'[id="{TWIN}"] .diagnosis')
        expect(room).to_have_attribute("data-gap", "disagreeing", timeout=PATIENCE_MS)
        page.wait_for_timeout(8_000)
        room.get_by_role("button", name="Find what the model lacks").click()
        job = room.locator(".jobs > li").first
        expect(job.locator(".verdict")).to_be_visible(timeout=PATIENCE_MS)
        page.wait_for_timeout(4_000)  # its charts are drawn one after the other
        _take(page.locator(f'[id="{TWIN}"]'), DOCS / "diagnosis.png", 1200)
        job.get_by_role("button", name="Adopt").click()
        expect(room).to_have_attribute("data-gap", "watching", timeout=PATIENCE_MS)
        page.wait_for_timeout(6_000)
        _take(room, DOCS / "adopted.png", 380)
        browser.close()


def _take(what: Locator, out: Path, tallest_px: float) -> None:
    """Take a picture, of what is long its beginning."""
    box = what.bounding_box()
    assert box is not None
    what.page.screenshot(
        path=out,
        full_page=True,
        clip={
            "x": box["x"], "y": box["y"] + what.page.evaluate("scrollY"),
            "width": box["width"], "height": min(box["height"], tallest_px),
        },
    )  # fmt: skip
    print(f"{out}: {out.stat().st_size / 1000:.0f} kB")
    if out.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{out} has {out.stat().st_size} bytes. Allowed: {MOST_BYTES}.")


def _until_ready(url: str, running: list[subprocess.Popen[bytes]]) -> None:
    for _ in range(600):
        try:
            urllib.request.urlopen(f"{url}/readyz", timeout=2).close()
            return
        except OSError:
            if running[-1].poll() is not None:
                raise SystemExit("The twin server did not start; see above.") from None
            time.sleep(0.1)
    raise SystemExit("The twin server is not ready after a minute.")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


if __name__ == "__main__":
    main()
