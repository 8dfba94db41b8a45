"""A verb that is declared in one module and done in another, imported once it is needed.

`slowtime_cli.verbs` declares the arguments of each verb with click alone. The module that does
the work imports arrays, compilers and servers, which takes seconds; it is imported after the
arguments were found right. So `--help`, a missing file and a wrong option cost no more than
they must.
"""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import click

from .extras import missing_extra
from .help_pages import Documented
from .outputs import json_into_file


class Deferred(Documented):
    """A command whose function is imported when it runs.

    The function that it decorates holds the help, and refuses whatever can be refused without
    importing anything; then the work is called with the same arguments.

    Parameters
    ----------
    work
        ``module:function`` within `slowtime_cli`.
    extra
        Extra of slowtime whose libraries the work imports; None where it takes none.
    fixed
        Arguments of the work that are no options of the verb, and their values.
    """

    def __init__(
        self,
        *args: Any,
        work: str,
        extra: str | None = None,
        fixed: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(*args, **settings)
        self.work, self.extra, self.fixed = work, extra, dict(fixed or {})

    def invoke(self, ctx: click.Context) -> Any:
        """Validate the options, then import the function and call it.

        Raises
        ------
        click.ClickException
            Where a library is missing that an extra brings: it names the extra.
        """
        ctx.params = {**self.fixed, **ctx.params}
        super().invoke(ctx)
        try:
            with json_into_file(ctx):
                return ctx.invoke(self.load(), **ctx.params)
        except ModuleNotFoundError as error:
            told = missing_extra(ctx.command_path, self.extra, error)
            if told is None:
                raise
            raise click.ClickException(told) from error

    def load(self) -> Callable[..., Any]:
        """Import the work."""
        module, name = self.work.split(":")
        work: Callable[..., Any] = getattr(
            importlib.import_module(f"slowtime_cli.{module}"), name
        )
        return work
