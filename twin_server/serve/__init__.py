"""Last stage of the twin: what is known goes out by HTTP, as JSON, as events, as a page."""

from .api import create_app
from .diagnoses import Ordering
from .forecasts import foretell
from .knowledge import Chapter, Knowledge, Outlook
from .lanes import Lane
from .live import Hub
from .moments import Moment
from .plans import fleet_answer
from .problems import ProblemError

__all__ = [
    "Chapter",
    "Hub",
    "Knowledge",
    "Lane",
    "Moment",
    "Ordering",
    "Outlook",
    "ProblemError",
    "create_app",
    "fleet_answer",
    "foretell",
]
