"""Last stage of the twin: what is known goes out by HTTP, as JSON, as events, as a page."""

from .api import create_app
from .http.compute_queue import Lane
from .http.problems import ProblemError
from .instants import Moment
from .knowledge import Chapter, Knowledge, Outlook
from .live import Hub
from .routes.diagnoses import Ordering
from .routes.forecasts import foretell
from .routes.plans import fleet_answer

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
