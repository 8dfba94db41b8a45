"""Noisy readings in, filtered and smoothed states with covariances out."""
