"""The option --out: one name for every file of results, whose kind its ending says."""

import contextlib
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import click

from .options import STDOUT, OutFile

F = TypeVar("F", bound=Callable[..., Any])
JSON_FILE = "slowtime.json_file"
"""Key of the context: file into which the JSON goes that the verb prints."""


class OutOption(click.Option):
    """Files of results, each by its ending; ``-`` is JSON on standard output.

    Parameters
    ----------
    writes
        Endings of the files that the verb writes by itself. For another ``.json`` it is asked
        to print JSON, which goes into the file.
    to
        Name under which the verb gets the file that it writes; None where it writes none.
    """

    def __init__(
        self, *args: Any, writes: tuple[str, ...] = (), to: str | None = None, **rest: Any
    ) -> None:
        endings = (*writes, *({".json"} - {*writes}))
        kind = OutFile(*endings, stdout=True)
        rest |= {"type": kind, "multiple": True, "metavar": "FILE", "expose_value": False}
        super().__init__(*args, **rest)
        self.writes, self.to = writes, to

    @property
    def handed_on(self) -> tuple[str, ...]:
        """Names of what the verb gets."""
        return ("as_json", *((self.to,) if self.to else ()))

    def handle_parse_result(
        self, ctx: click.Context, opts: Any, args: list[str]
    ) -> tuple[Any, list[str]]:
        """Tell the verb whether to print JSON, and which file to write."""
        value, args = super().handle_parse_result(ctx, opts, args)
        paths = [path for path in value or () if isinstance(path, Path)]
        written = [path for path in paths if path.suffix.lower() in self.writes]
        json_files = [path for path in paths if path not in written]
        for several in (written, json_files):
            if len(several) > 1:
                names = " and ".join(map(str, several))
                raise click.BadParameter(f"{names} are of one kind. Give one.", ctx, self)
        ctx.params["as_json"] = bool(json_files)
        if self.to:
            ctx.params[self.to] = written[0] if written else None
        if json_files and json_files[0] != STDOUT:
            ctx.meta[JSON_FILE] = json_files[0]
        return value, args


def out_option(text: str, *writes: str, to: str | None = None) -> Callable[[F], F]:
    """Add --out.

    Parameters
    ----------
    text
        Help: what a file of which ending holds.
    writes, to
        As `OutOption` takes them.
    """
    told = f"{text} - prints JSON. May be repeated for several kinds."
    return click.option("--out", cls=OutOption, writes=writes, to=to, help=told)


@contextlib.contextmanager
def json_into_file(ctx: click.Context) -> Iterator[None]:
    """Write what a verb prints into the file of --out, once the verb has ended well."""
    path = ctx.meta.get(JSON_FILE)
    if path is None:
        yield
        return
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        yield
    path.write_text(printed.getvalue(), encoding="utf-8")
