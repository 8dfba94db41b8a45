"""A history of frequency or stiffness in; what it follows, named, and a model to adopt, out."""

from .diagnose import adopt, diagnose_history
from .history import Covariate
from .model import Band, SlowModel, follow, forecast, undo
from .report import SlowEffect, SlowReport

__all__ = [
    "Band",
    "Covariate",
    "SlowEffect",
    "SlowModel",
    "SlowReport",
    "adopt",
    "diagnose_history",
    "follow",
    "forecast",
    "undo",
]
