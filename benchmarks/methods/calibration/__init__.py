"""Histories of known laws in; coverage, Brier scores and flicker of forecasts out."""
