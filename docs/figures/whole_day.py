"""Take the picture of the whole-day tutorial: ``python docs/figures/whole_day.py PAGE``.

PAGE is the page of a run with ``slowtime demo --with story``, such as ``house/story.html``.
"""

import argparse
import shutil
from pathlib import Path

from playwright.sync_api import sync_playwright

OUT = Path(__file__).parents[1] / "tutorials" / "whole_day.png"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
MOST_BYTES = 400_000


def main() -> None:
    """Open the page, and take its first chart."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", type=Path)
    page_file = parser.parse_args().page.resolve()
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page(
            viewport={"width": 1000, "height": 900}, color_scheme="light", locale="en-GB"
        )
        page.goto(page_file.as_uri())
        page.wait_for_selector(".chart .main-svg", timeout=120_000)
        page.locator("figure").first.screenshot(path=OUT)
        browser.close()
    print(f"{OUT}: {OUT.stat().st_size / 1000:.0f} kB")
    if OUT.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{OUT} has {OUT.stat().st_size} bytes. Allowed: {MOST_BYTES}.")


if __name__ == "__main__":
    main()
