"""Faults by seed: ``python -m tests.faults --cases 200 --seed 1 --seconds 60 --jobs 4``."""

import argparse
import contextlib
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.postgres import schema_of, server

from .house import context
from .run import Outcome, run_many
from .schedule import Plan, plan


@contextlib.contextmanager
def databases(postgres: bool) -> Iterator[Callable[[Plan], str | None]]:
    """Give the database of each plan: a file of its own, or a schema of one PostgreSQL."""
    if not postgres:
        yield lambda plan: None
        return
    with tempfile.TemporaryDirectory(prefix="slowtime-pg-") as folder:
        with server(Path(folder) / "pg") as url:
            yield lambda plan: schema_of(url, f"seed_{plan.seed}")


def main() -> int:
    """Run seeds; keep the folder of each that failed; 1 where one did."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1, help="the first")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--jobs", type=int, default=4)
    parser.add_argument("--out", type=Path, default=Path("var/faults"))
    parser.add_argument("--shards", type=int, default=1, help="of the twin server")
    parser.add_argument("--link", choices=["lab", "field", "metered"], default="lab")
    parser.add_argument("--postgres", action="store_true", help="in place of SQLite")
    parser.add_argument("--show", action="store_true", help="print the schedules only")
    given = parser.parse_args()
    seeds = range(given.seed, given.seed + given.cases)
    plans = [plan(seed, given.seconds, given.shards, given.link) for seed in seeds]
    if given.show:
        for shown in plans:
            print(f"seed {shown.seed}: {shown.time_base}, spool {shown.spool_bytes:,} bytes")
            print(*(f"  {fault}" for fault in shown.faults), sep="\n")
        return 0
    shutil.rmtree(given.out, ignore_errors=True)
    context().Process(target=print, args=("The processes' ancestor has begun.",)).start()

    def tell(outcome: Outcome) -> None:
        print(outcome.line, flush=True)
        if not outcome.faults:
            shutil.rmtree(given.out / str(outcome.plan.seed))
        elif outcome.said:
            print(*(f"    {said}" for said in outcome.said), sep="\n", flush=True)

    try:
        with databases(given.postgres) as database:
            outcomes = run_many(plans, given.out, given.jobs, tell, database)
    except pytest.skip.Exception as missing:
        print(missing)
        return 2
    failed = sorted(outcome.plan.seed for outcome in outcomes if outcome.faults)
    accounts = [outcome.verdict for outcome in outcomes if outcome.verdict]
    print(
        f"{len(outcomes) - len(failed)} of {len(outcomes)} seeds of {given.seconds:g} s sound; "
        f"{sum(a.made for a in accounts)} features made, {sum(a.accepted for a in accounts)} "
        f"in history, {sum(a.lost for a in accounts)} reported lost"
    )
    for seed in failed:
        print(
            f"replay with: make faults N=1 SEED={seed} SECONDS={given.seconds:g} "
            f"SHARDS={given.shards} LINK={given.link}"
        )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
