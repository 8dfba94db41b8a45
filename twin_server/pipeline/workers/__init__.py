"""Calls that compute for long in; their results from worker processes out."""
