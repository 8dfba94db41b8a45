"""Histories of known laws in; coverage, Brier scores and flicker of the twin's forecasts out."""
