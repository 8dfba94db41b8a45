"""A long file in; its records, piece by piece in bounded memory, out."""
