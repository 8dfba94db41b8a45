"""Conditioned samples in; virtual quantities, cycles of stress and their damage out."""

from .stage import Assess, AssessState, Told

__all__ = ["Assess", "AssessState", "Told"]
