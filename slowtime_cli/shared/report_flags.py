"""Options of verbs that write a report."""

import click

from .flags import F
from .options import OutFile

LANGUAGE = "slowtime.language"


def language_flag(function: F) -> F:
    """Add --language, which `report_language` gives to the work."""
    return click.option(
        "--language",
        type=click.Choice(["en", "de"]),
        default="en",
        show_default=True,
        expose_value=False,
        callback=_keep,
        help="Language of the report's first page and headings.",
    )(function)


def report_flags(function: F) -> F:
    """Add --report and --language."""
    return click.option(
        "--report",
        type=OutFile(),
        metavar="FILE",
        help="Report to write, .html or .pdf: answer, confidence, picture and what to do on "
        "its first page.",
    )(language_flag(function))


def _keep(ctx: click.Context, _param: click.Parameter, value: str) -> None:
    ctx.meta[LANGUAGE] = value


def report_language() -> str:
    """Return the language that was asked for."""
    ctx = click.get_current_context(silent=True)
    return "en" if ctx is None else str(ctx.meta.get(LANGUAGE, "en"))
