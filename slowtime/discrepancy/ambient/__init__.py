"""Records without measured inputs in, a test of the model by their spectra out."""
