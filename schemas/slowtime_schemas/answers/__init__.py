"""Answers of REST: the twin server documents them, and its Python client returns them.

A field that is added has a default, because the client also asks older servers.
"""
