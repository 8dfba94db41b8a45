"""The page after a day of the demo, beside that of its first minute.

    python -m benchmarks.processes.page_day                        24 hours of tower, tank and
    wing python -m benchmarks.processes.page_day --hours 2 --out var/day

Features are simulated at the demo's rate straight from the structures' true values, each with
the noise that its edge agent shows, and written as a recording. `slowtime replay --into` runs
them through a twin; a server is started on the history, and a browser opens each twin: what it
draws, how long that takes, how much memory server and tab hold, and a picture. The same is done
for the first minute, and each cost is also given as a ratio to that. Leaves with 1 where a
chart of the day has no forecast, draws more than `MOST_DRAWN` points, or shows a renewal
without its mark.
"""

import argparse
import json
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, expect, sync_playwright

from slowtime_cli.shared.demo_structures import METHODS, registration, structure
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality, Registered
from slowtime_schemas.quantities import RENEWALS, Quantity
from slowtime_schemas.streams import FEATURES, REGISTRATION
from slowtime_services.record import RecordingWriter
from slowtime_services.simulate import simulated_structure

from .transport import free_port

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
RATE = 5.0
"""Readings per second of each structure, as in the demo."""
SD = {"tower": (2.7e-3, 0.22), "tank": (2.7e-3, 0.18), "wing": (3.5e-4, 0.016)}
"""Relative standard deviations of frequency and damping ratio, as the agents give them."""
CHANGES = {"tower": "stiffness_change", "tank": "mass_change", "wing": "stiffness_change"}
MOST_DRAWN = 5_000
"""Points of one chart beyond which a browser becomes slow."""
PATIENCE_MS = 300_000
ASKED = 5


def features(name: str, count: int) -> Iterator[Features]:
    """Make the readings of one structure of the demo, without samples in between."""
    made = simulated_structure(structure(name))
    rng = np.random.default_rng(made.seed)
    for epoch in range(count):
        truth, renewals = made.truth(epoch), made.renewals(epoch)
        own = rng.standard_normal(2)
        both = [
            Quantity(value=truth[key] * (1.0 + sd * draw), sd=sd * truth[key])
            for key, sd, draw in zip(
                ("frequency_hz", "damping_ratio"), SD[name], own.tolist(), strict=True
            )
        ]
        start_ns = made.start_ns + round(epoch * made.interval_s * 1e9)
        yield Features(
            site="demo", asset=name, boot="b1", sequence=epoch, start_ns=start_ns,
            t_ns=start_ns + round(made.seconds * 1e9), slow_time=epoch * made.slow_time_step,
            slow_time_unit=made.slow_time_unit, time_base="simulated",
            method="free_decay" if METHODS[name] == "free_decay" else "ambient",
            modes=(Mode(frequency_hz=both[0], damping_ratio=both[1]),),
            quality=Quality(samples=made.samples), truth=truth,
            covariates={} if renewals is None else {RENEWALS: float(renewals)},
        )  # fmt: skip


def write(path: Path, names: Sequence[str], count: int) -> None:
    """Record what the twins are told, and all readings."""
    with RecordingWriter(path) as writer:
        streams = {name: features(name, count) for name in names}
        for name in names:
            told = Registered(
                site="demo", asset=name, boot="twin", sequence=1, t_ns=0, id=f"demo.{name}",
                registration=registration(name),
            )  # fmt: skip
            writer.write(REGISTRATION, "demo", name, encode(told), 0)
        for _ in range(count):
            for name, stream in streams.items():
                message = next(stream)
                writer.write(FEATURES, "demo", name, encode(message), message.t_ns)


