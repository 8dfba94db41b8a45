"""Measurements, reference tables and a browser, on a machine that has them."""

import os
import shutil
from pathlib import Path

import jaxtyping
import pytest
from hypothesis import settings

from tests.processor_times import mark_long_tests
from tests.shapes import TEST, jaxtyped

# Before anything of the house is imported, which is where each function is wrapped.
vars(jaxtyping)["jaxtyped"] = jaxtyped

# The default suite takes the same examples each time; `make test-slow` looks for new ones.
# How long one takes says nothing on a busy machine.
settings.register_profile("seeded", derandomize=True, deadline=None)
settings.load_profile("seeded")

ROOT = Path(__file__).parents[1]
CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE_MS = 300_000
WINDOW = {"width": 1200, "height": 900}


def pytest_runtest_setup() -> None:
    """Look at the first calls of each function in every test."""
    TEST.begins()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that take too long for the default suite."""
    mark_long_tests(items)


def _folder() -> Path:
    return Path(os.environ.get("SLOWTIME_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of the real measurements."""
    if not _folder().is_dir():
        pytest.skip(f"no measurements in {_folder()}; set SLOWTIME_DATA to where they are")
    return _folder()


@pytest.fixture(scope="session")
def tables() -> Path:
    """Folder of the reference tables of the book's mathematics."""
    folder = _folder().parent / "maths"
    if not folder.is_dir():
        pytest.skip(f"no reference tables in {folder}; set SLOWTIME_DATA to its neighbour")
    return folder


@pytest.fixture(scope="module")
def browser():
    """A Chromium, of this machine or of playwright's own."""
    # Most tests need none, and it takes a while to import.
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=PATIENCE_MS)

    with sync_playwright() as playwright:
        own = Path(playwright.chromium.executable_path)
        found = next(filter(None, map(shutil.which, CHROMIUM)), own if own.exists() else None)
        if found is None:
            pytest.skip(
                f"no Chromium: none of {', '.join(CHROMIUM)} is on the PATH, and playwright "
                "has none of its own; install one, or run `playwright install chromium`"
            )
        launched = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield launched
        launched.close()


@pytest.fixture(scope="module")
def _context(browser):
    """A profile that the pages of a module share: the drawing library is read once."""
    context = browser.new_context(viewport=WINDOW)
    yield context
    context.close()


@pytest.fixture
def visit(browser, _context):
    """Open pages that keep what was requested and complained of; one asked for with a profile
    of its own has it for itself, all others share one without cookies.
    """
    opened = []

    def go(server, fragment="", viewport=WINDOW, **profile):
        context = browser.new_context(viewport=viewport, **profile) if profile else _context
        page = context.new_page()
        opened.append(context if profile else page)
        page.set_viewport_size(viewport)
        page.set_default_timeout(PATIENCE_MS)
        page.requested, page.complaints = [], []
        page.on("request", lambda request: page.requested.append(request.url))
        page.on("console", lambda message: page.complaints.append(message.text))
        page.on("pageerror", lambda error: page.complaints.append(str(error)))
        page.goto(server.url + "/" + fragment)
        return page

    yield go
    for one in opened:
        one.close()
    _context.clear_cookies()
