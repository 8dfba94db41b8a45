"""What was found in, one HTML file that stands alone out."""

from .page import Chart, Section, Table, charts_in, write_page

__all__ = ["Chart", "Section", "Table", "charts_in", "write_page"]
