"""Columns of a sheet in; channels in SI units, with what is missing in them, out."""
