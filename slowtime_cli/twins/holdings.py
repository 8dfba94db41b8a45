"""The verb `holdings`: shows what a server has under way for one's sites, and ends it."""

import datetime
from typing import Any

import click

from slowtime_cli.shared.terminal import note, show
from slowtime_cli.twins.twin_query import server_errors_told
from slowtime_services.client import Client

COLUMNS = ("id", "kind", "what", "site", "token", "since")


def show_all(server: str) -> None:
    """Show what is under way."""
    with server_errors_told():
        told = Client(server).holdings()
    plain = [_row(one) for one in told["holdings"]]
    show("", COLUMNS, [[str(row[name]) for name in COLUMNS] for row in plain], plain=plain)
    if not plain:
        note("Nothing is under way for the sites of this token.")


def cancel(holding: str, server: str) -> None:
    """End what has an id."""
    with server_errors_told():
        left = Client(server).cancel(holding)["holdings"]
    click.echo(f"{holding} is being ended. {len(left)} are under way for your sites.")


def _row(one: dict[str, Any]) -> dict[str, Any]:
    since = datetime.datetime.fromtimestamp(one["since_ns"] / 1e9, datetime.UTC)
    return one | {"since": f"{since:%Y-%m-%d %H:%M:%S}Z"}
