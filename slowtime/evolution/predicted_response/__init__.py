"""Estimated parameters in; bands of the response of the structure of today out."""
