"""The table of events of assets."""

from collections.abc import Iterable
from typing import Any

from twin_server.events.asset_events import AssetEventRow

from .checksums import ASSET_EVENTS, opened


def insert(writer: Any, rows: Iterable[AssetEventRow]) -> None:
    """Keep what was told; one id of a twin is one event, and the first stays."""
    sealed = [ASSET_EVENTS.sealed(row) for row in rows]
    if sealed:
        names = ASSET_EVENTS.all_columns
        writer.executemany(
            f"insert into asset_events ({', '.join(names)}) "
            f"values ({','.join('?' * len(names))}) on conflict do nothing",
            sealed,
        )


def read(reader: Any, twin_id: str) -> list[AssetEventRow]:
    """Read what was told of a twin, in the order in which it was accepted."""
    rows = reader.execute(
        f"select {', '.join(ASSET_EVENTS.all_columns)} from asset_events "
        "where twin = ? order by number, event",
        (twin_id,),
    )
    return [AssetEventRow(*row) for row in opened(ASSET_EVENTS, rows)]
