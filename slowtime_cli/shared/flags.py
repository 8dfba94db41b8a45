"""Arguments that several verbs have in common."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from slowtime_cli.shared.options import POSITIVE, Real

F = TypeVar("F", bound=Callable[..., Any])
EXISTING = click.Path(exists=True, dir_okay=False, path_type=Path)
"""A file that is there."""


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


TIME_UNITS = ("s", "ms", "us", "ns", "min", "h", "d")
"""As `slowtime_services.files.UNITS`, without reading files yet."""

CLOCK = (
    click.option(
        "--time-unit",
        type=click.Choice(TIME_UNITS),
        help="Unit of that column.  [default: by its name]",
    ),
    click.option(
        "--date-order",
        type=click.Choice(["dmy", "mdy", "ymd"]),
        help="Order of dates such as 04/05/2024 or 24/04/21.  [default: detected]",
    ),
    click.option(
        "--wrapped/--not-wrapped",
        default=None,
        help="Whether all columns are one series, several values a line.  [default: detected]",
    ),
    click.option(
        "--repeated",
        type=click.Choice(["drop", "keep"]),
        help="Leave out rows that repeat the row before, or keep them.  [default: detected]",
    ),
)
"""What a text file may leave open of its clock and lines."""

UNITS = (
    click.option(
        "--unit",
        "units",
        multiple=True,
        metavar="[CHANNEL=]UNIT",
        help="Unit of the samples (g, mg, gal, in/s^2, mV ...); overrides a unit stated in "
        "the file. Motion is converted to SI.",
    ),
    click.option(
        "--sensitivity",
        "sensitivities",
        multiple=True,
        metavar="[CHANNEL=]SENSITIVITY",
        help="Scale of volts or counts: 100mV/g, a=10.2mV/(m/s^2), 256LSB/g.",
    ),
)
"""Units of the samples of a file, and sensitivities of its sensors."""

READING = (
    click.option(
        "--rate-hz",
        type=POSITIVE,
        help="Sampling rate; overrides a rate stated in the file.",
    ),
    click.option("--channels", help="Columns to use, by name or number from 0: a,b."),
    click.option(
        "--skip-lines",
        type=click.IntRange(min=0),
        help="Lines before header or data.  [default: detected]",
    ),
    click.option("--columns", help="Names of all columns, where the file has none: a,b,c."),
    click.option(
        "--time-column",
        help="Column of time, by name or number; none if there is none.  [default: detected]",
    ),
    *CLOCK,
    click.option(
        "--keep",
        help="Columns to keep although they are counters, magnitudes or the like: a,b; or all.",
    ),
    *UNITS,
)
"""How to read a record."""

RECORD = (click.argument("record_path", metavar="RECORD", type=EXISTING), *READING)
"""A record, and how to read it; `slowtime_cli.shared.record_input.with_record` takes them."""

AS_BUILT = (
    click.option(
        "--changes",
        type=click.Choice(["stiffness", "mass", "both"]),
        default="stiffness",
        show_default=True,
        help="Quantities that may change; others are assumed constant.",
    ),
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
    click.option(
        "--learn-epochs",
        type=click.IntRange(min=2),
        default=20,
        show_default=True,
        help="Epochs from which the nominal model is learnt.",
    ),
)
"""What a twin of one mode is told of its structure."""


def record_flags(function: F) -> F:
    """Add the arguments of `RECORD`."""
    return _with(RECORD, function)


def reading_flags(function: F) -> F:
    """Add the options of `READING`."""
    return _with(READING, function)


def clock_flags(function: F) -> F:
    """Add the options of `CLOCK`."""
    return _with(CLOCK, function)


def unit_flags(function: F) -> F:
    """Add the options of `UNITS`."""
    return _with(UNITS, function)


def as_built(function: F) -> F:
    """Add the options of `AS_BUILT`."""
    return _with(AS_BUILT, function)


def refuse_damping_alone(nominal_hz: float | None, nominal_damping: float | None) -> None:
    """Refuse half a nominal model.

    Raises
    ------
    click.UsageError
        Where there is a damping ratio but no frequency.
    """
    if nominal_damping is not None and nominal_hz is None:
        raise click.UsageError("--nominal-damping goes with --nominal-hz.")


def _with(decorators: tuple[Callable[[F], F], ...], function: F) -> F:
    for decorate in reversed(decorators):
        function = decorate(function)
    return function
