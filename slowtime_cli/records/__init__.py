"""Verbs on records of samples: identify, merge, track, simulate, import and others."""
