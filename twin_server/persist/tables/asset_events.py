"""The table of events of assets."""

from collections.abc import Iterable
from typing import Any

from twin_server.events.asset_events import AssetEventRow

from .checksums import ASSET_EVENTS, opened


def insert(writer: Any, rows: Iterable[AssetEventRow]) -> None:
    """Store reported events; of several with the same id of a twin the first is kept."""
    sealed = [ASSET_EVENTS.sealed(row) for row in rows]
    if sealed:
        names = ASSET_EVENTS.all_columns
        writer.executemany(
            f"insert into asset_events ({', '.join(names)}) "
            f"values ({','.join('?' * len(names))}) on conflict do nothing",
            sealed,
        )


def read(reader: Any, twin_id: str) -> list[AssetEventRow]:
    """Read the reported events of a twin, in the order of acceptance."""
    rows = reader.execute(
        f"select {', '.join(ASSET_EVENTS.all_columns)} from asset_events "
        "where twin = ? order by number, event",
        (twin_id,),
    )
    return [AssetEventRow(*row) for row in opened(ASSET_EVENTS, rows)]
