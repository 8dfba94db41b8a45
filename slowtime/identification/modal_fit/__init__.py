"""Spectra of inputs and outputs in; poles, residues and modal masses with errors out."""
