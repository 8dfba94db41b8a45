"""Benchmarks of processes: start-up, throughput, memory and latency of edge and server."""
