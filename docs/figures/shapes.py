"""Take the picture of mode shapes in space: ``python -m docs.figures.shapes``.

Runs a twin server within this process, feeds it the features of the lattice tower whose middle
braces lose 10 %, and takes the shapes on the page of the twin, wide and as on a phone, side by
side; writes ``docs/shapes.png``.
"""

import argparse
import base64
import shutil
import tempfile
import threading
import time
from pathlib import Path

import httpx
import numpy as np
import yaml
from playwright.sync_api import Browser, expect, sync_playwright

from benchmarks.methods.monitored_tower import LEARN, PRIOR_SD, TOWER, TowerTwin
from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES, alive_key
from slowtime_services.bus import MemoryBus
from twin_server.__main__ import run
from twin_server.settings import TwinSettings

PICTURE = Path(__file__).parents[1] / "shapes.png"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
GROUP, LOSS, EPOCHS = "middle braces", -0.1, 6
WIDE, PHONE = (900, 1000), (390, 844)
MOST_BYTES = 300_000
TWIN = "lab.tower"


def main() -> None:
    """Read the flags, run the server, take the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=PICTURE)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bus, stop, ready = MemoryBus(), threading.Event(), threading.Event()
        urls: list[str] = []

        def told(url: str) -> None:
            urls.append(url)
            ready.set()

        settings = TwinSettings(database=Path(folder) / "twin.sqlite", port=0)
        server = threading.Thread(
            target=run, args=(settings,), kwargs={"bus": bus, "stop": stop, "ready": told}
        )
        server.start()
        try:
            ready.wait(60)
            _feed(bus, urls[0])
            take(urls[0], given.out)
        finally:
            stop.set()
            server.join(60)
    print(f"{given.out}: {given.out.stat().st_size / 1000:.0f} kB")


def _feed(bus: MemoryBus, url: str) -> None:
    """Register the tower, and let it be heard until the braces have been named."""
    tower = TowerTwin.read()
    names = list(tower.twin.free)
    body = {
        "name": "Lattice tower",
        "changes": "elements",
        "model": yaml.safe_load(TOWER.read_text(encoding="utf-8")),
        "parameters": dict.fromkeys(names, PRIOR_SD),
        "learn_epochs": LEARN,
    }
    httpx.put(f"{url}/api/v1/twins/{TWIN}", json=body, timeout=60).raise_for_status()
    bus.announce(alive_key(*TWIN.split(".")))  # else its sensors would be drawn as silent
    rng = np.random.default_rng(1)
    change = np.where(np.array(names) == GROUP, LOSS, 0.0)
    for sequence in range(LEARN + EPOCHS):
        theta = change if sequence >= LEARN else np.zeros(len(names))
        message = tower.epoch(sequence, tower.at(theta), rng)
        key = FEATURES.key(message.site, message.asset)
        bus.publish(key, encode(message), encoding=FEATURES.encoding, replayed=True)
    deadline = time.monotonic() + 300.0
    while time.monotonic() < deadline:
        found = httpx.get(f"{url}/api/v1/twins/{TWIN}", timeout=60).json()
        if found.get("suspects") == [GROUP]:
            return
        time.sleep(0.5)
    raise SystemExit(f"Waited 300 s for {GROUP} to be named.")


def take(url: str, out: Path) -> None:
    """Take the shapes as wide screens and as phones show them, side by side."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        parts = [_shown(browser, url, size) for size in (WIDE, PHONE)]
        page = browser.new_page(viewport={"width": 1200, "height": 700})
        images = "".join(
            f'<img src="data:image/png;base64,{base64.b64encode(part).decode("ascii")}" '
            'style="height:660px;border:1px solid #dfe1e3;border-radius:8px">'
            for part in parts
        )
        page.set_content(
            f'<div id="both" style="display:inline-flex;gap:16px;padding:8px">{images}</div>'
        )
        page.locator("#both").screenshot(path=out)
        browser.close()
    if out.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{out} has {out.stat().st_size} bytes. Allowed: {MOST_BYTES}.")


def _shown(browser: Browser, url: str, size: tuple[int, int]) -> bytes:
    page = browser.new_page(
        viewport={"width": size[0], "height": size[1]},
        color_scheme="light",
        locale="en-GB",
        timezone_id="UTC",
        reduced_motion="reduce",
    )
    page.goto(f"{url}/#{TWIN}")
    panel = page.locator(f'[id="{TWIN}"]')
    canvas = panel.locator(".wireframe canvas")
    expect(canvas).to_have_attribute("data-changed", GROUP, timeout=60_000)
    panel.locator(".wireframe select").select_option("3")
    expect(canvas).to_have_attribute("data-mode", "3")
    return panel.locator(".spatial").screenshot()


if __name__ == "__main__":
    main()
