"""Fitted models in, free-run errors on other records and tests for missing forces out."""
