"""Physical constants that define units."""

GRAVITY = 9.80665
"""Acceleration that g stands for [m/s²] (CGPM, 1901)."""
