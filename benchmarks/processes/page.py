"""The page beside twins that live: how soon it paints, how late it is, whether it grows.

    python -m benchmarks.processes.page                       10 twins for 30 minutes
    python -m benchmarks.processes.page --twins 10 --seconds 120 --rate 20

First, with an empty cache and a line of 1.6 Mbit/s and 150 ms: seconds, bytes and requests
until the first picture of the fleet and of a twin.

A real server in this process is fed `--rate` features a second of each twin. Two tabs of one
Chromium look on, the fleet and one twin. Paint is that of an empty cache, from the navigation
on. The delay is the time from the moment a feature is published to the moment its words stand
on the page, by the same clock. Every `--every-s` the garbage of both tabs is collected and what
is left is printed; that of the twin swings, since a ring of readings fills and is thinned, and
has the code in it that the browser compiles. So after each sixth of the run both tabs go to the
list of recordings, where nothing of a twin is shown, and are counted there: bytes of objects
without compiled code, nodes and listeners. Leaves with 1 where the last count has a tenth more
than that of the third sixth, and more than by chance.
"""

import argparse
import itertools
import json
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, CDPSession, Page, sync_playwright

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus
from twin_server.__main__ import run
from twin_server.settings import GapSettings, TwinSettings

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
ORIGIN_NS = 1_767_225_600_000_000_000
COUNTED = ("Nodes", "JSEventListeners")
LEAST_GROWTH = {"objects": 500_000, "Nodes": 200, "JSEventListeners": 50}
PARTS = 6
PATIENCE_MS = 300_000

HEAR = """() => {
  window.heard = [];
  const place = document.querySelector('.twin .state .facts');
  new MutationObserver(() => {
    const said = /^reading (\\d+) /.exec(place.textContent);
    if (said && window.heard.at(-1)?.[0] !== +said[1]) {
      window.heard.push([+said[1], Date.now()]);
    }
    if (window.heard.length > 500) window.heard.shift();
  }).observe(place, { subtree: true, childList: true, characterData: true });
}"""
PAINTED = """() => new Promise((tell) => {
  const paint = performance.getEntriesByName('first-contentful-paint')[0];
  const drawn = () => document.querySelector('.spark, .drawing')
    ? tell({ first: paint && paint.startTime, drawn: performance.now() })
    : requestAnimationFrame(drawn);
  drawn();
})"""


SLOW_LINE = {
    "offline": False,
    "latency": 150.0,  # [ms]
    "downloadThroughput": 1.6e6 / 8,  # [bytes/s]
    "uploadThroughput": 0.75e6 / 8,
}
"""A slow mobile connection, as Chromium calls its parts."""
PICTURES = {
    "fleet": ("", ".spark"),
    "twin": ("#live.t00", '[data-quantity="frequency_hz"] .drawing'),
}


class Feeder:
    """Structures that lose stiffness, heard `rate` times a second until told to stop."""

    def __init__(self, bus: MemoryBus, twins: int, rate: float) -> None:
        self._bus, self._rate = bus, rate
        self._names = [f"t{number:02d}" for number in range(twins)]
        self._rng = np.random.default_rng(1)
        self.sent_ms: dict[int, float] = {}
        """When the first twin's features were published."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._feed, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, once what is under way is sent."""
        self._stop.set()
        self._thread.join()

    def _feed(self) -> None:
        began = time.monotonic()
        for sequence in itertools.count():
            for name in self._names:
                if name == self._names[0]:
                    self.sent_ms[sequence] = 1e3 * time.time()
                    self.sent_ms.pop(sequence - 1000, None)
                message = self._message(name, sequence)
                key = FEATURES.key(message.site, message.asset)
                self._bus.publish(key, encode(message), encoding=FEATURES.encoding)
            left = began + (sequence + 1) / self._rate - time.monotonic()
            if self._stop.wait(max(left, 0.0)):
                return

    def _message(self, name: str, sequence: int) -> Features:
        change = 0.1 * np.sin(sequence / 200.0) - 1e-5 * sequence
        frequency = float(3.0 * np.sqrt(1.0 + change) + 0.002 * self._rng.standard_normal())
        t_ns = ORIGIN_NS + sequence * 10**9
        mode = Mode(
            frequency_hz=Quantity(value=frequency, sd=0.002),
            damping_ratio=Quantity(value=0.02, sd=0.001),
        )
        return Features(
            site="live", asset=name, boot="b1", sequence=sequence, t_ns=t_ns, start_ns=t_ns,
            slow_time=float(sequence), time_base="simulated", method="ambient", modes=(mode,),
            quality=Quality(samples=1000), truth={"stiffness_change": float(change)},
        )  # fmt: skip


