"""Stress in, fatigue damage out: rainflow counts, S-N curves, Miner's sum, spectral rates."""
