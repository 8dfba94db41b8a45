"""Columns of a sheet in; channels in SI units, and their missing values, out."""
