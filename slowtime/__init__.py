"""Arrays of vibration in, knowledge about stiffness and mass out; no I/O, no clock, no framework."""
