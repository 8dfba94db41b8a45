"""Structures in, their modes and responses out."""
