"""Batches with counters, stamps or arrival times in; samples at their indices out."""
