"""Modes before and now, and a model, in; members that have lost stiffness, out."""

from .assessment import (
    Assessment,
    AssessmentSettings,
    assess,
    expected_modes,
    plan_limits,
)
from .detection_limits import DetectionLimit
from .suspects import Suspect, SuspectSet

__all__ = [
    "Assessment",
    "AssessmentSettings",
    "DetectionLimit",
    "Suspect",
    "SuspectSet",
    "assess",
    "expected_modes",
    "plan_limits",
]
