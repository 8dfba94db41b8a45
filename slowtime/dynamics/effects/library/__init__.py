"""The effects known by name, one module for each physical family."""
