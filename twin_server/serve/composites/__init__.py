"""Composites at the door: twins made of twins, with health, failure probability and rates."""

from .assessment import assess
from .failure import Failure, failure_probability
from .routes import Compositing, routes

__all__ = ["Compositing", "Failure", "assess", "failure_probability", "routes"]
