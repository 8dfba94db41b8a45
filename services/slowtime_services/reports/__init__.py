"""Results in, one HTML file without external references out."""

from .page import Chart, Section, Table, charts_in, write_page

__all__ = ["Chart", "Section", "Table", "charts_in", "write_page"]
