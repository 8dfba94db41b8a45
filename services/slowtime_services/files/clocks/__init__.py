"""Columns of a sheet in, the clock of its rows out."""
