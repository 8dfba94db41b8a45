"""Readings and regressors in; their marginal likelihood under a linear law out."""
