"""Results in, one HTML file without external references, or a PDF, out."""

from .contents import Chart, PoleChoice, Scene, Section, Table
from .first_page import (
    Alternative,
    Confidence,
    FirstPage,
    Improvement,
    Sketch,
    level_of,
    measured_on,
    subject_of,
)
from .page import VIEWER, charts_in, page_text, write_page
from .pdf import PrintingError
from .words import LANGUAGES, Words

__all__ = [
    "LANGUAGES",
    "VIEWER",
    "Alternative",
    "Chart",
    "Confidence",
    "FirstPage",
    "Improvement",
    "PoleChoice",
    "PrintingError",
    "Scene",
    "Section",
    "Sketch",
    "Table",
    "Words",
    "charts_in",
    "level_of",
    "measured_on",
    "page_text",
    "subject_of",
    "write_page",
]
