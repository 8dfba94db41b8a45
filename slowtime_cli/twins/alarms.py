"""The verb `alarms`: sends a test alarm of a twin, and lists its deliveries."""

import time
from typing import Any

import click

from slowtime_cli.shared.terminal import note, show
from slowtime_cli.twins.twin_query import server_errors_told
from slowtime_services.client import Client

POLL_S = 0.2
"""Pause between two looks at the deliveries [s]."""
FINAL_STATES = ("delivered", "failed", "dropped")
"""States of a delivery that do not change any more."""


def send_test(twin: str, receiver: str | None, wait_s: float, server: str) -> int:
    """Send a test alarm of TWIN, and print which receivers it reached."""
    client = Client(server)
    with server_errors_told():
        sent = client.test_alarm(twin, receiver)
        found = _followed(client, twin, sent["event_id"], len(sent["receivers"]), wait_s)
    for one in found:
        why = f": {one['error']}" if one["error"] else ""
        tries = "1 try" if one["tries"] == 1 else f"{one['tries']} tries"
        click.echo(f"{one['receiver']}: {one['state']} after {tries}{why}")
    reached = sum(one["state"] == "delivered" for one in found)
    if reached == len(sent["receivers"]):
        return 0
    note(
        f"{reached} of {len(sent['receivers'])} receivers have accepted it within "
        f"{wait_s:g} s. The server keeps trying; `slowtime twin alarms deliveries {twin}` "
        "shows the progress."
    )
    return 1


def deliveries(twin: str, server: str) -> None:
    """Show how the routes of TWIN fare."""
    with server_errors_told():
        told = Client(server).deliveries(twin)
    columns = ("receiver", "kind", "waiting", "delivered", "failed", "last_error")
    plain = [{name: route[name] for name in columns} for route in told["routes"]]
    rows = [
        ["" if route[name] is None else str(route[name]) for name in columns] for route in plain
    ]
    show("", columns, rows, plain=plain)
    if not rows:
        note(f"No event of {twin} is sent to receivers: its registration has no alarm_routes.")


def _followed(
    client: Client, twin: str, event: str, count: int, wait_s: float
) -> list[dict[str, Any]]:
    """Deliveries of an event, once all are over or the time is."""
    until_s = time.monotonic() + wait_s
    while True:
        told = client.deliveries(twin)["deliveries"]
        found = [one for one in told if one["event_id"] == event]
        over = [one for one in found if one["state"] in FINAL_STATES]
        if len(over) >= count or time.monotonic() >= until_s:
            return found
        time.sleep(POLL_S)
