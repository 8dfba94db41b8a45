"""Finite-element models: updated from modes, reduced, and sensors placed on them."""
