"""Compare slowtime with other tools on measured rigs: `make real`, or this module.

The measurements are looked for in SLOWTIME_DATA (default: ``../shared/data`` beside the
project). Sets that are not there are skipped, and the reason is told. Results are kept in
``var/real``, so that a run that was interrupted goes on.
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
    """Run what was not run yet, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="one set")
    parser.add_argument("--contestant", action="append", default=[], metavar="NAME")
    parser.add_argument("--refresh", action="store_true", help="run again what was run already")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--page", type=Path, default=PAGE)
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
            skipped[one.name] = f"{error.filename or data_folder()} is not there"
            print(f"{one.name}: skipped, {skipped[one.name]}. Set SLOWTIME_DATA.", flush=True)
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
