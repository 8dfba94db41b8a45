"""Schemas of the streams inside a recording, so that other programs can read it."""

import functools
import json
from typing import NamedTuple

from slowtime_schemas import raw
from slowtime_schemas.frozen import plotting_schema_text, schema_text
from slowtime_schemas.raw import RawHeader
from slowtime_schemas.streams import Stream


class ChannelSchema(NamedTuple):
    """Schema and message encoding, as MCAP calls them."""

    schema_name: str
    schema_encoding: str
    schema: bytes
    message_encoding: str


@functools.cache
def describe(stream: Stream) -> ChannelSchema:
    """Describe `stream`: JSON with a JSON Schema that plots, or the layout of the raw block."""
    message = stream.message
    if message is None:
        layout = {
            "layout": " ".join((raw.__doc__ or "").partition("\n\n")[2].split()),
            "header": json.loads(schema_text(RawHeader.MESSAGE, RawHeader.VERSION)),
        }
        name = f"slowtime.{RawHeader.MESSAGE}.v{RawHeader.VERSION}"
        return ChannelSchema(
            name, "x-slowtime-raw", json.dumps(layout).encode(), "x-slowtime-raw"
        )
    return ChannelSchema(
        f"slowtime.{message.MESSAGE}.v{message.VERSION}",
        "jsonschema",
        plotting_schema_text(message.MESSAGE, message.VERSION).encode(),
        "json",
    )
