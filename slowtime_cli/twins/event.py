"""The verb `event`: records, lists and undoes maintenance events of an asset."""

import hashlib
import json
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from slowtime_cli.shared.terminal import note, show
from slowtime_cli.twins.twin_query import server_errors_told
from slowtime_services.client import Client
from slowtime_services.documents.document_files import read_json_file
from twin_server.events.asset_events import AssetEventOrder, orders_in


def add(twin: str, kind: str | None, file: Path | None, server: str, **given: Any) -> None:
    """Record an event of TWIN, or those of a file."""
    if file is not None:
        bodies = [order_json(order) for order in orders_of(file)]
    else:
        assert kind is not None
        bodies = [_body(kind, given)]
    client = Client(server)
    for body in bodies:
        told = _record(client, twin, body)
        click.echo(f"{told.event}: {told.sentence}")


def list_events(twin: str, server: str) -> None:
    """List the events of TWIN, and open questions."""
    with server_errors_told():
        told = Client(server).recorded_events(twin)
    columns = ("event", "kind", "quantity", "slow_time", "person", "reversed_by", "sentence")
    plain = [{name: getattr(one, name) for name in columns} for one in told.events]
    rows = [["" if one[name] is None else str(one[name]) for name in columns] for one in plain]
    show("", columns, rows, plain=plain)
    for question in told.questions:
        if question.answered_by is None:
            note(f"Open question {question.event_id}: {question.message}")


def undo(
    twin: str, reverses: str, event: str | None, person: str | None, text: str, server: str
) -> None:
    """Take an event of TWIN back."""
    client = Client(server)
    with server_errors_told():
        told = client.undo_event(twin, reverses, name=event, person=person, text=text)
    click.echo(told.sentence)


def orders_of(file: Path) -> list[AssetEventOrder]:
    """Read a file of events.

    Raises
    ------
    click.UsageError
        Naming the event that cannot be read.
    """
    try:
        return orders_in(read_json_file(file))
    except (OSError, ValueError) as error:
        raise click.UsageError(f"{file}: {error}") from error


def order_json(order: AssetEventOrder) -> dict[str, Any]:
    """Write an order as REST takes it."""
    content: dict[str, Any] = order.model_dump(mode="json", exclude_unset=True)
    return content


def _record(client: Client, twin: str, body: Mapping[str, Any]) -> Any:
    with server_errors_told():
        return client.record_event(twin, body)


def _body(kind: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Make the order of one event out of the options."""
    kept = ("quantity", "at", "slow_time", "person", "answers")
    body: dict[str, Any] = {name: given[name] for name in kept if given[name] is not None}
    body |= {"kind": kind, "text": given["text"]}
    sd = given["sd"]
    if kind == "repair":
        share = 1.0 if given["perfect"] else given["restored_share"]
        if share is not None:
            body["repair"] = {"restored_share": share, "restored_share_sd": sd or 0.0}
    elif kind == "replacement":
        if given["value"] is not None:
            body["replacement"] = {"change": given["value"], "sd": sd}
    elif given["value"] is not None:
        if sd is None:
            raise click.UsageError("--value needs --sd, the standard deviation of it.")
        body["measured"] = {"value": given["value"], "sd": sd}
    if given["detected"] is not None:
        law = {"a50": given["a50"], "slope": given["slope"]}
        if None in law.values():
            raise click.UsageError(
                "--detected and --not-detected need the settings a50 and slope, the curve of "
                "probability of detection; or give points of it in --file."
            )
        body["detection"] = {
            "detected": given["detected"],
            "probability_of_detection": law,
        }
    body["event"] = given["event"] or _id(body)
    return body


def _id(body: Mapping[str, Any]) -> str:
    """Make an id of the content, or by chance where it has no time: it may happen again."""
    if "at" not in body and "slow_time" not in body:
        return uuid.uuid4().hex
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()[:32]
