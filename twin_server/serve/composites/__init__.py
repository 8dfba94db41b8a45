"""Composites in REST: health, failure probability and pooled rates."""

from .assessment import assess
from .failure import Failure, failure_probability
from .graphs import CONTAINS, WrongGraphError, composites_of
from .routes import CompositeService, routes

__all__ = [
    "CONTAINS",
    "CompositeService",
    "Failure",
    "WrongGraphError",
    "assess",
    "composites_of",
    "failure_probability",
    "routes",
]
