"""Last stage of the twin: histories in; REST, live events and the page out."""

from .api import create_app
from .http.compute_queue import ComputeQueue
from .http.problems import ProblemError
from .instants import Moment
from .knowledge import HistoryPart, Knowledge, TwinForecast
from .live import Hub
from .routes.diagnoses import DiagnosisService
from .routes.forecasts import foretell
from .routes.plans import fleet_answer

__all__ = [
    "ComputeQueue",
    "DiagnosisService",
    "HistoryPart",
    "Hub",
    "Knowledge",
    "Moment",
    "ProblemError",
    "TwinForecast",
    "create_app",
    "fleet_answer",
    "foretell",
]
