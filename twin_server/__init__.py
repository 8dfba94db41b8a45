"""The twin: features in, knowledge of stiffness and mass out."""
