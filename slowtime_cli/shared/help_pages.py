"""Help of a verb: a screen for everybody, and all of it with `--help-all`."""

import copy
import inspect
import re
from collections.abc import Iterable, Iterator
from typing import Any

import click

from .examples import HEADING
from .former_options import in_current_words

SCREEN = 45
"""Lines of the plain help [1]: a terminal window of usual height."""
GROUPED_FROM = 9
"""Options from which on the plain help groups them [1]; fewer are found without headings."""
EXAMPLES_SHOWN = (99, 3, 2, 1, 0)
"""Examples of the plain help, from most to fewest; the first number that fits is taken."""

GROUPS = {
    "Record": ("--rate-hz", "--channels", "--unit", "--columns"),
    "Twin": ("--server", "--asset", "--registration", "--events", "--fleet"),
    "Network": ("--connect", "--credentials", "--host", "--port"),
    "Output": ("--out", "--report", "--frf", "--geometry"),
}
"""Heading → options below it; the others stand below "Options"."""
MORE = "All options and examples: {command} --help-all"
_RANGE = re.compile(r"\s*\[[^][]*x[<>][^][]*\]$|; (?:[\d.-]+<=?)?x(?:[<>]=?[\d.-]+)?(?=\]$)")
"""Range of a number, as click puts it behind the help of an option."""


class Rare(click.Option):
    """An option that few need: in `--help-all` only."""


class Documented(click.Command):
    """A command whose plain help fits a screen, and that has `--help-all`."""

    _help_all: click.Option | None = None

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Parameters, `--help` and `--help-all`."""
        if self._help_all is None:
            self._help_all = click.Option(
                ["--help-all"],
                is_flag=True,
                is_eager=True,
                expose_value=False,
                hidden=True,
                callback=_print_all,
                help="Show all options and examples, and exit.",
            )
        return [*super().get_params(ctx), self._help_all]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Take options by their former names, too."""
        return super().parse_args(ctx, in_current_words(self, args))

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the longest form that fits a screen, or all of it where that was asked for."""
        if ctx.meta.get("slowtime.help_all"):
            formatter.write(_page(self, ctx, formatter.width, whole=True))
            return
        whole = _page(self, ctx, formatter.width, whole=True)
        if len(whole.splitlines()) <= SCREEN:
            formatter.write(whole)
            return
        line = f"\n  {MORE.format(command=ctx.command_path)}\n"
        for examples in EXAMPLES_SHOWN:
            page = _page(self, ctx, formatter.width, examples=examples) + line
            if len(page.splitlines()) <= SCREEN:
                break
        formatter.write(page)

    def rows(self, ctx: click.Context, *, whole: bool) -> list[tuple[str, list[Any]]]:
        """Return headings, and the rows of options or commands below them."""
        if whole:
            return [
                ("Options", [row for one in self.get_params(ctx) for row in _all(one, ctx)])
            ]
        everyday = [
            one
            for one in self.get_params(ctx)
            if isinstance(one, click.Option) and not isinstance(one, Rare)
        ]
        headings = GROUPS if len(everyday) >= GROUPED_FROM else {}
        below: dict[str, list[Any]] = {heading: [] for heading in ("Options", *headings)}
        for option in everyday:
            row = _short(option, ctx)
            if row is not None:
                below[_heading(option, headings)].append(row)
        for heading in headings:
            if len(below[heading]) == 1:
                below["Options"].append(below[heading].pop())
        return [(heading, rows) for heading, rows in below.items() if rows]


class DocumentedGroup(Documented, click.Group):
    """A group of commands with such a help."""

    command_class = Documented

    def rows(self, ctx: click.Context, *, whole: bool) -> list[tuple[str, list[Any]]]:
        """Return the options, and the commands below "Commands"."""
        return [*super().rows(ctx, whole=whole), *self.command_rows(ctx)]

    def command_rows(self, ctx: click.Context) -> list[tuple[str, list[Any]]]:
        """Return headings, and the commands below them with their help in one line."""
        found = ((name, self.get_command(ctx, name)) for name in self.list_commands(ctx))
        return [
            (
                "Commands",
                [(name, one.get_short_help_str(limit=100)) for name, one in found if one],
            )
        ]


def _print_all(ctx: click.Context, _param: click.Parameter, asked: bool) -> None:
    if asked and not ctx.resilient_parsing:
        ctx.meta["slowtime.help_all"] = True
        click.echo(ctx.get_help(), color=ctx.color)
        ctx.exit()


def _page(
    command: Documented,
    ctx: click.Context,
    width: int,
    *,
    whole: bool = False,
    examples: int = 0,
) -> str:
    """Return the help as text: all of it, or everyday options and some of the examples."""
    formatter = click.HelpFormatter(width=width, max_width=width)
    command.format_usage(ctx, formatter)
    text = inspect.cleandoc(command.help or "")
    epilog = inspect.cleandoc(command.epilog or "")
    if not whole:
        text = "\n\n".join(text.split("\n\n")[: 9 if examples > EXAMPLES_SHOWN[1] else 2])
        epilog = _first(epilog, examples)
    _write(formatter, text)
    for heading, rows in command.rows(ctx, whole=whole):
        with formatter.section(heading):
            formatter.write_dl(rows)
    _write(formatter, epilog)
    return formatter.getvalue()


def _write(formatter: click.HelpFormatter, text: str) -> None:
    if text:
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(text)


def _first(epilog: str, count: int) -> str:
    """Return the first examples of an epilog, without what stands behind them."""
    if count == EXAMPLES_SHOWN[0]:
        return epilog.partition(f"\b\n{HEADING}")[0].rstrip()
    if count == 0:
        return ""
    kept: list[str] = []
    for line in epilog.split("\n\n")[0].splitlines():
        begins = line.startswith("  ") and not (kept and kept[-1].endswith("\\"))
        if begins and sum(one.startswith("  slowtime") for one in kept) >= count:
            break
        kept.append(line)
    return "\n".join(kept)


def _all(parameter: click.Parameter, ctx: click.Context) -> Iterator[tuple[str, str]]:
    if isinstance(parameter, click.Option):
        record = parameter.get_help_record(ctx)
        if record is not None:
            yield record
        records = getattr(parameter, "records", None)
        yield from records(ctx) if records else ()


def _short(option: click.Option, ctx: click.Context) -> tuple[str, str] | None:
    """Return an option with the first sentence of its help, and without its range."""
    brief = copy.copy(option)
    brief.help = re.split(r"[.;] ", option.help or "")[0].rstrip(".") + "."
    if brief.metavar is None and isinstance(option.type, click.FloatRange | click.IntRange):
        brief.metavar = "NUMBER"
    record = brief.get_help_record(ctx)
    return record and (record[0], _RANGE.sub("", record[1]))


def _heading(option: click.Option, headings: Iterable[str]) -> str:
    return next(
        (one for one in headings if not set(option.opts).isdisjoint(GROUPS[one])), "Options"
    )
