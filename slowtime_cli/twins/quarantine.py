"""The verb `quarantine`: lists messages that were set aside, releases and drops them."""

import datetime

import click

from slowtime_cli.shared.terminal import note, show
from slowtime_cli.twins.twin_query import server_errors_told
from slowtime_services.client import Client


def list_aside(twin: str, server: str) -> None:
    """Show the messages of TWIN that were set aside."""
    with server_errors_told():
        found = Client(server).quarantine(twin)
    columns = ("number", "boot", "sequence", "since", "in_history", "why")
    plain = [
        {name: one[name] for name in columns if name != "since"}
        | {
            "since": datetime.datetime.fromtimestamp(
                one["set_ns"] / 1e9, datetime.UTC
            ).isoformat()
        }
        for one in found
    ]
    rows = [[str(one[name]) for name in columns] for one in plain]
    show("", columns, rows, plain=plain)
    if not rows:
        note(f"No message of {twin} is set aside.")


def release(twin: str, number: int, server: str) -> None:
    """Try a message of TWIN again."""
    with server_errors_told():
        Client(server).release(twin, number)
    click.echo(f"Message {number} of {twin} is released; its states were estimated anew.")


def drop(twin: str, number: int, server: str) -> None:
    """Delete a message of TWIN that was set aside."""
    with server_errors_told():
        Client(server).drop(twin, number)
    click.echo(f"Message {number} of {twin} is dropped.")
