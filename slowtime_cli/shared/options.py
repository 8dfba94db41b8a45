"""Types of option values, and options that several verbs have in common."""

import datetime
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import click

from slowtime_schemas.plain_text import plain_text

from .input_errors import invisible_character

ROUTER = "tcp/127.0.0.1:7447"
ENCRYPTED_ROUTER = "tls/127.0.0.1:7447"
NAME = r"[a-z0-9][a-z0-9_-]{0,62}"
STDOUT = Path("-")


class Real(click.FloatRange):
    """A number that is one: neither NaN nor infinite, and within its range."""

    def _describe_range(self) -> str:
        """Describe the range for the help; click writes `x<=None` where there is none."""
        return "" if self.min is None and self.max is None else super()._describe_range()

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Refuse values that the range itself does not refuse, such as NaN."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number. Give one such as 1.5.", param, ctx)
        return number


POSITIVE = Real(min=0, min_open=True)
EXISTING = click.Path(exists=True, dir_okay=False, path_type=Path)
"""A file that is there."""


class Name(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """A site or an asset; with `parts=2` both, SITE.ASSET, each of which may be ``*``."""

    name = "name"

    def __init__(self, parts: int = 1, *, any_: bool = False) -> None:
        one = rf"({NAME}|\*)" if any_ else NAME
        self._pattern = re.compile(r"\.".join([one] * parts))
        self._allowed = ("SITE.ASSET, each of " if parts == 2 else "") + (
            "at most 63 lower-case letters, digits, '-' and '_'" + (", or *" if any_ else "")
        )

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Refuse names that cannot be part of a key."""
        if not self._pattern.fullmatch(str(value)):
            self.fail(
                f"{value!a} is not a valid name{invisible_character(str(value))}. "
                f"Allowed: {self._allowed}.",
                param,
                ctx,
            )
        return str(value)


class PlainText(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """A text for people, without control, bidirectional or other invisible characters."""

    name = "text"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Refuse texts that would not be displayed as they are."""
        try:
            return plain_text(str(value))
        except ValueError as error:
            self.fail(str(error), param, ctx)


class Endpoint(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """Where a router listens."""

    name = "endpoint"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Refuse an invalid endpoint before anything is opened."""
        if not re.fullmatch(r"[a-z][a-z0-9_+.-]*/\S+", str(value)):
            self.fail(
                f"{value!r} is not a valid endpoint. Give PROTOCOL/ADDRESS, such as {ROUTER}.",
                param,
                ctx,
            )
        return str(value)


class Database(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """A file of SQLite, or the URL of a PostgreSQL database."""

    name = "database"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Path | str:
        """Distinguish a URL from a path; refuse a folder."""
        text = str(value)
        if text.startswith(("postgresql://", "postgres://")):
            return text
        if "://" in text:
            self.fail(
                f"{text!r} is not a database. Give a file or postgresql://...", param, ctx
            )
        if Path(text).is_dir():
            self.fail(f"{text} is a folder. Give a file in it.", param, ctx)
        return Path(text)


class Size(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """An amount of bytes: 500MB, 4GB, 2GiB, or a number of bytes."""

    name = "size"
    _UNITS: ClassVar[dict[str, int]] = {
        "": 1, "b": 1,
        "kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12,
        "kib": 2**10, "mib": 2**20, "gib": 2**30, "tib": 2**40,
    }  # fmt: skip

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> int:
        """Turn text into bytes."""
        if isinstance(value, int):
            return value
        match = re.fullmatch(r"(\d+(?:\.\d+)?) ?([a-zA-Z]*)", str(value))
        unit = self._UNITS.get(match[2].lower()) if match else None
        if match is None or unit is None or not float(match[1]):
            self.fail(
                f"{value!a} is not a valid size. Give one such as 500MB or 4GB.", param, ctx
            )
        return round(float(match[1]) * unit)


class Instant(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """A date and time of ISO 8601, in UTC by default, as nanoseconds since 1970."""

    name = "time"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> int:
        """Turn text into whole nanoseconds."""
        if isinstance(value, int):
            return value
        try:
            when = datetime.datetime.fromisoformat(value)
        except ValueError:
            self.fail(
                f"{value!r} is not a valid time. Give one as 2022-07-19T22:55:00Z.", param, ctx
            )
        when = when if when.tzinfo else when.replace(tzinfo=datetime.UTC)
        since = when - datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
        t_ns = (since // datetime.timedelta(microseconds=1)) * 1000
        if not 0 <= t_ns < 2**63:
            self.fail(f"{value} is not between the years 1970 and 2262.", param, ctx)
        return t_ns


class OutFile(click.Path):
    """A file to write, whose ending names its kind, in an existing folder.

    Asked before the work, so that an hour of it is not thrown away at its end.
    """

    def __init__(self, *suffixes: str, stdout: bool = False) -> None:
        super().__init__(dir_okay=False, writable=True, path_type=Path, allow_dash=stdout)
        self._suffixes = suffixes

    def convert(
        self,
        value: Any,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Any:
        """Refuse a name that cannot be written to."""
        path: Path = super().convert(value, param, ctx)  # type: ignore[assignment]
        if path == STDOUT and self.allow_dash:
            return path
        if self._suffixes and path.suffix.lower() not in self._suffixes:
            allowed = " or ".join(self._suffixes)
            self.fail(f"{path.name!r} does not end in {allowed}. Give one that does.")
        if not path.parent.is_dir():
            self.fail(f"There is no folder {path.parent} for {path.name}. Create it first.")
        return path


def together(given: Sequence[tuple[str, object]]) -> None:
    """Refuse several options that set the same thing.

    Raises
    ------
    click.UsageError
        Naming those that were given.
    """
    used = [flag for flag, value in given if value]
    if len(used) > 1:
        raise click.UsageError(f"{' and '.join(used)} exclude each other. Give one of them.")


connect_option = click.option(
    "--connect",
    multiple=True,
    type=Endpoint(),
    default=(ROUTER,),
    show_default=True,
    help="Endpoint of the router; may be repeated.",
)

server_option = click.option(
    "--server",
    metavar="URL",
    default="http://127.0.0.1:8000",
    show_default=True,
    help="URL of the twin server; its token, if it needs one, in SLOWTIME_TOKEN.",
)

credentials_option = click.option(
    "--credentials",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder made by `slowtime keys`: use TLS with the certificate in it.",
)


def endpoints(given: Sequence[str], credentials: Path | None) -> tuple[str, ...]:
    """Endpoints given, or the usual one, which is encrypted where there are credentials.

    Examples
    --------
    >>> endpoints((ROUTER,), None), endpoints((ROUTER,), Path("keys/server"))
    (('tcp/127.0.0.1:7447',), ('tls/127.0.0.1:7447',))
    """
    unsaid = tuple(given) == (ROUTER,)
    return (ENCRYPTED_ROUTER,) if credentials is not None and unsaid else tuple(given)


class Names(click.ParamType):  # type: ignore[type-arg]  # generic in stubs only
    """Names of columns between commas."""

    name = "NAME,NAME"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Split at the commas."""
        if isinstance(value, tuple):
            return value
        found = tuple(part.strip() for part in str(value).split(","))
        if not all(found):
            self.fail(f"{value!r} has an empty name between two commas.", param, ctx)
        return found
