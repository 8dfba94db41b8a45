"""A history of frequency or stiffness in; the effects that it follows, and a model, out."""

from .data.history import Covariate
from .diagnose import adopt, diagnose_history
from .forecasting.forecast import PredictionBand, follow, forecast
from .forecasting.mixture import MixtureModel, undo
from .reporting.report import EffectCurve, HistoryReport

__all__ = [
    "Covariate",
    "EffectCurve",
    "HistoryReport",
    "MixtureModel",
    "PredictionBand",
    "adopt",
    "diagnose_history",
    "follow",
    "forecast",
    "undo",
]
