"""Composites in REST: health, failure probability and pooled rates."""

from .assessment import assess
from .facts import FailureQuestion, KnownFacts, TwinFacts
from .failure import Failure, failure_probability
from .graphs import CONTAINS, WrongGraphError, composites_of
from .pooled_rates import Rates
from .routes import routes

__all__ = [
    "CONTAINS",
    "Failure",
    "FailureQuestion",
    "KnownFacts",
    "Rates",
    "TwinFacts",
    "WrongGraphError",
    "assess",
    "composites_of",
    "failure_probability",
    "routes",
]
