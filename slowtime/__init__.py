"""Vibration in, knowledge about stiffness and mass out: arithmetic on arrays, and nothing else."""
