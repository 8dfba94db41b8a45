"""Histories of features and covariates, checked, scaled and screened for swapped modes."""
