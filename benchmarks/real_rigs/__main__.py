"""Compare slowtime with other tools on measured rigs (`make real`).

The measurements are looked for in SLOWTIME_DATA (default: ``../shared/data`` beside the
project). Missing sets are skipped, and the reason is printed. Results are kept in
``var/real``, so that an interrupted run can be resumed.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from . import running
from .running import CONTESTANTS, KNOWN, SLOWTIME, is_done, prepare
from .sets import ROOT, RealSet, chosen

OUT, PAGE = ROOT / "var/real", ROOT / "docs/real_rigs.md"


def data_folder() -> Path:
    """Return the folder of the measurements."""
    return Path(os.environ.get("SLOWTIME_DATA", ROOT.parent / "shared/data"))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the tools that have no result yet, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help="run this set; may be repeated",
    )
    parser.add_argument(
        "--contestant", action="append", default=[], metavar="NAME",
        help="run this tool; may be repeated",
    )  # fmt: skip
    parser.add_argument("--refresh", action="store_true", help="repeat runs that have results")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the results")
    parser.add_argument("--page", type=Path, default=PAGE, help="Markdown page to write")
    given = parser.parse_args(arguments)
    try:
        sets = chosen(tuple(given.only))
    except ValueError as error:
        parser.error(str(error))
    skipped: dict[str, str] = {}
    for one in sets:
        try:
            folder = prepare(one, data_folder(), given.out)
        except OSError as error:
            skipped[one.name] = f"{error.filename or data_folder()} does not exist"
            print(
                f"{one.name}: skipped, {skipped[one.name]}. Set SLOWTIME_DATA to the folder of "
                "the measurements.",
                flush=True,
            )
            continue
        run_all(one, folder, tuple(given.contestant), refresh=given.refresh)
    from .page import write_page

    write_page(given.page, given.out, skipped)
    print(f"wrote {given.page}")
    return 0


def run_all(
    one: RealSet, folder: Path, names: tuple[str, ...] = (), *, refresh: bool = False
) -> None:
    """Run the contestants of these names, or all, on a set."""
    for contestant in CONTESTANTS:
        if names and contestant.name not in names:
            continue
        if is_done(contestant, folder) and not refresh:
            continue
        if contestant is not SLOWTIME and one.same_as is not None:
            continue
        if contestant is KNOWN and not one.law:
            continue
        if contestant.peer and not running.PEERS.exists():
            print(f"{one.name}: {contestant.title} is not installed; run `make real`.")
            continue
        told = running.run(contestant, folder)
        print(
            f"{one.name}: {contestant.title} took {told['cpu_seconds']:.0f} s of processor "
            f"time, load {told['load']:.1f}, exit {told['exit']}",
            flush=True,
        )


if __name__ == "__main__":
    sys.exit(main())
