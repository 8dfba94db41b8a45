"""Options of verbs that write a report."""

from collections.abc import Callable

import click

from .flags import F
from .options import OutFile
from .settings import Setting, setting

LANGUAGE, SUBJECT = "slowtime.language", "slowtime.subject"


def report_flag(function: F) -> F:
    """Add --report; `wording` belongs to the settings of the verb."""
    return click.option(
        "--report",
        type=OutFile(),
        metavar="FILE",
        help="Report to write, .html or .pdf. Answer, confidence, picture and what to do are "
        "on its first page.",
    )(function)


def wording() -> tuple[Setting, Setting]:
    """Return subject and language, as `report_subject` and `report_language` return them."""
    subject = setting(
        "--subject",
        default="",
        expose_value=False,
        callback=_keep(SUBJECT),
        help="Name of the structure, for the report's heading; else that of its files.",
    )
    language = setting(
        "--language",
        type=click.Choice(["en", "de"]),
        default="en",
        show_default=True,
        expose_value=False,
        envvar="SLOWTIME_LANGUAGE",
        show_envvar=True,
        callback=_keep(LANGUAGE),
        help="Language of the report.",
    )
    return subject, language


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
