"""A record in; its modes, each fitted by itself, with standard deviations out."""
