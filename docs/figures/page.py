"""Take the pictures of the live page into ``docs``: ``python docs/figures/page.py``.

Runs the demo for as long as asked, with its frame, opens its page in Chromium and waits until
what is to be seen is drawn: the fleet, twins now and at a past instant, with a load, on a
telephone, and recordings. `docs/figures/diagnosis.py` adds that of a diagnosis.
"""

import argparse
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES
from slowtime_services.record import RecordingWriter

DOCS = Path(__file__).parents[1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
DESK, PHONE = {"width": 1200, "height": 900}, {"width": 375, "height": 812}
MOST_BYTES = 400_000
PATIENCE_MS = 120_000
PAST = 0.6
"""Instant of the past that is pictured, over the age of the twin [1]."""
HOUR_NS = 3_600 * 10**9


def main() -> None:
    """Read the flags, run the demo, take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=120.0, help="how long the demo runs")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder of the pictures")
    given = parser.parse_args()
    port = _free_port()
    with subprocess.Popen(
        [sys.executable, "-m", "slowtime_cli", "demo", "--with", "frame", "--port", str(port)],
        stdout=subprocess.DEVNULL,
    ) as demo:
        try:
            print(f"The demo grows old for {given.seconds:g} s ...")
            time.sleep(given.seconds)
            take(f"http://127.0.0.1:{port}", given.out)
        finally:
            demo.send_signal(signal.SIGINT)


def take(url: str, out: Path) -> None:
    """Take all pictures of the page at `url`."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        for name, page in _views(browser, url):
            path = out / f"{name}.png"
            page.evaluate("scrollTo(0, 0)")
            page.screenshot(path=path, full_page=name != "page_phone")
            # Few colours are drawn, so that a palette of them is enough, and half as large.
            Image.open(path).quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
            print(f"{path}: {path.stat().st_size / 1000:.0f} kB")
            if path.stat().st_size > MOST_BYTES:
                raise SystemExit(
                    f"{path} has {path.stat().st_size} bytes. Allowed: {MOST_BYTES}, since "
                    "everybody who reads the README loads it. Let the demo run shorter."
                )
            page.close()
        browser.close()


def _views(browser: Browser, url: str) -> Iterator[tuple[str, Page]]:
    """Open one view after the other, each as it is to be pictured."""

    def opened(place: str, scheme: str = "light", size: dict[str, int] = DESK) -> Page:
        page = browser.new_page(
            viewport={"width": size["width"], "height": size["height"]},
            color_scheme="dark" if scheme == "dark" else "light",
            locale="en-GB",
            timezone_id="UTC",
        )
        page.goto(f"{url}/{place}")
        return page

    page = opened("")
    expect(page.locator(".spark .line")).to_have_count(4, timeout=PATIENCE_MS)
    yield "page_fleet", page

    page = opened("#demo.tower")
    _drawn(page, "stiffness_change")
    expect(page.locator(".risk tbody tr").first).to_be_visible(timeout=PATIENCE_MS)
    yield "page", page

    now = httpx.get(f"{url}/api/v1/twins/demo.wing", timeout=60).json()["slow_time"]
    page = opened(f"#demo.wing?at={now * PAST:.0f}", "dark")
    _drawn(page, "mass_change")
    page.get_by_text("Simulate a load").click()
    page.get_by_role("button", name="Simulate").click()
    expect(page.locator(".whatif .drawing").first).to_be_visible(timeout=PATIENCE_MS)
    yield "page_past", page

    page = opened("#demo.frame", "dark", PHONE)
    expect(page.locator(".modes .moving").first).to_be_visible(timeout=PATIENCE_MS)
    plot = page.locator('[data-quantity="frequency_hz"]')
    many = re.compile(r"^[2-9]\d|\d{3}")
    expect(plot).to_have_attribute("data-points", many, timeout=PATIENCE_MS)
    yield "page_phone", page

    page = opened("#recordings")
    with tempfile.TemporaryDirectory() as folder:
        page.get_by_label("Upload a recording").set_input_files(_recording(Path(folder)))
        card = page.locator("[data-recording]")
        expect(card).to_have_count(1, timeout=PATIENCE_MS)
        card.get_by_role("button", name="Replay").click()
        expect(card.locator(".replay")).to_contain_text("features are", timeout=PATIENCE_MS)
    yield "page_recordings", page


def _drawn(page: Page, quantity: str) -> None:
    plot = page.locator(f'[data-quantity="{quantity}"]')
    expect(plot).to_have_attribute("data-forecast", "true", timeout=PATIENCE_MS)
    for name in ("points", "bands", "truth"):
        expect(plot).not_to_have_attribute(f"data-{name}", "0")


def _recording(folder: Path) -> Path:
    """Three days of a beam, once an hour, as an edge agent would have told of them."""
    path, now_ns = folder / "three-days.mcap", time.time_ns()
    with RecordingWriter(path) as writer:
        for hour in range(72):
            t_ns = now_ns - (72 - hour) * HOUR_NS
            mode = Mode(
                frequency_hz=Quantity(value=4.2 - 0.0004 * hour, sd=0.002),
                damping_ratio=Quantity(value=0.012, sd=0.001),
            )
            message = Features(
                site="site", asset="beam", boot="b1", sequence=hour, t_ns=t_ns, start_ns=t_ns,
                slow_time=t_ns / 1e9, time_base="recorded", method="ambient", modes=(mode,),
                quality=Quality(samples=60_000),
            )  # fmt: skip
            writer.write(FEATURES, "site", "beam", encode(message), t_ns)
    return path


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


if __name__ == "__main__":
    main()
