"""At the structure: samples in, features with uncertainty out."""
