"""Principals, their scopes, and the tokens that name them."""
