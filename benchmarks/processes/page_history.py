"""The page of a twin with a million readings beside that of one with a thousand.

    python -m benchmarks.processes.page_history                      some minutes
    python -m benchmarks.processes.page_history --readings 100000 --visits 3

Both histories are written to the store directly and served by one server. A browser opens the
pages of both twins in turn, each time with an empty cache and a profile of its own. Printed
are the medians of: first paint, the first words on the twin, the first chart, and the chart of
the whole history, which the long one draws once it is chosen; and the points of each
chart. Leaves with 1 where first paint takes more than `MOST_RATIO` times as long, or a chart
draws more than `MOST_DRAWN` points.
"""

import argparse
import json
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, expect, sync_playwright

from .page import BROWSERS, PATIENCE_MS
from .page_day import MOST_DRAWN
from .server import FEW, LONGEST, SHORTEST, fill, running

MOST_RATIO = 1.5
"""Of first paint with the long history to that with the short one: hardly to be noticed."""

SEEN = """() => new Promise((tell) => {
  const seen = {};
  const look = () => {
    const paint = performance.getEntriesByName('first-contentful-paint')[0];
    if (paint) seen.first_paint_ms ??= paint.startTime;
    const words = document.querySelector('.twin .state .facts')?.textContent;
    if (words) seen.words_ms ??= performance.now();
    const drawn = document.querySelector('.plot[data-drawn]');
    const chart = +drawn?.dataset.points > 1;
    if (paint && words && chart) tell({ ...seen, chart_ms: performance.now() });
    else requestAnimationFrame(look);
  };
  look();
})"""
"""When something, words on the twin and the first chart are seen, from the navigation on."""

DRAWN = """() => Object.fromEntries([...document.querySelectorAll('.plot[data-drawn]')].map(
  (plot) => [plot.dataset.quantity, +plot.dataset.drawn]))"""


def visit(browser: Browser, url: str, twin_id: str, readings: int) -> dict[str, Any]:
    """Open the page of one twin; when it shows what, and how much it draws."""
    context = browser.new_context(viewport={"width": 1200, "height": 900})
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(f"{url}/#{twin_id}", wait_until="commit")
    seen: dict[str, Any] = page.evaluate(SEEN)
    expect(page.locator(".plot[data-drawn]")).to_have_count(4, timeout=PATIENCE_MS)
    seen["points"] = page.evaluate(DRAWN)
    whole = page.get_by_label("Time shown")
    if readings > FEW:
        began = time.monotonic()
        whole.select_option("Whole history")
        chart = page.locator('[data-quantity="frequency_hz"]')
        expect(chart).to_have_attribute("data-points", str(readings), timeout=PATIENCE_MS)
        seen["whole_ms"] = 1e3 * (time.monotonic() - began)
        seen["points_of_whole"] = page.evaluate(DRAWN)
    context.close()
    return seen


def measure(readings: int, visits: int, folder: Path) -> dict[str, Any]:
    """Medians of some visits to either twin, and their ratios."""
    database = folder / "twin.sqlite"
    fill(database, readings)
    counts = {SHORTEST: FEW, LONGEST: readings}
    seen: dict[str, list[dict[str, Any]]] = {name: [] for name in counts}
    with running(database) as (url, _, _), sync_playwright() as playwright:
        found = next(filter(None, map(shutil.which, BROWSERS)), None)
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        for number in range(visits + 1):
            for name, count in counts.items():
                told = visit(browser, url, name, count)
                # The first visit compiles and fills the caches of the machine.
                if number:
                    seen[name].append(told)
        browser.close()
    times = {
        name: {
            key: statistics.median(one[key] for one in every)
            for key in ("first_paint_ms", "words_ms", "chart_ms", "whole_ms")
            if key in every[0]
        }
        for name, every in seen.items()
    }
    points = {
        name: {key: every[-1][key] for key in ("points", "points_of_whole") if key in every[-1]}
        for name, every in seen.items()
    }
    short, long = times[SHORTEST], times[LONGEST]
    ratios = {key: long[key] / short[key] for key in short}
    return {"readings": counts, "median_ms": times, "ratio": ratios, "points": points}


def main() -> int:
    """Print what was seen; 1 where the long history is slower or larger than it may be."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--readings", type=int, default=1_000_000)
    parser.add_argument("--visits", type=int, default=7, help="of each twin, after one more")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        seen = measure(given.readings, given.visits, Path(folder))
    print(json.dumps(seen, indent=1))
    drawn = [
        n for charts in seen["points"].values() for one in charts.values() for n in one.values()
    ]
    slow = seen["ratio"]["first_paint_ms"] > MOST_RATIO
    return 1 if slow or max(drawn) > MOST_DRAWN else 0


if __name__ == "__main__":
    sys.exit(main())
