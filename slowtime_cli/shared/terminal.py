"""Terminal output: results on stdout, all else on stderr; and the end of long work."""

import contextlib
import faulthandler
import json
import math
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import click
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from slowtime_services.shutdown import GRACE_S, end_later

from .options import STDOUT

ERR = Console(stderr=True)
INTERRUPTED = 130
"""Exit status of a job that Ctrl-C ended before its end."""


class StopFlag(threading.Event):
    """Set when a job shall end."""

    interrupted = False
    """Whether by Ctrl-C."""


@contextlib.contextmanager
def until_signalled(duration_s: float = 0.0) -> Iterator[StopFlag]:
    """Yield an event that Ctrl-C, SIGTERM, or the end of `duration_s` sets."""
    stop = StopFlag()

    def end(number: int, _frame: FrameType | None) -> None:
        stop.interrupted |= number == signal.SIGINT
        if not stop.is_set():
            end_later(GRACE_S)
        stop.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    timer = threading.Timer(duration_s, stop.set) if duration_s else None
    if timer is not None:
        timer.daemon = True
        timer.start()
    try:
        yield stop
    finally:
        faulthandler.cancel_dump_traceback_later()
        if timer is not None:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def counting(title: str) -> Iterator[Callable[[str], None]]:
    """Show a changing line during work of unknown length; nothing if not on a terminal."""
    if not shows_progress():
        yield lambda _text: None
        return
    with ERR.status(f"{title} ...") as status:
        yield lambda text: status.update(f"{title}: {text}")


@contextlib.contextmanager
def bar(title: str, total: float) -> Iterator[Callable[[float], None]]:
    """Show a progress bar; the function given sets how far it is. Nothing off a terminal."""
    columns = (TextColumn(title), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(
        *columns, console=ERR, transient=True, disable=not shows_progress()
    ) as progress:
        task = progress.add_task(title, total=total)
        yield lambda done: progress.update(task, completed=done)


def note(text: str) -> None:
    """Print a note on stderr, unless quiet."""
    if not _is_quiet():
        click.echo(f"note: {text}", err=True)


def show(
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    plain: Sequence[dict[str, Any]],
) -> None:
    """Print a table for a person, or lines of tab-separated `plain` for a program.

    Parameters
    ----------
    columns, rows
        What a terminal shows.
    plain
        Name → value of each row, written in full where stdout is no terminal. A mapping in a
        row becomes a column for each of its names, a list becomes text.
    """
    if not sys.stdout.isatty():
        for number, row in enumerate(map(flattened, plain)):
            if number == 0:
                click.echo("\t".join(row))
            click.echo("\t".join(map(_field, row.values())))
        return
    table = Table(title=title or None, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        words = column.isalpha()  # numbers have a unit in their heading, and stay on a line
        table.add_column(
            column, justify="left" if words else "right", no_wrap=not words, overflow="fold"
        )
    for cells in rows:
        table.add_row(*cells)
    Console().print(table)


def flattened(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of single values.

    Examples
    --------
    >>> flattened({"sum": {"median": 0.1, "sd": 0.2}, "reasons": ["short", "noisy"]})
    {'sum_median': 0.1, 'sum_sd': 0.2, 'reasons': 'short; noisy'}
    """
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, Mapping):
            inner = flattened(value)
            flat |= {f"{name}_{key.replace(' ', '_')}": one for key, one in inner.items()}
        elif isinstance(value, list | tuple):
            flat[name] = "; ".join(map(_field, value))
        else:
            flat[name] = value
    return flat


def as_exact_as(sd: float, value: float) -> str:
    """Return a number with the digits that its standard deviation leaves: two of its own.

    Examples
    --------
    >>> as_exact_as(0.0123, 4.56789), as_exact_as(430.0, 12345.6), as_exact_as(2e-9, 1.234e-7)
    ('4.568', '1.235e+04', '1.234e-07')
    >>> as_exact_as(5.0, 1.2), as_exact_as(0.0, 1.23456)
    ('1.2', '1.235')
    """
    if not (math.isfinite(sd) and sd > 0 and value):
        return f"{value:.4g}"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(sd)) + 2
    return f"{value:.{min(max(digits, 2), 9)}g}"


def write_json(out: Path, body: dict[str, Any]) -> None:
    """Write `body` to a file, or to stdout where that was asked for by ``-``."""
    text = json.dumps(body, indent=1, allow_nan=False)
    if out == STDOUT:
        click.echo(text)
    else:
        out.write_text(text + "\n", encoding="utf-8")


@contextlib.contextmanager
def removed_unless_finished(out: Path) -> Iterator[None]:
    """Remove an incomplete file if writing it fails or is interrupted."""
    existed = out.exists()
    try:
        yield
    except BaseException:
        if not existed:
            out.unlink(missing_ok=True)
        raise


def plural(count: int, noun: str) -> str:
    """Return a number with its noun, in the plural if needed.

    Examples
    --------
    >>> plural(1, "epoch"), plural(1200, "epoch")
    ('1 epoch', '1200 epochs')
    """
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _field(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "" if value is None else f"{value:.9g}" if isinstance(value, float) else str(value)


def _is_quiet() -> bool:
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.find_root().params.get("quiet"))


def shows_progress() -> bool:
    """Whether progress is shown: on a terminal, unless quiet."""
    return ERR.is_terminal and not _is_quiet()
