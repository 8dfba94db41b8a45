"""Arguments that several verbs have in common."""

import dataclasses
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import click

from slowtime_cli.shared.declared import options_of
from slowtime_cli.shared.options import EXISTING as EXISTING
from slowtime_cli.shared.options import POSITIVE, Real
from slowtime_cli.shared.settings import setting
from slowtime_services.files.reading_options import ReadingOptions

F = TypeVar("F", bound=Callable[..., Any])

key_option = click.option(
    "--key",
    metavar="KEY",
    help="The server's public key, from another source: its .pub file, or the 44 characters.",
)


class SettingsFile(click.Path):
    """A file of settings that is there, of a kind that is read."""

    def __init__(self) -> None:
        super().__init__(exists=True, dir_okay=False, path_type=Path)

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        """Refuse a kind that is not read."""
        path: Path = super().convert(value, param, ctx)  # type: ignore[assignment]
        if path.suffix not in (".toml", ".json"):
            self.fail(f"{path.name} is not a valid settings file. Allowed: .toml and .json.")
        return path


class Effects(click.Path):
    """A Python file that is there, or the name of an installed plug-in, which has no dot."""

    def __init__(self) -> None:
        super().__init__(exists=True, dir_okay=False, path_type=Path)

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        """Keep a name, to be looked up where effects are loaded."""
        if Path(str(value)).suffix or Path(str(value)).exists():
            return super().convert(value, param, ctx)
        return str(value)


READING = tuple(field.name for field in dataclasses.fields(ReadingOptions))
"""What a person says of a file."""

LEARN_EPOCHS = setting(
    "--learn-epochs",
    type=click.IntRange(min=2),
    default=20,
    show_default=True,
    help="Epochs from which the nominal model is learnt.",
)
_CHANGES: dict[str, Any] = {
    "type": click.Choice(["stiffness", "mass", "both"]),
    "default": "stiffness",
    "show_default": True,
    "help": "Quantities that may change; others are assumed constant.",
}
CHANGES = setting("--changes", **_CHANGES)
changes_option = click.option("--changes", **_CHANGES)
AS_BUILT = (
    click.option(
        "--nominal-hz",
        type=POSITIVE,
        help="Natural frequency as built.  [default: learnt from the first epochs]",
    ),
    click.option(
        "--nominal-damping",
        type=Real(0, 1, max_open=True),
        help="Damping ratio as built.",
    ),
)
"""What a twin of one mode is told of its structure, beside `CHANGES` and `LEARN_EPOCHS`."""


def record_flags(function: F) -> F:
    """Add a record, and how to read it, as `record_input.with_record` takes them."""
    reading = reading_flags(function)
    return click.argument("record_path", metavar="RECORD", type=EXISTING)(reading)


reading_flags = options_of(ReadingOptions, settings="--reading")
reading_settings = options_of(ReadingOptions, settings="--reading", all_rare=True)
unit_flags = options_of(ReadingOptions, only=("units", "sensitivities"), settings="--reading")


def as_built(function: F) -> F:
    """Add the options of `AS_BUILT`."""
    return with_options(AS_BUILT, function)


def refuse_damping_alone(nominal_hz: float | None, nominal_damping: float | None) -> None:
    """Refuse half a nominal model.

    Raises
    ------
    click.UsageError
        Where there is a damping ratio but no frequency.
    """
    if nominal_damping is not None and nominal_hz is None:
        raise click.UsageError("--nominal-damping goes with --nominal-hz.")


def with_options(decorators: Iterable[Callable[[Any], Any]], function: F) -> F:
    """Add several options, in their order."""
    for decorate in reversed(tuple(decorators)):
        function = decorate(function)
    return function
