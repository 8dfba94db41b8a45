"""A limit state in; its failure probability by simulation out."""
