"""Diagnosis of records whose input nobody measured, from spectra."""
