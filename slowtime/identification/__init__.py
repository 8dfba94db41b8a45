"""Samples in, natural frequencies and damping ratios with their standard deviations out."""
