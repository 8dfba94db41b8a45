"""Transports of live samples, one module each, imported when its scheme is used."""
