"""Conditioned samples in; virtual quantities, cycles of stress and their damage out."""

from .stage import Assess, AssessMessage, AssessState

__all__ = ["Assess", "AssessMessage", "AssessState"]
