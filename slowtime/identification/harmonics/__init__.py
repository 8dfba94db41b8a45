"""Spectra of a record in; the harmonics of rotating machines in it out."""
