"""Frequencies and damping ratios in; relative changes of stiffness and mass out."""
