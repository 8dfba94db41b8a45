"""Rare options of a verb that belong together: KEY=VALUE behind one option.

`--reading skip_lines=3` takes the place of an option of its own for each thing that can be
said of a file. A key is declared as an option would be, with type, default and help; the verb
gets its value under the key's own name.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import click
from click.shell_completion import CompletionItem

from .help_pages import Rare

MEANINGS = {
    "--setting": "Rare settings of this command.",
    "--reading": "How a file is read that does not say so itself.",
}
"""Option that takes KEY=VALUE → what its keys have in common."""


class Setting(click.Option):
    """One key of a `Settings` option; declared as the option that it would be."""

    behind = ""
    """Option that the key is given with."""

    @property
    def key(self) -> str:
        """Name of the key: the option's, with underscores."""
        return max(self.opts, key=len).removeprefix("--").replace("-", "_")

    def get_error_hint(self, ctx: click.Context | None) -> str:
        """Name the key as it was typed."""
        return f"'{self.behind} {self.key}'"

    def values_of(self, texts: Sequence[str], ctx: click.Context) -> Any:
        """Return what click's parser would have gathered for this option.

        Raises
        ------
        click.BadParameter
            Where a key that stands once is given twice, or has the wrong number of values.
        """
        if self.multiple:
            return tuple(texts)
        if len(texts) > 1:
            raise click.BadParameter("It is given twice. Give it once.", ctx, self)
        if self.nargs == 1:
            return texts[0]
        values = tuple(texts[0].split(","))
        if len(values) != self.nargs:
            raise click.BadParameter(
                f"{texts[0]!r} are {len(values)} values. Give {self.nargs}, with commas "
                "between them.",
                ctx,
                self,
            )
        return values


class Settings(Rare):
    """An option that takes KEY=VALUE, once for each key.

    Parameters
    ----------
    settings
        The keys.
    """

    def __init__(self, *args: Any, settings: Iterable[Setting], **rest: Any) -> None:
        rest |= {"multiple": True, "metavar": "KEY=VALUE", "expose_value": False}
        super().__init__(*args, **rest)
        self.settings = {setting.key: setting for setting in settings}
        for setting in self.settings.values():
            setting.behind = self.opts[0]
        self.help = f"{self.help} Keys: {', '.join(self.settings)}; may be repeated."

    @property
    def handed_on(self) -> tuple[str, ...]:
        """Names of what the verb gets."""
        return tuple(str(one.name) for one in self.settings.values() if one.expose_value)

    def handle_parse_result(
        self, ctx: click.Context, opts: Any, args: list[str]
    ) -> tuple[Any, list[str]]:
        """Give the verb the value of each key, or its default."""
        texts: dict[str, list[str]] = {key: [] for key in self.settings}
        for given in () if ctx.resilient_parsing else opts.get(self.name) or ():
            key, equals, value = str(given).partition("=")
            key = key.strip().replace("-", "_")
            if key not in texts or not equals:
                raise click.BadParameter(
                    f"{given!r} was given. Give KEY=VALUE; keys: {', '.join(texts)}.", ctx, self
                )
            texts[key].append(value)
        for key, setting in self.settings.items():
            found = {setting.name: setting.values_of(texts[key], ctx)} if texts[key] else {}
            setting.handle_parse_result(ctx, found, [])
        return None, args

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete the keys."""
        return [
            CompletionItem(f"{key}=", help=setting.help)
            for key, setting in self.settings.items()
            if key.startswith(incomplete)
        ]

    def records(self, ctx: click.Context) -> list[tuple[str, str]]:
        """Return key and help of each setting, for the full help."""
        return [
            (f"  {key}={_allowed(one, ctx)}", (one.get_help_record(ctx) or ("", ""))[1])
            for key, one in self.settings.items()
        ]


def _allowed(setting: Setting, ctx: click.Context) -> str:
    """Return the choices of a key, for the help; empty where others are allowed."""
    if setting.is_flag:
        return "[yes|no]"
    return setting.make_metavar(ctx) if isinstance(setting.type, click.Choice) else ""


def setting(*names: str, **declared: Any) -> Setting:
    """Declare a key as `click.option` declares an option."""
    return Setting(names, **declared)


def settings_option(*settings: Setting, flag: str = "--setting") -> Callable[[Any], Any]:
    """Add one option for rare settings: of a verb, or with another name of what it says."""
    return click.option(flag, cls=Settings, settings=settings, help=MEANINGS[flag])
