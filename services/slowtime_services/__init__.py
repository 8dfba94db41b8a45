"""What carries and keeps: bus, clock, recording, replay, files, simulation."""
