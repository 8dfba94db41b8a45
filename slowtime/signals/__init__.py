"""Samples in, cleaner or fewer samples and spectra out."""