class Tab:
    """One tab, and what it holds once its garbage has gone."""

    def __init__(self, page: Page, place: str) -> None:
        self.page, self._place = page, place
        self._wire: CDPSession = page.context.new_cdp_session(page)
        self._wire.send("Performance.enable")
        self.held: list[dict[str, float]] = []

    def heap_mb(self) -> float:
        """Collect garbage; all JavaScript that is left, compiled code too."""
        return self._metrics()["JSHeapUsedSize"] / 1e6

    def count(self) -> None:
        """Leave the twins, count what stays, and come back."""
        self._go("#recordings")
        self._metrics()
        time.sleep(1.0)
        told = self._metrics()
        self.held.append({"objects": self._objects(), **{name: told[name] for name in COUNTED}})
        self._go(self._place)

    def grows(self) -> bool:
        """Whether anything grows by more than a tenth, and by more than it does by chance."""
        middle, last = self.held[len(self.held) // 2 - 1], self.held[-1]
        return any(
            last[name] > 1.1 * middle[name] and last[name] - middle[name] > least
            for name, least in LEAST_GROWTH.items()
        )

    def _go(self, place: str) -> None:
        self.page.evaluate("place => { location.hash = place; }", place)

    def _metrics(self) -> dict[str, float]:
        self._wire.send("HeapProfiler.collectGarbage")
        told = self._wire.send("Performance.getMetrics")["metrics"]
        return {one["name"]: one["value"] for one in told}

    def _objects(self) -> float:
        """Bytes of all objects, without code that was compiled of them."""
        chunks: list[str] = []

        def hear(event: dict[str, str]) -> None:
            chunks.append(event["chunk"])

        self._wire.on("HeapProfiler.addHeapSnapshotChunk", hear)
        self._wire.send("HeapProfiler.takeHeapSnapshot", {"reportProgress": False})
        self._wire.remove_listener("HeapProfiler.addHeapSnapshotChunk", hear)
        found = json.loads("".join(chunks))
        meta = found["snapshot"]["meta"]
        nodes = np.array(found["nodes"]).reshape(-1, len(meta["node_fields"]))
        kind = nodes[:, meta["node_fields"].index("type")]
        size = nodes[:, meta["node_fields"].index("self_size")]
        return float(size[kind != meta["node_types"][0].index("code")].sum())


def watch(
    twins: int, seconds: float, rate: float, every_s: float, say: Callable[[str], None]
) -> dict[str, Any]:
    """Let twins live while a browser looks on; what was seen."""
    with tempfile.TemporaryDirectory() as folder, MemoryBus() as bus:
        settings = TwinSettings(
            port=0, database=Path(folder) / "twin.sqlite", gap=GapSettings(every_s=0.0)
        )
        urls: list[str] = []
        ready, stop = threading.Event(), threading.Event()

        def told(url: str) -> None:
            urls.append(url)
            ready.set()

        server = threading.Thread(
            target=run, args=(settings,), kwargs={"bus": bus, "stop": stop, "ready": told}
        )
        server.start()
        ready.wait(30)
        feeder = Feeder(bus, twins, rate)
        feeder.start()
        try:
            time.sleep(max(5.0, 40 / rate))
            with sync_playwright() as playwright:
                found = next(filter(None, map(shutil.which, BROWSERS)), None)
                browser = playwright.chromium.launch(
                    executable_path=found, args=["--no-sandbox"]
                )
                first = _first_pictures(browser, urls[0])
                say(json.dumps(first))
                seen = {"first_picture": first} | _look(
                    browser, urls[0], feeder, seconds, every_s, say
                )
                browser.close()
        finally:
            feeder.stop()
            stop.set()
            server.join(20)
    return {"twins": twins, "seconds": seconds, "rate": rate} | seen


def _first_pictures(browser: Browser, url: str) -> dict[str, Any]:
    """Open the page over a slow line; what comes before its first picture."""
    seen = {}
    for name, (place, picture) in PICTURES.items():
        page = browser.new_context().new_page()
        wire = page.context.new_cdp_session(page)
        sizes: list[float] = []
        wire.on(
            "Network.loadingFinished", lambda e, to=sizes: to.append(e["encodedDataLength"])
        )
        wire.send("Network.enable")
        wire.send("Network.emulateNetworkConditions", SLOW_LINE)
        began = time.monotonic()
        page.goto(f"{url}/{place}", wait_until="commit")
        page.locator(picture).first.wait_for(timeout=PATIENCE_MS)
        seen[name] = {
            "seconds": round(time.monotonic() - began, 2),
            "kB": round(sum(sizes) / 1e3, 1),
            "requests": len(sizes),
        }
        page.context.close()
    return seen


def _look(
    browser: Browser,
    url: str,
    feeder: Feeder,
    seconds: float,
    every_s: float,
    say: Callable[[str], None],
) -> dict[str, Any]:
    painted, tabs = {}, {}
    for name, place in (("fleet", ""), ("twin", "#live.t00")):
        # A profile of its own: nothing of it is known, and its tab is never in the background.
        page = browser.new_context(viewport={"width": 1200, "height": 900}).new_page()
        page.goto(f"{url}/{place}")
        painted[name] = page.evaluate(PAINTED)
        tabs[name] = Tab(page, place)
    tabs["twin"].page.evaluate(HEAR)
    late: dict[int, float] = {}
    began, parts = time.monotonic(), 0
    while parts < PARTS:
        due = began + seconds * (parts + 1) / PARTS
        time.sleep(min(every_s, max(due - time.monotonic(), 0.1)))
        sent = dict(feeder.sent_ms)
        for sequence, at_ms in tabs["twin"].page.evaluate("window.heard"):
            if sequence in sent:
                late.setdefault(sequence, at_ms - sent[sequence])
        say(" ".join(f"{name} {tab.heap_mb():.1f} MB" for name, tab in tabs.items()))
        if time.monotonic() >= due:
            parts += 1
            for tab in tabs.values():
                tab.count()
            tabs["twin"].page.locator(".twin .state .facts").first.wait_for(timeout=PATIENCE_MS)
            tabs["twin"].page.evaluate(HEAR)
    delays = np.array(sorted(late.values()))
    return {
        "painted_ms": painted,
        "delay_ms": {
            "readings": len(delays),
            **{f"p{share}": float(np.percentile(delays, share)) for share in (50, 95, 99)},
        },
        "held": {name: tab.held for name, tab in tabs.items()},
        "grows": [name for name, tab in tabs.items() if tab.grows()],
    }


def main() -> int:
    """Print what was seen; 1 where a tab grows."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--twins", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=1800.0)
    parser.add_argument("--rate", type=float, default=4.0, help="features a second, of each")
    parser.add_argument("--every-s", type=float, default=30.0)
    given = parser.parse_args()
    seen = watch(
        given.twins,
        given.seconds,
        given.rate,
        given.every_s,
        lambda text: print(text, flush=True),
    )
    print(json.dumps(seen, indent=1))
    return 1 if seen["grows"] else 0


if __name__ == "__main__":
    sys.exit(main())
