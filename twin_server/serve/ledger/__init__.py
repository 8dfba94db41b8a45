"""Signed heads of the ledger, and proofs of chains, over REST."""

from .routes import routes

__all__ = ["routes"]
