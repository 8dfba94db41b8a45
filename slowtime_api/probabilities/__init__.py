"""Probabilities of failure, surrogates of slow models, and designs."""
