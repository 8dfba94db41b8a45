"""The table of events of assets."""

from collections.abc import Iterable, Sequence
from typing import Any

from twin_server.events.asset_events import AssetEventRow

from .checksums import ASSET_EVENTS, opened
from .statements import absent
from .statements import insert as insert_rows


def insert(writer: Any, rows: Iterable[AssetEventRow]) -> list[Sequence[Any]]:
    """Store reported events, and return them; of several of one id of a twin the first."""
    new = absent(writer, ASSET_EVENTS, ("twin", "event"), rows)
    insert_rows(writer, ASSET_EVENTS, new)
    return new


def read(reader: Any, twin_id: str) -> list[AssetEventRow]:
    """Read the reported events of a twin, in the order of acceptance."""
    rows = reader.execute(
        f"select {', '.join(ASSET_EVENTS.all_columns)} from asset_events "
        "where twin = ? order by number, event",
        (twin_id,),
    )
    return [AssetEventRow(*row) for row in opened(ASSET_EVENTS, rows)]
