"""Spectral matrices and poles in; maximum-likelihood modes of each frequency window out."""
