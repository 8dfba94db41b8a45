"""Modes of several records together: sensor set-ups merged, shapes scaled by added masses."""
