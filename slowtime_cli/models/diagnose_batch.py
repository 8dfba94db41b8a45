"""Diagnosis of many records, beside each other and over interruptions."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
from click.core import ParameterSource

from slowtime_cli.shared.terminal import bar, note, plural, until_signalled
from slowtime_services.batches import (
    Case,
    CaseBatch,
    cases_of,
    row_of,
    run_batch,
    write_summary,
)
from slowtime_services.engines import JobEnd, JobLimits, engine_for

OWN = ("batch", "engine", "jobs", "limit_s", "limit_mib", "retries")
"""Options of batches; all others are those of each diagnosis."""


def diagnose_batch(
    folder: Path,
    out: Path,
    engine: str,
    jobs: int | None,
    limits: JobLimits,
) -> None:
    """Diagnose the cases of a folder, and write one table of them.

    Parameters
    ----------
    folder
        With `cases.csv`, or a subfolder for each case.
    out
        Folder of results.
    engine
        `local`, `ray`, `ray:auto` or `ray://HOST:PORT`.
    jobs
        Processes beside each other; as many as cores if None.
    limits
        Of each case.
    """
    try:
        cases, runs = cases_of(folder), engine_for(engine, jobs or 0)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    more = _options_of_each(click.get_current_context())

    def command(case: Case, into: Path) -> tuple[str, ...]:
        held_out = [word for path in case.holdout for word in ("--holdout", str(path))]
        return (
            sys.executable, "-m", "slowtime_cli", "diagnose", str(case.model),
            *map(str, case.records), *held_out, *more, "--jobs", "1", "--out", str(into),
        )  # fmt: skip

    cases = [
        Case(c.name, c.model.absolute(), _absolute(c.records), _absolute(c.holdout))
        for c in cases
    ]
    out.mkdir(parents=True, exist_ok=True)
    batch = CaseBatch(cases=cases, out=out.absolute(), command=command, limits=limits)
    ended = []
    with until_signalled() as stop, bar(plural(len(cases), "case"), len(cases)) as advance:
        for outcome in run_batch(batch, runs, stop):
            ended.append(outcome)
            write_summary(out, ended)
            click.echo(_line(out, outcome))
            advance(len(ended))
    _tell(ended, len(cases), out)


def _absolute(paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(path.absolute() for path in paths)


def _options_of_each(ctx: click.Context) -> tuple[str, ...]:
    """Give the options that were typed and belong to each diagnosis, as they are typed."""
    return tuple(
        word
        for option in ctx.command.params
        if isinstance(option, click.Option)
        and option.name is not None
        and option.name not in (*OWN, "out", "holdout")
        and ctx.get_parameter_source(option.name) == ParameterSource.COMMANDLINE
        for word in _typed(option, ctx.params[option.name])
    )


def _typed(option: click.Option, value: object) -> Iterator[str]:
    if option.is_flag:
        yield option.opts[0] if value else option.secondary_opts[0]
        return
    for one in value if option.multiple and isinstance(value, tuple) else (value,):
        yield from (option.opts[0], str(one))


def _line(out: Path, outcome: JobEnd) -> str:
    row = row_of(out, outcome)
    told = row.get("verdict") or outcome.status
    effects = f" ({row['effects']})" if row.get("effects") else ""
    return f"{outcome.name}: {str(told).replace('_', ' ')}{effects}, {outcome.seconds:.0f} s"


def _tell(ended: Sequence[JobEnd], count: int, out: Path) -> None:
    """Say how the batch ended; status 1 if any case gave no diagnosis."""
    counts = Counter(one.status for one in ended)
    note(f"{counts['done']} of {plural(count, 'case')} diagnosed: {out / 'summary.csv'}")
    if len(ended) < count:
        note(f"{count - len(ended)} left. Run the same command again to continue.")
    if counts["done"] < count:
        raise click.exceptions.Exit(1)
