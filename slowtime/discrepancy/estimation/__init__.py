"""Candidates fitted to the free run with all constants of the model."""
