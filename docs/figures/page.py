"""Take the picture of the live page: ``python docs/figures/page.py`` writes ``docs/page.png``.

Runs the demo for as long as asked, opens its page in Chromium, and waits until each of the
three twins is drawn with its bands, its forecast and the simulator's truth.
"""

import argparse
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from playwright.sync_api import Page, expect, sync_playwright

PICTURE = Path(__file__).parents[1] / "page.png"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
WIDTH_PX, HEIGHT_PX = 1200, 1380
MOST_BYTES = 400_000
DRAWN = {"tower": "stiffness_change", "tank": "mass_change", "wing": "mass_change"}


def main() -> None:
    """Read the flags, run the demo, take the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=120.0, help="how long the demo runs")
    parser.add_argument("--out", type=Path, default=PICTURE)
    given = parser.parse_args()
    port = _free_port()
    with subprocess.Popen(
        [sys.executable, "-m", "slowtime_cli", "demo", "--port", str(port)],
        stdout=subprocess.DEVNULL,
    ) as demo:
        try:
            print(f"The demo grows old for {given.seconds:g} s ...")
            time.sleep(given.seconds)
            take(f"http://127.0.0.1:{port}", given.out)
        finally:
            demo.send_signal(signal.SIGINT)
    print(f"{given.out}: {given.out.stat().st_size / 1000:.0f} kB")


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
        page.goto(url)
        for name, quantity in DRAWN.items():
            _wait_until_drawn(page, f"demo.{name}", quantity)
        page.screenshot(path=out, full_page=True)
        browser.close()
    if out.stat().st_size > MOST_BYTES:
        raise SystemExit(
            f"{out} has {out.stat().st_size} bytes. Allowed: {MOST_BYTES}, since everybody who "
            "reads the README loads it. Let the demo run for a shorter time."
        )


def _wait_until_drawn(page: Page, twin_id: str, quantity: str) -> None:
    plot = page.locator(f'[id="{twin_id}"] [data-quantity="{quantity}"]')
    expect(plot).to_have_attribute("data-forecast", "true", timeout=30_000)
    for name in ("points", "bands", "truth"):
        expect(plot).not_to_have_attribute(f"data-{name}", "0")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


if __name__ == "__main__":
    main()
