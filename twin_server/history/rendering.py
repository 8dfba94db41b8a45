"""Renders states and events as JSON for REST, the page and the bus.

Written by hand from columns, since a history of a thousand points is asked for often and a
general encoder takes ten times as long; tests hold it against the messages' schemas.
"""

import functools
import json
from collections.abc import Iterator, Sequence
from itertools import repeat
from typing import Any

import numpy as np
from pydantic_core import to_json

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Event, TwinState
from slowtime_schemas.streams import STATE
from twin_server.events.deliveries import identity

from .buckets import Buckets
from .details import Bodies, without_assessment, without_shapes
from .states import ESTIMATES, USED_SMOOTHED, States, assumed, sentences

_MOST_BYTES = STATE.max_bytes - 2**16


def state_objects(
    states: States,
    twin_id: str,
    boots: Sequence[str],
    units: Sequence[str],
    bodies: Bodies = (),
) -> Iterator[str]:
    """Each state as REST gives it; its boot and unit of slow time beside it."""
    for row, boot, unit, body in zip(
        states.tolist(), boots, units, bodies or repeat(None, len(states)), strict=True
    ):
        yield (
            f'{{"id":"{twin_id}","t_ns":{row[1]},{_core(row, unit)},{_rest(row, body)},'
            f'"boot":"{boot}","sequence":{row[0]},"missing_before":{row[9]}}}'
        )


def state_messages(
    states: States,
    addresses: Sequence[tuple[str, str]],
    boots: Sequence[str],
    units: Sequence[str],
    bodies: Bodies = (),
) -> Iterator[bytes]:
    """Each state as the message `TwinState` of the site and asset at its place."""
    details = bodies or repeat(None, len(states))
    for row, (site, asset), boot, unit, body in zip(
        states.tolist(), addresses, boots, units, details, strict=True
    ):
        if body is not None and len(body) > _MOST_BYTES:
            body = without_shapes(body)
        if body is not None:
            body = without_assessment(body)
        yield (
            f'{{"version":{TwinState.VERSION},"site":"{site}","asset":"{asset}","boot":"{boot}",'
            f'"sequence":{row[0]},"t_ns":{row[1]},"id":"{site}.{asset}",'
            f"{_core(row, unit, brief=True)},{_rest(row, body)}}}"
        ).encode()


def points(
    objects: Iterator[str],
    bands: Buckets | None = None,
    unit: str = "",
    names: Sequence[str] = (),
) -> bytes:
    """Render states, and bands where there are some, as a history.

    Parameters
    ----------
    bands
        What all states show, where `objects` are but some of them.
    unit
        Of slow time.
    names
        Of the free parameters of a twin of elements.
    """
    told = f'{{"points":[{",".join(objects)}]'.encode()
    if bands is not None:
        told += b',"bands":' + to_json(_bands(bands, unit, names), inf_nan_mode="null")
    return told + b"}"


def _bands(bands: Buckets, unit: str, names: Sequence[str]) -> dict[str, Any]:
    """Columns of the buckets, one number a bucket."""
    head, found = bands.head, bands.quantities
    count = found["count"]
    with np.errstate(invalid="ignore"):
        mean = found["sum"] / np.where(count > 0, count, np.nan)
    estimates: dict[str, Any] = {}
    truth: dict[str, Any] = {}
    every = [*ESTIMATES, *names]
    # A parameter that the registration no longer names is another twin's, of the same boot.
    for place, name in enumerate(every[: found.shape[1]]):
        if count[:, place].any():
            columns = {key: found[key][:, place].tolist() for key in ("min", "max", "lo", "hi")}
            estimates[name] = {"mean": mean[:, place].tolist(), **columns}
        true = found["truth"][:, place]
        if not np.isnan(true).all():
            truth[name] = {"min": true[:, 0].tolist(), "max": true[:, 1].tolist()}
    return {
        "readings": int(head["count"].sum()),
        "slow_time_unit": unit,
        "count": head["count"].tolist(),
        "valid": head["valid"].tolist(),
        **{
            end: {name: head[name][:, place].tolist() for name in ("t_ns", "slow_time")}
            for place, end in enumerate(("start", "end"))
        },
        "quantities": {name: estimates[name] for name in ESTIMATES if name in estimates},
        "elements": {name: one for name, one in estimates.items() if name not in ESTIMATES},
        "truth": truth,
    }


def event_body(event: Event) -> str:
    """Write an event as the message it travels as."""
    return encode(event).decode()


def event_object(number: int, body: str) -> dict[str, Any]:
    """Return an event as REST does: the message, its number and its identity beside it."""
    content: dict[str, Any] = json.loads(body)
    event_id = identity(content)
    content.pop("version")
    twin_id = f"{content.pop('site')}.{content.pop('asset')}"
    return {"number": number, "event_id": event_id, "id": twin_id, **content}


def estimate_objects(table: Sequence[Sequence[float]]) -> list[dict[str, float]]:
    """Rows of value, sd, lo and hi as objects.

    Parameters
    ----------
    table
        Rows of value, sd, lo and hi.
    """
    return [dict(zip(("value", "sd", "lo", "hi"), row, strict=True)) for row in table]


def _core(row: tuple[Any, ...], unit: str, *, brief: bool = False) -> str:
    frequency, damping, stiffness, mass = row[3:7]
    reasons, notes = row[10], row[11]
    return (
        f'"slow_time":{row[2]},"slow_time_unit":{_text(unit)},'
        f'"frequency_hz":{_estimate(*frequency)},"damping_ratio":{_estimate(*damping)},'
        f'"stiffness_change":{_estimate(*stiffness)},"mass_change":{_estimate(*mass)},'
        f'"correlation":{row[7]},"assumed":{_assumed(notes)},'
        f'"frequency_used":"{"smoothed" if notes & USED_SMOOTHED else "measured"}",'
        f'"valid":{"false" if reasons else "true"},"reasons":{_reasons(reasons, brief)}'
    )


def _rest(row: tuple[Any, ...], body: bytes | None) -> str:
    """Write the true values of a simulation, and the details if there are any."""
    return f'"truth":{_truth(row[8])}' if body is None else body[1:-1].decode()


def _estimate(value: float, sd: float, lo: float, hi: float) -> str:
    if value != value:
        return "null"
    return f'{{"value":{value},"sd":{sd},"lo":{lo},"hi":{hi}}}'


def _truth(known: Sequence[float]) -> str:
    said = ",".join(
        f'"{name}":{value}'
        for name, value in zip(ESTIMATES, known, strict=True)
        if value == value
    )
    return f"{{{said}}}" if said else "null"


@functools.lru_cache(maxsize=4096)
def _text(text: str) -> str:
    return json.dumps(text)


@functools.lru_cache(maxsize=4096)
def _reasons(reasons: int, brief: bool) -> str:
    said = sentences(reasons)
    return json.dumps([_opening(text) for text in said] if brief else said)


def _opening(text: str, most: int = 200) -> str:
    """Return as many whole sentences as fit a message."""
    return text if len(text) <= most else text[: text[:most].rindex(". ") + 1]


@functools.lru_cache(maxsize=16)
def _assumed(notes: int) -> str:
    return json.dumps(assumed(notes))
