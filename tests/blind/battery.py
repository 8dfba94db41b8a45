"""A battery run case by case: written, diagnosed and told of before the next one begins."""

import argparse
import dataclasses
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from pathlib import Path
from typing import Any

from .answers import judge, read_report
from .files import CASES, SEALED
from .running import RESULTS, Builder, Drawn, Trial, diagnose, is_written, run_one, write_one
from .tables import Row

TIMEOUT_S = 1800.0
"""[s] After which a diagnosis is ended. Source: one takes up to four minutes of processor time,
and a machine may be shared."""


@dataclasses.dataclass(frozen=True)
class Battery:
    """What one battery is made of.

    Parameters
    ----------
    name
        In the command, and of its folder.
    draw
        Names, designs and seeds of a number of cases; more cases begin with the same ones.
    build
        One case.
    row
        Further figures of one case, from truth, report, row, and the folders of both.
    line_of
        One case on a line.
    tabulate, text_of
        All cases in tables, and as text.
    """

    name: str
    draw: Callable[[int, int], list[Drawn]]
    build: Builder
    row: Callable[[dict[str, Any], dict[str, Any] | None, Row, Path, Path], Row]
    line_of: Callable[[Row], str]
    tabulate: Callable[[list[Row]], dict[str, Any]]
    text_of: Callable[[dict[str, Any], list[Row]], str]


def run_battery(battery: Battery, words: Sequence[str]) -> int:
    """Write, diagnose and score the cases that are asked for; tell of each as it is done."""
    given = _parser(battery.name).parse_args(words)
    out: Path = given.out or Path("var/blind") / f"{battery.name}-{given.seed}"
    trial = diagnose(given.command, given.timeout)
    drawn = battery.draw(given.cases, given.seed)
    if not given.score_only:
        for name in complete(out, drawn, battery.build, trial, given.jobs):
            for row in _rows(battery, out, trial, [name]):
                print(battery.line_of(row), flush=True)
    rows = list(_rows(battery, out, trial, [name for name, _, _ in drawn]))
    tables = battery.tabulate(rows)
    text = battery.text_of(tables, rows)
    plain = json.dumps({"tables": tables, "rows": rows}, indent=1)
    (out / f"{trial.name}.json").write_text(plain)
    (out / f"{trial.name}.txt").write_text(text)
    print(text)
    return 0


def complete(
    out: Path, drawn: Sequence[Drawn], builder: Builder, trial: Trial, jobs: int = 1
) -> Iterator[str]:
    """Write and diagnose each case that is not there yet; give its name once it is done.

    An interrupted run goes on where it ended.
    """
    todo = [one for one in drawn if not _result(out, trial, one[0]).exists()]
    done = len(drawn) - len(todo)
    if done:
        print(f"{done} of {len(drawn)} were done before.", file=sys.stderr, flush=True)
    if jobs == 1:
        yield from (_complete_one(out, one, builder, trial) for one in todo)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_complete_one, repeat(out), todo, repeat(builder), repeat(trial))


def _result(out: Path, trial: Trial, name: str) -> Path:
    return out / RESULTS / trial.name / name / "run.json"


def _complete_one(out: Path, drawn: Drawn, builder: Builder, trial: Trial) -> str:
    name = drawn[0]
    if not is_written(out, name):
        write_one(out, drawn, builder)
    run_one(out / CASES / name, _result(out, trial, name).parent, trial)
    return name


def _rows(battery: Battery, out: Path, trial: Trial, names: Sequence[str]) -> Iterator[Row]:
    """Score each case that was diagnosed."""
    for name in names:
        run = _result(out, trial, name)
        if run.exists():
            sealed = out / SEALED / name
            truth = json.loads((sealed / "truth.json").read_text())
            report = read_report(run.parent)
            row = judge(truth, report, sealed, run.parent) | json.loads(run.read_text())
            yield battery.row(truth, report, row, sealed, run.parent)


def _parser(name: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"python -m tests.blind.{name}")
    parser.add_argument("--cases", type=int, default=64)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder, else var/blind/NAME-SEED")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--timeout", type=float, default=TIMEOUT_S, help="seconds a case")
    parser.add_argument("--command", help="run instead of `slowtime diagnose`")
    parser.add_argument("--score-only", action="store_true", help="diagnose nothing")
    return parser
