"""Modes, probabilities of failure, plans and states in; first pages with pictures out."""
