"""Search among all combinations of simple laws of stiffness and damping at one element."""
