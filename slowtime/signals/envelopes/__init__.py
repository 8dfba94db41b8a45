"""Envelopes of bands, and the lines that damaged bearings and gears leave in them."""