def look(
    browser: Browser, folder: Path, names: Sequence[str], count: int, out: Path, label: str
) -> dict[str, Any]:
    """Replay `count` readings of each, start a server on them, and look at its page."""
    recording, database = folder / f"{label}.mcap", folder / f"{label}.sqlite"
    write(recording, names, count)
    began = time.monotonic()
    command = [sys.executable, "-m", "slowtime_cli"]
    subprocess.run(
        [*command, "replay", str(recording), "--into", str(database)],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    replayed_s = time.monotonic() - began
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    url = f"http://127.0.0.1:{port}"
    serve = ["twin", "--connect", endpoint, "--port", str(port), "--database", str(database)]
    with (
        (out / f"{label}.log").open("wb") as log,
        subprocess.Popen([*command, "router", "--listen", endpoint], stderr=log) as router,
        subprocess.Popen([*command, *serve], stdout=log, stderr=log) as server,
    ):
        try:
            _until_ready(url, server)
            seen = {
                name: _page(browser, url, name, out / f"{label}_{name}.png") for name in names
            }
            twin = f"{url}/api/v1/twins/demo.{names[0]}"
            latency = {
                "history_s": _median_s(f"{twin}/history?max_points=1000"),
                "forecast_s": _median_s(f"{twin}/forecast?points=40"),
            }
            memory = _resident_mb(server.pid)
        finally:
            server.terminate()
            router.terminate()
    return {
        "readings_each": count, "replayed_per_s": count * len(names) / replayed_s,
        **latency, "server_mb": memory, "twins": seen,
    }  # fmt: skip


def _page(browser: Browser, url: str, name: str, picture: Path) -> dict[str, Any]:
    """Open one twin; what its charts show."""
    page = browser.new_page(viewport={"width": 1200, "height": 900}, timezone_id="UTC")
    began = time.monotonic()
    page.goto(f"{url}/#demo.{name}")
    chart = page.locator(f'[data-quantity="{CHANGES[name]}"]')
    expect(chart).to_have_attribute("data-points", _anything(), timeout=PATIENCE_MS)
    drawn_s = time.monotonic() - began
    expect(chart).to_have_attribute("data-forecast", "true", timeout=PATIENCE_MS)
    forecast_s = time.monotonic() - began
    rows = page.locator(".crossings tbody tr").count()
    charts = page.locator(".plot[data-drawn]").evaluate_all(
        "plots => plots.map(plot => [plot.dataset.quantity, +plot.dataset.drawn])"
    )
    jumps = page.evaluate(UNEXPLAINED)
    heap = page.evaluate("performance.memory.usedJSHeapSize / 1e6")
    page.screenshot(path=picture, full_page=True)
    page.close()
    return {
        "drawn_s": drawn_s, "forecast_s": forecast_s, "threshold_rows": rows,
        "points_drawn": dict(charts), "unmarked_renewals": jumps, "tab_mb": heap,
    }  # fmt: skip


UNEXPLAINED = """async () => {
  const twin = location.hash.slice(1), base = `/api/v1/twins/${twin}`;
  const shown = document.querySelector('.plot[data-drawn]').layout;
  const [from, to] = shown.xaxis.range;
  const { events } = await (await fetch(`${base}/events?limit=100`)).json();
  const due = events.filter((one) => one.kind === 'renewed')
    .map((one) => one.slow_time).filter((at) => at > from && at < to);
  const marks = shown.shapes.filter((one) => one.name === 'renewed');
  const marked = new Set(marks.map((one) => one.x0));
  return due.filter((at) => !marked.has(at)).length;
}"""
"""How many renewals within the chart have no mark."""


def _anything() -> re.Pattern[str]:
    return re.compile(r"[1-9]")


def _seconds(url: str) -> float:
    began = time.monotonic()
    with urllib.request.urlopen(url, timeout=PATIENCE_MS / 1e3) as answer:
        answer.read()
    return time.monotonic() - began


def _median_s(url: str) -> float:
    return statistics.median(_seconds(url) for _ in range(ASKED))


def _until_ready(url: str, server: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + PATIENCE_MS / 1e3
    while True:
        try:
            _seconds(f"{url}/readyz")
        except OSError:
            if server.poll() is not None or time.monotonic() > deadline:
                raise
            time.sleep(0.2)
        else:
            return


def _resident_mb(pid: int) -> float:
    """Memory of a process and its children."""
    listed = Path("/proc").glob("[0-9]*/stat")
    parents = {}
    for path in listed:
        try:
            parts = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(path.parent.name)] = int(parts[1]), int(parts[21])
    family, pages = {pid}, 0
    for each, (parent, _) in sorted(parents.items()):
        family |= {each} if parent in family else set()
    pages = sum(size for each, (_, size) in parents.items() if each in family)
    return pages * 4096 / 1e6


def main() -> int:
    """Print what was seen; 1 where the page of the day lacks something."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--twins", nargs="+", choices=list(SD), default=list(SD))
    parser.add_argument("--out", type=Path, default=Path("var/day"), help="folder of pictures")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    counts = {"minute": round(60 * RATE), "day": round(3600 * RATE * given.hours)}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=found, args=["--no-sandbox", "--enable-precise-memory-info"]
        )
        seen = {
            label: look(browser, Path(folder), given.twins, count, given.out, label)
            for label, count in counts.items()
        }
        browser.close()
    ratios = {
        key: seen["day"][key] / seen["minute"][key]
        for key in ("history_s", "forecast_s", "server_mb")
    }
    print(json.dumps({**seen, "day_to_minute": ratios}, indent=1))
    twins = seen["day"]["twins"].values()
    lacking = any(one["unmarked_renewals"] or not one["threshold_rows"] for one in twins)
    return 1 if lacking or any(_too_many(one) for one in twins) else 0


def _too_many(seen: dict[str, Any]) -> bool:
    return any(count > MOST_DRAWN for count in seen["points_drawn"].values())


if __name__ == "__main__":
    sys.exit(main())
