"""Records of measured inputs and outputs in; frequency response functions with errors out."""
