"""Composites at the door: twins made of twins, with health, failure probability and rates."""

from .assessment import assess
from .failure import Failure, failure_probability
from .graphs import CONTAINS, WrongGraphError, composites_of
from .routes import Compositing, routes

__all__ = [
    "CONTAINS",
    "Compositing",
    "Failure",
    "WrongGraphError",
    "assess",
    "composites_of",
    "failure_probability",
    "routes",
]
