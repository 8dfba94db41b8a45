"""Text of any delimiter in, a sheet of its columns out."""
