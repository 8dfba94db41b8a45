"""A record in; modes by frequency domain decomposition, plain and enhanced, out."""
