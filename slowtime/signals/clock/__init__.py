"""Indices and arrival times of messages in; the sampling clock of a device out."""
