"""Results in, one HTML file without external references out."""

from .page import VIEWER, Chart, Scene, Section, Table, charts_in, write_page

__all__ = ["VIEWER", "Chart", "Scene", "Section", "Table", "charts_in", "write_page"]
