"""A history in slow time in; its continuation with uncertainty out."""
