"""Texts of YAML, JSON and TOML from outside → plain values, within bounds.

Every document that a person, a caller or another program gives is read here: parsers of the
standard library and of PyYAML unfold aliases, recurse as deep as a file likes, and quote the
interpreter in their errors. A lint rule and `tests/docs/test_documents.py` keep others out.
"""
