"""Composites: twins made of twins, and the trees they form."""
