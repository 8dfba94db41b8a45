"""What a twin knows in forms that other tools read: CSV, Parquet, DTDL."""

from .dtdl import Asset, graph, models
from .routes import assets_of, routes
from .tables import NotInstalledError, columns_of, pages_of, written

__all__ = [
    "Asset",
    "NotInstalledError",
    "assets_of",
    "columns_of",
    "graph",
    "models",
    "pages_of",
    "routes",
    "written",
]
