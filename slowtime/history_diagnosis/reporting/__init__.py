"""A mixture of laws in; effects in physical units, sentences and curves out."""
