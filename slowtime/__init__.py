"""Vibration in, knowledge about stiffness and mass out: arithmetic on arrays, nothing else."""
