"""Run the notebooks in empty folders and keep their figures: ``make notebooks``.

Each is executed as Jupyter does, cell by cell. The executed notebook and its figures go to
``var/notebooks/NAME``. The exit status is 1 if a cell fails.
"""

import argparse
import base64
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

HERE = Path(__file__).parent
NAMES = tuple(sorted(page.stem for page in HERE.glob("*.md") if page.stem != "index"))
TIMEOUT_S = 600
"""Longest time of one cell [s]; a full diagnosis takes a minute or two on a small machine."""


def run(name: str, out: Path) -> float:
    """Execute one notebook in a folder; return how long it took [s].

    Parameters
    ----------
    name
        Name of the notebook, without ending.
    out
        Folder for the executed notebook, its figures and whatever it writes.

    Raises
    ------
    CellExecutionError
        If a cell fails.
    """
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    notebook = jupytext.read(HERE / f"{name}.md", fmt="md:myst")
    client = NotebookClient(
        notebook,
        timeout=TIMEOUT_S,
        kernel_name="python3",
        resources={"metadata": {"path": str(out)}},
    )
    began = time.monotonic()
    try:
        client.execute()
    finally:
        (out / f"{name}.ipynb").write_text(nbformat.writes(notebook))  # type: ignore[no-untyped-call]
        save_figures(notebook, out)
    return time.monotonic() - began


def save_figures(notebook: Any, out: Path) -> int:
    """Write the figures of an executed notebook as PNG files; return their number."""
    number = 0
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            image = output.get("data", {}).get("image/png")
            if image is not None:
                number += 1
                (out / f"figure_{number}.png").write_bytes(base64.b64decode(image))
    return number


def main(arguments: list[str]) -> int:
    """Run the named notebooks, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(NAMES)}; all if none")
    parser.add_argument("--out", type=Path, default=Path("var/notebooks"))
    given = parser.parse_args(arguments)
    unknown = sorted(set(given.names) - set(NAMES))
    if unknown:
        parser.error(
            f"There is no notebook {', '.join(unknown)}. Notebooks: {', '.join(NAMES)}."
        )
    failed = 0
    for name in given.names or NAMES:
        try:
            took_s = run(name, (given.out / name).resolve())
        except CellExecutionError as error:
            failed += 1
            print(f"{name}: failed\n{error}", file=sys.stderr)
        else:
            print(f"{name}: {took_s:.1f} s", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
