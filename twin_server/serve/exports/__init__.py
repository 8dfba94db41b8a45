"""Histories and registrations in; CSV, Parquet, DTDL and JSON-LD out."""

from .dtdl import Asset, graph, models
from .json_ld import as_json_ld
from .routes import Form, assets_of, graph_routes, of_site, routes, written_as
from .tables import NotInstalledError, columns_of, pages_of, written
from .telemetry import as_version_2

__all__ = [
    "Asset",
    "Form",
    "NotInstalledError",
    "as_json_ld",
    "as_version_2",
    "assets_of",
    "columns_of",
    "graph",
    "graph_routes",
    "models",
    "of_site",
    "pages_of",
    "routes",
    "written",
    "written_as",
]
