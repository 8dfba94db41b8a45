"""Services that both processes share: bus, clock, recording, replay, files, simulation."""
