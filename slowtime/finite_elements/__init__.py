"""Frames or sparse matrices in; modes, sensitivities and small parametric models out."""
