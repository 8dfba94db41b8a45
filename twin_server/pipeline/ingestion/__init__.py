"""Samples from the bus in; durable history, acknowledgements and published states out."""
