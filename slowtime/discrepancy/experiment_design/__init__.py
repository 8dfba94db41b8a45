"""Rival models in, the experiment that discriminates between them out."""
