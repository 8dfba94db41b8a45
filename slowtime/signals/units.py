"""Constants of nature that units are defined by."""

GRAVITY = 9.80665
"""Acceleration that g stands for [m/s²] (CGPM, 1901)."""
