"""HTML → PDF by a browser that is installed: text stays text, charts stay lines."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome",
    "msedge", "microsoft-edge",
)  # fmt: skip
BROWSER = "SLOWTIME_BROWSER"
"""Environment variable: path of the browser that prints."""

DRAWN_MS = 20_000
"""Virtual time in which charts are drawn before the page is printed [ms]: on an idle machine
they need 1,000. Source: measured for a diagnosis with nine charts."""

PATIENCE_S = 180.0
"""Time after which printing is given up [s]: ten times what a busy machine needs."""


class PrintingError(ValueError):
    """A PDF that could not be made; the text says what to do."""


def browser() -> str:
    """Return the path of a browser that can print.

    Raises
    ------
    PrintingError
        Where none is installed.
    """
    given = os.environ.get(BROWSER)
    for name in (given,) if given else BROWSERS:
        found = shutil.which(name)
        if found is not None:
            return found
    raise PrintingError(
        f"No browser to make a PDF with was found ({given or ', '.join(BROWSERS[:3])} …). "
        f"Install Chromium, Chrome or Edge, or name one in {BROWSER}; or write the report to a "
        "file that ends in .html, and print it from any browser."
    )


def print_page(page: Path, pdf: Path) -> None:
    """Print an HTML file as PDF, A4.

    Raises
    ------
    PrintingError
        Where there is no browser, or it made no file.
    """
    program = browser()
    with tempfile.TemporaryDirectory() as profile:
        command = [
            program, "--headless", "--disable-gpu", f"--user-data-dir={profile}",
            "--no-first-run", "--disable-extensions", "--no-pdf-header-footer",
            "--window-size=700,1000", "--run-all-compositor-stages-before-draw",
            f"--virtual-time-budget={DRAWN_MS}", f"--print-to-pdf={pdf.absolute()}",
            page.absolute().as_uri(),
        ]  # fmt: skip
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            # Browsers refuse their sandbox to root; the page is of slowtime alone.
            command.insert(1, "--no-sandbox")
        try:
            done = subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise PrintingError(f"{program} could not print: {error}") from error
    if done.returncode != 0 or not pdf.exists():
        said = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
        raise PrintingError(
            f"{program} made no PDF (status {done.returncode}{': ' if said else ''}"
            f"{''.join(said)}). Write the report to a file that ends in .html instead."
        )
