"""Take the picture of a frame that weakens: ``python docs/figures/frame.py``.

Runs router, twin server and an edge agent that hears three storeys of a simulated frame, one of
which loses stiffness, until the page has named it and drawn where it is heading; writes
``docs/frame.png``.
"""

import argparse
import json
import re
import shutil
import socket
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import expect, sync_playwright

from slowtime_cli.operation.child_processes import Children, children
from slowtime_cli.shared.demo_structures import registration, structure

PICTURE = Path(__file__).parents[1] / "frame.png"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
WIDTH_PX, HEIGHT_PX = 1200, 940
MOST_BYTES = 400_000
EPOCHS = 90
EXTRACT = {"method": "modes", "order": 16}


def main() -> None:
    """Read the flags, run the house, take the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--epochs", type=int, default=EPOCHS, help="how long the frame lives")
    parser.add_argument("--out", type=Path, default=PICTURE)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, children(Path(folder) / "logs") as family:
        url = _house(family, Path(folder))
        print(f"The frame grows old for {given.epochs} epochs ...")
        _wait(family, f"{url}/history?max_points=100000", given.epochs)
        take(url.partition("/api")[0], given.out)
    print(f"{given.out}: {given.out.stat().st_size / 1000:.0f} kB")


def _house(family: Children, home: Path) -> str:
    """Start everything; the address of the twin."""
    endpoint, port = f"tcp/127.0.0.1:{_free_port()}", _free_port()
    edge = {
        "site": "demo",
        "asset": "frame",
        "connect": [endpoint],
        "extract": EXTRACT,
        "spool": {"folder": str(home / "spool")},
        "publish": {"linger_s": 600.0},
        "input": {
            "kind": "simulated",
            "every_s": 0.0,
            "structure": structure("frame") | {"rate_hz": 30.0},
        },
    }
    (home / "edge.json").write_text(json.dumps(edge))
    family.start("router", ["router", "--listen", endpoint])
    database = str(home / "twin.sqlite")
    family.start(
        "twin",
        ["twin", "--connect", endpoint, "--port", str(port), "--database", database],
    )
    url = f"http://127.0.0.1:{port}/api/v1/twins/demo.frame"
    _wait(family, f"http://127.0.0.1:{port}/readyz", 0)
    body = json.dumps({"name": "Frame", **registration("frame")}).encode()
    request = urllib.request.Request(
        url, body, {"Content-Type": "application/json"}, method="PUT"
    )
    urllib.request.urlopen(request, timeout=10).close()
    family.start("edge", ["edge", "--config", str(home / "edge.json")])
    return url


def _wait(family: Children, url: str, points: int, patience_s: float = 900.0) -> None:
    """Wait for an answer that has so many points."""
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        family.check()
        time.sleep(0.3)
        try:
            with urllib.request.urlopen(url, timeout=10) as answer:
                found: dict[str, Any] = json.loads(answer.read())
        except (urllib.error.URLError, ConnectionError):
            continue
        if len(found.get("points", ())) >= points:
            return
    raise SystemExit(f"Waited {patience_s:g} s for {points} points from {url}.")


def take(url: str, out: Path) -> None:
    """Take the picture of the page at `url`."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page(
            viewport={"width": WIDTH_PX, "height": HEIGHT_PX},
            color_scheme="light",
            locale="en-GB",
            timezone_id="UTC",
        )
        page.goto(f"{url}/#demo.frame")
        panel = page.locator('[id="demo.frame"]')
        expect(panel.locator(".verdict")).to_have_text(re.compile("storey2 has lost"))
        past = panel.locator('[data-quantity="elements-history"]')
        expect(past).to_have_attribute("data-forecast", "true", timeout=60_000)
        expect(panel.locator("svg .shape")).to_have_count(3)
        page.screenshot(path=out, full_page=True)
        browser.close()
    # Few colours are drawn, so that a palette of them is enough, and half as large.
    Image.open(out).quantize(256, dither=Image.Dither.NONE).save(out, optimize=True)
    if out.stat().st_size > MOST_BYTES:
        raise SystemExit(
            f"{out} has {out.stat().st_size} bytes. Allowed: {MOST_BYTES}, since everybody who "
            "reads the README loads it. Let the frame live shorter."
        )


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


if __name__ == "__main__":
    main()
