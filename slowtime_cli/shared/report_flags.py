"""Options of verbs that write a report."""

from collections.abc import Callable

import click

from .flags import F
from .options import OutFile

LANGUAGE, SUBJECT = "slowtime.language", "slowtime.subject"


def wording_flags(function: F) -> F:
    """Add --subject and --language, as `report_subject` and `report_language` return them."""
    subject = click.option(
        "--subject",
        default="",
        metavar="NAME",
        expose_value=False,
        callback=_keep(SUBJECT),
        help="Name of the structure, for the report's heading; else that of its files.",
    )
    language = click.option(
        "--language",
        type=click.Choice(["en", "de"]),
        default="en",
        show_default=True,
        expose_value=False,
        callback=_keep(LANGUAGE),
        help="Language of the report.",
    )
    return subject(language(function))


def report_flags(function: F) -> F:
    """Add --report, --subject and --language."""
    return click.option(
        "--report",
        type=OutFile(),
        metavar="FILE",
        help="Report to write, .html or .pdf: answer, confidence, picture and what to do on "
        "its first page.",
    )(wording_flags(function))


def _keep(key: str) -> Callable[[click.Context, click.Parameter, str], None]:
    def keep(ctx: click.Context, _param: click.Parameter, value: str) -> None:
        ctx.meta[key] = value

    return keep


def report_language() -> str:
    """Return the language that was asked for."""
    return _kept(LANGUAGE, "en")


def report_subject() -> str:
    """Return the name of the structure that was given; empty where none was."""
    return _kept(SUBJECT, "").strip()


def _kept(key: str, otherwise: str) -> str:
    ctx = click.get_current_context(silent=True)
    return otherwise if ctx is None else str(ctx.meta.get(key, otherwise))
