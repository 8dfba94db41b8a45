"""Benchmarks of arithmetic: accuracy against known truth, and speed beside other libraries."""
