"""Steps on messages → finished within a budget, or set aside; signs of standing still."""

from .attempts import Attempts, Suspicion
from .budget import OverBudgetError, WorkBudget
from .isolation import ASIDE_BEFORE, EstimateBatch, Isolated, estimate_apart
from .monitor import ProgressMonitor
from .phases import Phase, Progress
from .quarantine import Quarantine

__all__ = [
    "ASIDE_BEFORE",
    "Attempts",
    "EstimateBatch",
    "Isolated",
    "OverBudgetError",
    "Phase",
    "Progress",
    "ProgressMonitor",
    "Quarantine",
    "Suspicion",
    "WorkBudget",
    "estimate_apart",
]
