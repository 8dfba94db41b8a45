"""Candidate laws in; their terms, fitted to a history by marginal likelihood, out."""
