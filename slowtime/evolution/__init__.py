"""Natural frequencies and damping over slow time in, changes of stiffness and mass with intervals out."""
