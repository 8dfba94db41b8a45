"""Options by the names that they had: they work, and say what they are called now."""

from collections.abc import Mapping, Sequence

import click

RENAMED: Mapping[str, tuple[str, str]] = {
    "--band": ("--band-hz", "{} {}"),
    "--bridge": ("--with", "bridge"),
    "--channel": ("--channels", "{}"),
    "--fast": ("--speed", "0"),
    "--frame": ("--with", "frame"),
    "--json": ("--out", "-"),
    "--out-model": ("--out", "{}"),
    "--plot": ("--report", "{}"),
    "--recording": ("--file", "{}"),
    "--slow-time": ("--at", "slow:{}"),
    "--twin": ("--asset", "{}"),
}
"""Option that is gone → the one that replaces it, and its values as they are given now."""
GONE_IN = "0.4"


def in_current_words(command: click.Command, args: Sequence[str]) -> list[str]:
    """Replace options by what they are called now, with a line on standard error for each.

    Parameters
    ----------
    command
        Command whose arguments they are.
    args
        Arguments as given.

    Returns
    -------
    Arguments that the command takes.
    """
    known = {name for one in command.params for name in (*one.opts, *one.secondary_opts)}
    found: list[str] = []
    rest = list(args)
    while rest:
        word = rest.pop(0)
        if word == "--":
            return [*found, word, *rest]
        name, equals, value = word.partition("=")
        now = None if name in known else _now(command, name, known)
        if now is None:
            found.append(word)
            continue
        flag, form = now
        values = [value] if equals else []
        while len(values) < form.count("{}") and rest:
            values.append(rest.pop(0))
        if len(values) != form.count("{}"):
            raise click.UsageError(f"{name} needs {form.count('{}')} more words behind it.")
        words = [flag, *(part.format(*_first(values, part)) for part in form.split())]
        found += words
        click.echo(
            f"`{name}` is now `{' '.join(words)}`; the old name ends with release {GONE_IN}.",
            err=True,
        )
    return found


def _first(values: list[str], part: str) -> list[str]:
    """Take from the values as many as a part of the form has places for."""
    return [values.pop(0) for _ in range(part.count("{}"))]


def _now(command: click.Command, name: str, known: set[str]) -> tuple[str, str] | None:
    """Option that replaces one, and the form of its value; None where nothing does."""
    for parameter in command.params:
        for key, setting in getattr(parameter, "settings", {}).items():
            if name in (*setting.opts, *setting.secondary_opts):
                return parameter.opts[0], f"{key}={_form(setting, name)}"
    flag, form = RENAMED.get(name, ("", ""))
    return (flag, form) if flag in known else None


def _form(setting: click.Option, name: str) -> str:
    if name in setting.secondary_opts:
        return "no"
    return "yes" if setting.is_flag else ",".join(["{}"] * setting.nargs)
